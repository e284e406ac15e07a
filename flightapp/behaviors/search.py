"""Looking for a gate: all round on the spot, then from places further and further away."""

import asyncio
import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from pydantic import Field

from flightapp.behaviors.base import Context, Parameters, Result
from flightapp.behaviors.motion import ARRIVED, Flying, new_serial
from flightapp.config.fields import Finite
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.interfaces import Limits, PlanningError
from flightapp.messages import GateEstimate, Outcome
from flightapp.planning.course import is_known
from flightapp.planning.goal import Goal
from flightapp.planning.scan import around, heading, turn_rate, turns
from flightapp.planning.search import Room, front, viewpoints

WATCH_INTERVAL = 0.02
"""s between looks at the map."""
REFUSALS = 3
"""Plans that are refused before a place counts as out of reach."""
FINER = (1.0, 0.6, 0.4)
"""Shares of ``race.search_step`` between the places of a search, the first time and when that was no use."""
STANDING = 3.0
"""s at rest without a plan after which it does."""


def located(context: Context, gate_id: int) -> GateEstimate | None:
    """What the map says of a gate; None where that is nothing."""
    gate_map = context.bus.gate_map.latest
    gates = gate_map.gates if gate_map else ()
    return next((gate for gate in gates if gate.gate_id == gate_id), None)


def room(context: Context) -> Room:
    """Where there is room to fly, as far as is known now."""
    gate_map = context.bus.gate_map.latest
    return Room.of(context.config, context.track, gate_map.gates if gate_map else ())


async def fly_to(context: Context, waypoints: Vector, limits: Limits, stop: Callable[[], bool]) -> bool:
    """Fly through ``waypoints`` (n, 3) to rest at the last, or until ``stop()``; False where no plan leads there."""
    bus, line = context.bus, context.line
    refused, end = 0, waypoints[-1]
    reports, standing = bus.plan.count, context.now()
    bus.goal.publish(Goal(end, limits, waypoints=waypoints, serial=new_serial()))
    while not stop():
        await asyncio.sleep(WATCH_INTERVAL)
        now = context.now()
        if line.latest is None:
            return False
        if not line.at_rest(now):
            standing = now
        elif float(np.linalg.norm(line.motion(now).position - end)) < ARRIVED:
            return True
        if bus.plan.count > reports and bus.plan.latest is not None:
            reports = bus.plan.count
            refused += not bus.plan.latest.accepted
        if refused >= REFUSALS or now > standing + STANDING:
            return False
    return True


class SearchParameters(Parameters):
    """For which gate, and how."""

    gate_id: int = Field(description="one of the track's")
    ahead: Finite | None = Field(None, description="rad, where to look first; default: ahead")
    seconds: Finite | None = Field(None, ge=0.0, le=3600.0, description="s; default: race.search_timeout")


class Search(Flying[SearchParameters]):
    """Look for a gate until it is known well enough to be flown at; one that was nowhere yet, until it appears.

    First all round on the spot, beginning in the direction ``ahead`` (rad); then from a widening pattern of places
    within the geofence, around the spot, or around the gate's front where there is an idea of where it is. Ends with
    WRONG_PROGRESS after ``seconds``, or when there is no place left.
    """

    name = "search"
    accepts = SearchParameters
    fresh = ("state", "camera")

    def __init__(self, context: Context, **parameters: object) -> None:
        super().__init__(context, **parameters)
        asked, known = self.parameters, sorted({gate.id for gate in context.track.passage})
        if asked.gate_id not in known:
            gates = f"its gates are {', '.join(map(str, known))}" if known else "it has none"
            raise BadInputError(f"behavior search: the track has no gate {asked.gate_id}; {gates}")
        own = context.config.race.search_timeout
        self._gate_id, self._seconds = asked.gate_id, own if asked.seconds is None else asked.seconds
        self._ahead = 0.0 if asked.ahead is None else asked.ahead
        self._unheard_of = located(context, asked.gate_id) is None
        self._begun, self._expires = math.nan, math.inf

    @property
    def progress(self) -> float:
        """Of the time."""
        begun = self._begun
        return (self.context.now() - begun) / max(self._seconds, 1e-3) if math.isfinite(begun) else 0.0

    async def run(self) -> Result:
        """Look, and fly on to where to look from next."""
        begun = self.context.now()
        if not math.isfinite(self._begun):
            self._begun, self._expires = begun, begun + self._seconds
            if self.parameters.ahead is None:
                self._ahead = self.context.line.motion(begun).yaw
        race = self.context.config.race
        limits = replace(self.context.limits, v_max=min(race.search_speed, race.v_max))
        await self._look()
        for place in self._places():
            if self._over():
                break
            if await fly_to(self.context, place[None], limits, self._over):
                await self._look()
        took = self.context.now() - self._begun
        if self._found():
            return Result(Outcome.GOAL_ACHIEVED, f"gate {self._gate_id} found after {took:.1f} s")
        return Result(Outcome.WRONG_PROGRESS, f"gate {self._gate_id} was not found within {took:.0f} s")

    def _found(self) -> bool:
        gate = located(self.context, self._gate_id)
        return gate is not None and (self._unheard_of or is_known(gate, self.context.config.mapping.known_sigma))

    def _over(self) -> bool:
        return self._found() or self.context.now() > self._expires or self.context.line.latest is None

    def _places(self) -> Iterator[Vector]:
        """Where to look from, by and by."""
        context = self.context
        gate, free, race = located(context, self._gate_id), room(context), context.config.race
        middle, ahead = context.line.motion(context.now()).position, self._ahead
        if gate is not None:
            middle, ahead = front(gate, race.standoff, free), gate.yaw
            yield middle
        for share in FINER:
            yield from viewpoints(middle, ahead, share * race.search_step, free)

    async def _look(self) -> None:
        """Turn round on the spot, until the gate is found."""
        context, line = self.context, self.context.line
        await self._rest()
        if self._over():
            return
        now, config = context.now(), context.config
        at, gate = line.motion(now), located(context, self._gate_id)
        ahead = heading(at.position, gate.position) if gate is not None else self._ahead
        yaws = around(at.yaw, ahead, math.radians(config.race.search_yaw_deg))
        scan = turns(now, at.position, yaws, turn_rate(config))
        try:
            line.accept(scan)
        except PlanningError:
            return
        context.bus.trajectory.publish(scan)
        await self._rest()

    async def _rest(self) -> None:
        """Until the line is over or the search is."""
        while True:
            if self._over() or self.context.line.at_rest(self.context.now()):
                return
            await asyncio.sleep(WATCH_INTERVAL)
