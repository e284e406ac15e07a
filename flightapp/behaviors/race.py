"""Flying through the gates of the map, in order, as they become known."""

import asyncio
from dataclasses import replace

import numpy as np
from pydantic import Field

from flightapp.behaviors.base import Context, Parameters, Result
from flightapp.behaviors.motion import ARRIVED, PATIENCE, Flying, new_serial
from flightapp.behaviors.search import Search, fly_to, located, room
from flightapp.channel import Reader
from flightapp.config.fields import Triple
from flightapp.frames import Vector
from flightapp.messages import Event, GateEstimate, Outcome, VehicleState
from flightapp.planning.course import is_known
from flightapp.planning.goal import Goal
from flightapp.planning.passage import crossing, in_gate
from flightapp.planning.search import way_round
from flightapp.safety.faults import Fault, FaultKind

MISS = 2.0
"""Openings from a gate's centre within which a crossing of its plane counts as a miss, not as passing by."""
WATCH_INTERVAL = 0.02
"""s between looks at the progress; a crossing between two looks is still seen where it was."""
SETTLED = 0.5
"""s at rest, after which a gate that is not known is searched for."""
STUCK = 3.0
"""s at rest before a known gate, after which it is flown at from its front."""
SHIFT = 0.5
"""m by which a gate may move in the map between two looks; beyond it the vehicle has crossed nothing."""
RUN_UP = 3.0
"""m before a gate from where it is flown at again."""


class RaceParameters(Parameters):
    """How often round, and to where."""

    laps: int | None = Field(None, ge=1, le=1000, description="default: mission.laps")
    finish: Triple | None = Field(None, description="m, world; default: the track's, or where the race starts")


