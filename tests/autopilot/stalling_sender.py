"""A program that commands a vehicle through the real link, then stalls as it is told to.

`python stalling_sender.py PORT HOW`: links to the vehicle on 127.0.0.1:PORT and has the control task hover at 250 Hz;
with HOW a number, the event loop's thread holds the interpreter for so many seconds at each SIGUSR1; with "dies" that
thread ends at SIGUSR1 while the others live on. It says "flying" when it sends, and the clock around each stall.
"""

import asyncio
import ctypes
import signal
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np

from flightapp import tasks
from flightapp.autopilot.guard import CommandGuard
from flightapp.autopilot.link import Px4Link
from flightapp.bus import Bus
from flightapp.config import load_config
from flightapp.control.flatness import FlatnessController
from flightapp.messages import VehicleState
from flightapp.planning.line import Line
from flightapp.timing import KernelTicker
from flightapp.trajectory import hover

HERE = np.array((0.0, 0.0, 1.5))


def say(text):
    print(text, flush=True)


async def states(bus, line):
    """The state of a vehicle that hovers on its line, wherever else it may be."""
    while True:
        stamp = tasks.now()
        still = np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3), np.zeros(3)
        bus.state.publish(VehicleState(stamp, HERE, *still, 1e-4 * np.eye(9)))
        if line.latest is None and bus.fault.latest is None:
            line.accept(hover(stamp, HERE, 0.0))
        await asyncio.sleep(0.005)


def stall(seconds):
    """Keep the interpreter to itself for ``seconds``: PyDLL calls don't give it up."""
    begin = time.monotonic()
    ctypes.PyDLL(None).usleep(int(1e6 * seconds))
    say(f"stalled {begin} {time.monotonic()}")


def die():
    say(f"died {time.monotonic()}")
    raise SystemExit  # what ordinary exceptions do not, this does: end the loop


async def main(port, how, orders):
    config = load_config(None, {"link.connection": f"udpin://127.0.0.1:{port}"})
    link, bus, line = Px4Link(config), Bus(), Line()
    await link.connect()
    loop = asyncio.get_running_loop()
    orders.append((loop, die if how == "dies" else lambda: stall(float(how))))
    bus.fault.tap(lambda event: say(f"fault {time.monotonic()} {event.text}"))
    rig, modules = (
        SimpleNamespace(autopilot=link),
        SimpleNamespace(controller=FlatnessController(config), guard=CommandGuard(config)),
    )
    with KernelTicker(config.control.rate) as ticker:
        control = tasks.control(rig, bus, modules, line, ticker)
        running = [asyncio.create_task(work) for work in (states(bus, line), control)]
        await bus.command.next()
        say("flying")
        await asyncio.gather(*running)


def fly(port, how, orders):
    try:
        asyncio.run(main(port, how, orders))
    except SystemExit:
        threading.Event().wait()  # nothing of the link is given back: the thread is simply gone from its loop


if __name__ == "__main__":
    orders = []
    signal.signal(signal.SIGUSR1, lambda *_: orders[0][0].call_soon_threadsafe(orders[0][1]))
    threading.Thread(target=fly, args=(int(sys.argv[1]), sys.argv[2], orders), daemon=True).start()
    while True:
        signal.pause()
