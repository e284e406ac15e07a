"""An autopilot that obeys at once, and a context around it, in virtual time."""

import asyncio
from dataclasses import replace

import numpy as np

from flightapp.behaviors.base import Context
from flightapp.bus import Bus
from flightapp.channel import Topic
from flightapp.config import load_config
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus, FlightMode, Frame, RateCommand, VehicleState
from flightapp.mission.machine import MissionMachine
from flightapp.planning.line import Line
from flightapp.track import Gate, Start, Track
from sim.clock import VirtualLoop

TRACK = Track(
    name="test",
    start=Start(position=(0.0, 0.0, 0.0)),
    gates=(
        Gate(id=1, position=(8.0, 0.0, 1.5), yaw_deg=0.0, markers=(1, 2, 3, 4)),
        Gate(id=2, position=(16.0, 0.0, 1.5), yaw_deg=0.0, markers=(5, 6, 7, 8)),
    ),
    finish=(24.0, 0.0, 1.5),
)


def virtually(coroutine):
    """Run ``coroutine`` on a virtual clock."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(coroutine)


class FakeAutopilot:
    """Climbs in two seconds, lands in three; ``refuse`` makes one call fail."""

    def __init__(self, refuse=""):
        self.status = Topic("status")
        self.imu = Topic("imu")
        self.calls = []
        self.sent = []
        self.poses = []
        self.refuse = refuse
        self._set(stamp=0.0, mode=FlightMode.HOLD, armed=False, landed=True, ready=True, voltage=16.0, battery=1.0)

    def _set(self, **changes):
        latest = self.status.latest
        self.status.publish(replace(latest, **changes) if latest else AutopilotStatus(**changes))

    def _later(self, seconds, while_in, **changes):
        """Do ``changes`` after some time, if it is in the mode ``while_in`` then."""

        def do():
            if self.status.latest.mode is while_in:
                self._set(**changes)

        asyncio.get_running_loop().call_later(seconds, do)

    def _called(self, name):
        self.calls.append(name)
        if name == self.refuse:
            raise AutopilotError(f"{name} refused: test")

    async def connect(self):
        self._called("connect")

    async def takeoff(self, height):
        self._called("takeoff")
        self._set(mode=FlightMode.TAKEOFF)

    async def arm(self):
        self._called("arm")
        self._set(armed=True, landed=False)
        self._later(2.0, FlightMode.TAKEOFF, mode=FlightMode.HOLD)

    async def disarm(self):
        self._called("disarm")
        self._set(armed=False)

    async def kill(self):
        self._called("kill")
        self._set(armed=False)

    async def hold(self):
        self._called("hold")
        self._set(mode=FlightMode.HOLD)

    async def start_offboard(self):
        self._called("start_offboard")
        self._set(mode=FlightMode.OFFBOARD)

    async def land(self):
        self._called("land")
        self._set(mode=FlightMode.LAND)
        self._later(3.0, FlightMode.LAND, armed=False, landed=True)

    def send(self, command):
        self.sent.append(command)

    def send_pose(self, sample):
        self.poses.append(sample)

    async def close(self):
        self._called("close")


def state(stamp, position=(0.0, 0.0, 1.5)):
    """A state at rest."""
    return VehicleState(
        stamp, np.array(position), np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3), np.zeros(3), 1e-4 * np.eye(9)
    )


def make_context(autopilot, track=TRACK, **settings):
    """A context with a fresh bus; ``settings`` as in a mission, with _ for the dot's section first."""
    bus = Bus()
    config = load_config(None, {key.replace("__", "."): value for key, value in settings.items()})
    machine = MissionMachine(bus.phase, bus.event)
    return Context(bus, config, autopilot, Line(), machine, track, lambda: None)


async def stream_states(context, position=lambda t: (0.0, 0.0, 1.5), rate=100.0):
    """Publish states, empty images, and commands as if a controller ran, for ever."""
    loop = asyncio.get_running_loop()
    while True:
        context.bus.frame.publish(Frame(loop.time(), context.bus.frame.count, None))
        context.bus.state.publish(state(loop.time(), position(loop.time())))
        if context.line.at(loop.time()) is not None:
            context.bus.command.publish(RateCommand(loop.time(), np.zeros(3), 9.8))
        await asyncio.sleep(1.0 / rate)