class Race(Flying[RaceParameters]):
    """Pass every gate in order for a number of laps, then come to rest at the finish.

    A gate that isn't known is searched for. One that was missed is flown at again, ``race.attempts`` times in all.
    """

    name = "race"
    accepts = RaceParameters
    fresh = ("state", "camera")

    def __init__(self, context: Context, **parameters: object) -> None:
        super().__init__(context, **parameters)
        laps = self.parameters.laps or context.config.mission.laps
        ids = tuple(gate.id for gate in context.track.passage) * laps
        self._goal = Goal(self.destination, context.limits, ids)
        self._begun = False
        self._ahead: float | None = None
        self._approach: tuple[int, Vector] | None = None
        self._attempts = 1
        self._searched = 0.0
        self._resting_since: float | None = None

    @property
    def progress(self) -> float:
        """Of the gates."""
        return self._goal.passed / max(len(self._goal.gate_ids), 1)

    @property
    def destination(self) -> Vector:
        """The finish."""
        if (finish := self.parameters.finish or self.context.track.finish) is not None:
            return np.array(finish)
        state = self.context.bus.state.latest
        return np.array(self.context.track.start.position) if state is None else state.position.copy()

    async def run(self) -> Result:
        """Publish the goal; watch gates go by; look around where the next one has not been seen."""
        bus = self.context.bus
        if not self._begun:
            self._begun, self._goal = True, replace(self._goal, end=self.destination)
        self._resume()
        reader = Reader(bus.state)
        before = await reader.newest()
        while True:
            await asyncio.sleep(WATCH_INTERVAL)
            state = await reader.newest()
            if self._goal.passed < len(self._goal.gate_ids):
                turned = await self._progress(self._goal.gate_ids[self._goal.passed], before, state)
                if isinstance(turned, Result):
                    return turned
                if turned:
                    state = await reader.newest()
            elif arrival := self._arrival(state):
                return arrival
            before = state

    def _arrival(self, state: VehicleState) -> Result | None:
        latest = self.context.line.latest
        if latest is None or state.stamp <= latest.end_stamp:
            return None
        miss = float(np.linalg.norm(state.position - self._goal.end))
        if miss < ARRIVED:
            return Result(Outcome.GOAL_ACHIEVED, f"{self._goal.passed} gates passed, at the finish")
        if state.stamp > latest.end_stamp + PATIENCE:
            return Result(Outcome.WRONG_PROGRESS, f"stopped {miss:.2f} m from the finish")
        return None

    async def _progress(self, gate_id: int, before: VehicleState, state: VehicleState) -> Result | bool:
        """See to the next gate: how the race ends, or whether something else than flying on was done meanwhile."""
        gate = located(self.context, gate_id)
        known = gate is not None and is_known(gate, self.context.config.mapping.known_sigma)
        if gate is not None:
            offset = self._crossed(gate, before, state)
            if offset is not None and known:
                return await self._again(gate, f"gate {gate_id} missed by {offset:.2f} m")
        resting = self._resting()
        if gate is not None and known:
            return resting > STUCK and await self._again(gate, f"no way led to gate {gate_id}")
        return resting > SETTLED and await self._search(gate_id, state)

    def _resting(self) -> float:
        """For how long (s) the line has been over."""
        now = self.context.now()
        if not self.context.line.at_rest(now):
            self._resting_since = None
            return 0.0
        self._resting_since = now if self._resting_since is None else self._resting_since
        return now - self._resting_since

    def _crossed(self, gate: GateEstimate, before: VehicleState, state: VehicleState) -> float | None:
        """Count ``gate`` when it was passed; how far (m) from its centre when its plane was crossed beside it."""
        here, last = in_gate(state.position, gate), self._approach
        self._approach = gate.gate_id, here
        if last is None or last[0] != gate.gate_id:
            return None
        flown = float(np.linalg.norm(state.position - before.position))
        if float(np.linalg.norm(here - last[1])) > flown + SHIFT:
            return None
        crossed = crossing(last[1], here)
        if crossed is None:
            return None
        opening = self.context.track.gate.opening
        if crossed.offset > 0.5 * opening:
            return crossed.offset if crossed.offset <= MISS * opening else None
        self._goal = replace(self._goal, passed=self._goal.passed + 1)
        self._ahead, self._attempts, self._searched = gate.yaw, 1, 0.0
        self.context.bus.goal.publish(self._goal)
        text = f"gate {gate.gate_id} passed, {crossed.offset:.2f} m from its centre by the estimate"
        self.context.bus.event.publish(Event(state.stamp, "gate", text))
        return None

    async def _again(self, gate: GateEstimate, why: str) -> Result | bool:
        """Fly round to the front of ``gate``, to fly at it once more; how the race ends after the last attempt."""
        context = self.context
        context.bus.fault.publish(Fault(context.now(), FaultKind.GATE_MISSED, why))
        if self._attempts >= context.config.race.attempts:
            return Result(Outcome.WRONG_PROGRESS, why)
        self._attempts += 1
        self._tell(f"{why}; flown at again from its front")
        state = context.bus.state.latest
        position = gate.position if state is None else state.position
        way = way_round(position, gate, context.track.gate, RUN_UP, room(context))
        await fly_to(context, way, context.limits, lambda: False)
        context.bus.fault.publish(Fault(context.now(), FaultKind.GATE_MISSED, why, over=True))
        self._resume()
        return True

    async def _search(self, gate_id: int, state: VehicleState) -> Result | bool:
        """Search for the next gate; how the race ends where it isn't found in time."""
        begun, allowed = self.context.now(), self.context.config.race.search_timeout
        left = allowed - self._searched
        ahead = self.context.line.motion(begun).yaw if self._ahead is None else self._ahead
        if left <= 0.0:
            return self._not_found(f"gate {gate_id} was not found within {allowed:g} s")
        self._tell(f"gate {gate_id} is searched for")
        result = await Search(self.context, gate_id=gate_id, ahead=ahead, seconds=left).run()
        self._searched += self.context.now() - begun
        if not result.achieved:
            return self._not_found(result.reason)
        self._tell(result.reason)
        self._resume()
        return True

    def _not_found(self, why: str) -> Result:
        self.context.bus.fault.publish(Fault(self.context.now(), FaultKind.GATE_NOT_FOUND, why))
        return Result(Outcome.WRONG_PROGRESS, why)

    def _resume(self) -> None:
        """Go on with the race from wherever the vehicle is now."""
        self._goal = replace(self._goal, serial=new_serial())
        self.context.bus.goal.publish(self._goal)
        self._resting_since = None

    def _tell(self, text: str) -> None:
        self.context.bus.event.publish(Event(self.context.now(), "gate", text))
