"""Flying through the gates of the map, in order, as they become known."""

import asyncio
import math
from dataclasses import replace

import numpy as np

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.behaviors.motion import ARRIVED, new_serial
from flightapp.channel import Reader
from flightapp.frames import Vector
from flightapp.messages import Event, GateEstimate, Outcome, VehicleState
from flightapp.planning.course import is_known
from flightapp.planning.goal import Goal
from flightapp.planning.passage import crossing
from flightapp.planning.scan import heading, yaw_scan

MISS = 2.0
"""Openings from a gate's centre within which a crossing of its plane counts as a miss, not as passing by."""


WATCH_INTERVAL = 0.02
"""s between looks at the progress; a crossing between two looks is still seen where it was."""


class Race(Behavior):
    """Pass every gate in order for a number of laps, then come to rest at the finish."""

    name = "race"

    def __init__(self, context: Context, laps: int, finish: Vector) -> None:
        super().__init__(context, context.config.race.timeout)
        ids = tuple(gate.id for gate in context.track.gates) * laps
        self._goal = Goal(finish, context.limits, ids, serial=new_serial())
        self._searching_since: float | None = None
        self._scan_half_width = math.radians(context.config.race.search_yaw_deg)

    async def run(self) -> Result:
        """Publish the goal; watch gates go by; look around where the next one has not been seen."""
        bus, line = self.context.bus, self.context.line
        bus.goal.publish(self._goal)
        reader = Reader(bus.state)
        before = await reader.newest()
        while True:
            await asyncio.sleep(WATCH_INTERVAL)
            state = await reader.newest()
            gate = self._next_gate()
            if gate is not None:
                if failure := self._watch_gate(gate, before, state):
                    return failure
                if failure := self._search(gate, state):
                    return failure
            elif line.latest is not None and state.stamp > line.latest.end_stamp:
                miss = float(np.linalg.norm(state.position - self._goal.end))
                if miss < ARRIVED:
                    return Result(Outcome.GOAL_ACHIEVED, f"{self._goal.passed} gates passed, at the finish")
                if state.stamp > line.latest.end_stamp + 5.0:
                    return Result(Outcome.WRONG_PROGRESS, f"stopped {miss:.2f} m from the finish")
            before = state

    def _next_gate(self) -> GateEstimate | None:
        gate_map = self.context.bus.gate_map.latest
        if gate_map is None or self._goal.passed >= len(self._goal.gate_ids):
            return None
        wanted = self._goal.gate_ids[self._goal.passed]
        return next(gate for gate in gate_map.gates if gate.gate_id == wanted)

    def _watch_gate(self, gate: GateEstimate, before: VehicleState, state: VehicleState) -> Result | None:
        crossed = crossing(before.position, state.position, gate)
        if crossed is None:
            return None
        opening = self.context.track.gate.opening
        if crossed.offset <= 0.5 * opening:
            self._goal = replace(self._goal, passed=self._goal.passed + 1)
            self.context.bus.goal.publish(self._goal)
            text = f"gate {gate.gate_id} passed, {crossed.offset:.2f} m from its centre by the estimate"
            self.context.bus.event.publish(Event(state.stamp, "gate", text))
        elif crossed.offset <= MISS * opening and is_known(gate, self.context.config.mapping.known_sigma):
            reason = f"gate {gate.gate_id} missed by {crossed.offset:.2f} m"
            return Result(Outcome.WRONG_PROGRESS, reason)
        return None

    def _search(self, gate: GateEstimate, state: VehicleState) -> Result | None:
        """Scan for ``gate`` once the line has ended without its having been seen."""
        config, line = self.context.config, self.context.line
        if is_known(gate, config.mapping.known_sigma):
            self._searching_since = None
            return None
        now = self.context.now()
        if not line.at_rest(now):
            return None
        if self._searching_since is None:
            self._searching_since = state.stamp
        if state.stamp > self._searching_since + config.race.search_timeout:
            text = f"gate {gate.gate_id} was not found within {config.race.search_timeout:g} s"
            return Result(Outcome.WRONG_PROGRESS, text)
        at = line.motion(now)
        turn = math.remainder(heading(at.position, gate.position) - at.yaw, 2.0 * math.pi)
        rate = config.vehicle.yaw_rate_max / 3.0
        scan = yaw_scan(now, at.position, at.yaw, at.yaw + turn, self._scan_half_width, rate)
        line.accept(scan)
        self.context.bus.trajectory.publish(scan)
        self._scan_half_width = min(1.5 * self._scan_half_width, math.pi)
        return None
