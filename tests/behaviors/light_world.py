"""A world that costs little: real planning, guard, coordinator and missions, and a vehicle that is where its line is.

For many flights in which what matters is who commands when, not how well it flies.
"""

import asyncio
import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from fakes import TRACK, FakeAutopilot, make_context, state, virtually

from flightapp import tasks
from flightapp.autopilot.guard import CommandGuard
from flightapp.behaviors.coordinator import Coordinator
from flightapp.messages import Drift, FlightMode, Frame, GateEstimate, GateMap, Phase, RateCommand
from flightapp.planning.navigator import Navigator
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.safety.monitor import Monitor
from flightapp.safety.watch import Watch
from flightapp.timing import Ticker
from flightapp.trajectory import hover
from sim.rig import ModelledWorker

GROUND = np.array((0.0, 0.0, 0.0))
SETTINGS = {"control__rate": 50.0, "planning__screen": False}


class LightController:
    """Asks for nothing but a hover, since nothing flies by its commands."""

    push, report = 0.0, ""

    def command(self, stamp, state, trajectory):
        """Level, at rest."""
        return RateCommand(stamp, np.zeros(3), 9.8)

    def reset(self):
        """Nothing."""


class LightWorld:
    """Everything between a mission and its vehicle. What happens to it is set by its attributes."""

    def __init__(self, autopilot=None, track=TRACK, **settings):
        self.autopilot = autopilot or FakeAutopilot()
        self.context = make_context(self.autopilot, track, **(SETTINGS | settings))
        self.guard = CommandGuard(self.context.config)
        self.context = replace(self.context, release_guard=self.guard.release)
        self.navigator = Navigator(self.context.config, track)
        self.caution = self.navigator.caution
        self.push = np.zeros(3)
        """m, by which it is off its line."""
        self.silent = False
        """No state comes."""
        self.stuck = None
        """(3,) m, where it stays whatever the line is; None: it follows."""
        self.gates = known_gates(track)
        self.sent = []
        self.place = GROUND.copy()
        self.autopilot.send = self._send

    def _send(self, command):
        status = self.autopilot.status.latest
        self.sent.append((self.context.now(), status.mode, status.armed))

    def fly(self, main):
        """What ``main(coordinator)`` returns in this world."""

        async def run():
            work = [asyncio.create_task(one) for one in self.work()]
            await asyncio.sleep(0.1)
            try:
                return await main(Coordinator(self.context))
            finally:
                for task in work:
                    task.cancel()
                await asyncio.gather(*work, return_exceptions=True)

        return virtually(run())

    def work(self):
        """The coroutines that keep it going."""
        config, context = self.context.config, self.context
        modules = SimpleNamespace(
            navigator=self.navigator,
            planner=PolynomialPlanner(config),
            controller=LightController(),
            guard=self.guard,
        )
        rig, ticker = (
            SimpleNamespace(worker=ModelledWorker(config), autopilot=self.autopilot),
            Ticker(config.control.rate),
        )
        computer = SimpleNamespace(disk_free=lambda _: math.inf, clock_offset=lambda: 0.0)
        line, rate = context.line, config.control.rate
        watch = Watch(context.bus, self.autopilot, line, computer, ticker, rate, Path(), lambda: "", context.now())
        return [
            self._states(),
            self._statuses(),
            tasks.planning(rig, context.bus, modules, config, line),
            tasks.control(rig, context.bus, modules, line, ticker),
            tasks.health(context.bus, watch, Monitor(config, bool(context.track.passage))),
        ]

    def airborne(self, place=(0.0, 0.0, 1.5)):
        """Have it hover at ``place`` under our command."""
        for phase in (Phase.PREFLIGHT, Phase.ARMED, Phase.TAKEOFF, Phase.FLYING):
            self.context.machine.go(phase, 0.0, "test")
        self.place = np.array(place)
        self.context.line.accept(hover(0.0, self.place, 0.0))
        self.autopilot._set(armed=True, landed=False, mode=FlightMode.OFFBOARD)
        return self

    async def _states(self):
        context, bus = self.context, self.context.bus
        while True:
            now = context.now()
            self._move(now)
            bus.frame.publish(Frame(now, bus.frame.count, None))
            bus.gate_map.publish(GateMap(now, 1, self.gates, Drift(now, np.zeros(3), 0.0, np.zeros((4, 4)))))
            if not self.silent:
                bus.state.publish(state(now, tuple(self.place)))
            await asyncio.sleep(0.02)

    def _move(self, now):
        status, line = self.autopilot.status.latest, self.context.line
        if self.stuck is not None:
            self.place = np.array(self.stuck)
        elif line.latest is not None:
            self.place = line.motion(now).position + self.push
        elif status.mode == "takeoff" and status.armed:
            self.place = self.place + np.array((0.0, 0.0, 0.02))
        elif status.mode in ("land", "descend"):
            self.place = np.maximum(self.place - (0.0, 0.0, 0.02), (-np.inf, -np.inf, 0.0))

    async def _statuses(self):
        while True:
            self.autopilot._set(stamp=self.context.now())
            await asyncio.sleep(0.05)


def known_gates(track):
    """The gates of ``track``, known well."""
    P = np.diag((0.05**2, 0.05**2, 0.05**2, 0.01))
    return tuple(GateEstimate(g.id, np.array(g.position), g.yaw, P, 10, 0.0) for g in track.gates)


async def after(seconds, do):
    """Call ``do`` after some time."""
    await asyncio.sleep(seconds)
    with suppress(asyncio.CancelledError):
        do()
