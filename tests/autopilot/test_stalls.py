"""When the sender stalls or dies its stream ends, and it does not come back with anything stale.

A process of its own commands a vehicle through the real link, guard and control task at 250 Hz; the vehicle's end of
the link judges it by when setpoints arrive.
"""

import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import mavlink_peer as px4
import numpy as np
import pytest

pytestmark = pytest.mark.wall_clock

SENDER = Path(__file__).with_name("stalling_sender.py")
END = 0.3
"""s within which the stream must have ended."""
PATIENCE = 30.0
"""s until the sender must have said what it has to say."""


class Vehicle(px4.Peer):
    """Hovers in OFFBOARD, and like PX4 leaves it for landing 0.5 s after the last setpoint."""

    LOSS = 0.5

    def __init__(self, port, fails_safe):
        self.arrivals, self.landing_at = [], None
        self.at_next_arrival = lambda: None
        self._fails_safe = fails_safe
        super().__init__(port)
        self.mode, self.armed = px4.OFFBOARD, True

    def heartbeat(self):
        if self._fails_safe and self.arrivals and time.monotonic() > self.arrivals[-1] + self.LOSS:
            self.landing_at = self.landing_at or time.monotonic()
            self.mode = px4.LAND
        super().heartbeat()
        self.send(px4.mavlink.MAVLink_extended_sys_state_message(0, 2))

    def _answer(self, message):
        if message.get_type() == "SET_ATTITUDE_TARGET":
            self.arrivals.append(time.monotonic())
            act, self.at_next_arrival = self.at_next_arrival, lambda: None
            act()
        else:
            super()._answer(message)

    def since(self, stamp):
        """Arrivals of setpoints after ``stamp``, s after it."""
        return [at - stamp for at in list(self.arrivals) if at > stamp]


class Sender:
    """The program, flying."""

    def __init__(self, how, fails_safe=True):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.vehicle = Vehicle(port, fails_safe)
        command = [sys.executable, str(SENDER), str(port), how]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._lines = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        with ExitStack() as failed:
            failed.callback(self.__exit__)
            self.expect("flying")
            time.sleep(0.5)
            assert np.median(np.diff(self.vehicle.arrivals[-50:])) < 0.008, "it sends at 250 Hz"
            failed.pop_all()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self._reader.join()
        self.process.stdout.close()
        self.vehicle.close()

    def _read(self):
        for line in self.process.stdout:
            self._lines.put(line)

    def expect(self, word):
        """The words of the next line, which must begin with ``word``."""
        words = self._lines.get(timeout=PATIENCE).split()
        assert words[:1] == [word], words
        return words[1:]

    def signal(self, number):
        """Send it, and the time of that."""
        now = time.monotonic()
        os.kill(self.process.pid, number)
        return now

    def stop_between_commands(self):
        """Stop the process while no command is on its way, and the time of that."""
        self.vehicle.at_next_arrival = lambda: self.signal(signal.SIGSTOP)
        time.sleep(0.1)
        return self.vehicle.arrivals[-1]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_stream_ends_with_a_process_that_is_killed_or_stopped(number):
    with Sender("0") as sender:
        began = sender.signal(number)
        time.sleep(1.0)
        assert max(sender.vehicle.since(began), default=0.0) < END
        assert sender.vehicle.mode == px4.LAND


def test_the_stream_ends_with_the_thread_of_the_event_loop():
    with Sender("dies") as sender:
        sender.signal(signal.SIGUSR1)
        (died,) = map(float, sender.expect("died"))
        time.sleep(1.0)
        assert max(sender.vehicle.since(died), default=0.0) < END
        assert sender.vehicle.mode == px4.LAND
        assert sender.process.poll() is None, "the other threads live on"


def test_the_stream_ends_while_the_interpreter_is_held_and_the_landing_is_not_disturbed():
    with Sender("2.0") as sender:
        sender.signal(signal.SIGUSR1)
        began, ended = map(float, sender.expect("stalled"))
        time.sleep(1.0)
        assert ended - began > 1.99
        assert max(sender.vehicle.since(began), default=0.0) < END
        assert sender.vehicle.landing_at < ended
        assert "the sender stalled" in " ".join(sender.expect("fault"))


def test_a_process_that_wakes_does_not_take_what_piled_up_meanwhile_for_news():
    with Sender("0") as sender:
        began = sender.stop_between_commands()
        time.sleep(2.0)
        sender.signal(signal.SIGCONT)
        time.sleep(1.0)
        assert max(sender.vehicle.since(began), default=0.0) < END
        assert "the sender stalled" in " ".join(sender.expect("fault"))


def test_after_a_short_stall_nothing_is_sent_before_the_vehicle_is_heard_anew():
    with Sender("0.4", fails_safe=False) as sender:
        vehicle = sender.vehicle
        vehicle.silent = True
        sender.signal(signal.SIGUSR1)
        _, ended = map(float, sender.expect("stalled"))
        time.sleep(0.06)
        spoke = time.monotonic()  # whatever it says first, be it an answer to the link's question for its time
        vehicle.silent = False
        time.sleep(1.0)
        resumed = ended + min(vehicle.since(ended))
        assert 0.0 < resumed - spoke < 0.15
        assert len(vehicle.since(ended + 0.5)) > 100, "it flies on"


def test_after_a_stall_a_silent_vehicle_gets_nothing_any_more():
    with Sender("0.4") as sender:
        vehicle = sender.vehicle
        sender.signal(signal.SIGUSR1)
        vehicle.silent = True
        began, _ = map(float, sender.expect("stalled"))
        time.sleep(1.0)
        vehicle.silent = False
        time.sleep(0.5)
        assert max(vehicle.since(began), default=0.0) < END
        assert "no sound command for too long" in " ".join(sender.expect("fault"))
