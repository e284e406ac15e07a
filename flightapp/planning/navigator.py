"""Decides when to plan anew and from what: the pure part of the planning task."""

import math

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import PlanRequest
from flightapp.messages import GateEstimate, GateMap
from flightapp.planning.course import Course, course, is_known
from flightapp.planning.goal import Goal
from flightapp.planning.line import Line
from flightapp.trajectory import Trajectory

LEAD_MARGIN = 1.5
"""Share of the time that a plan took, after which the next may begin."""
LEAD_MAX = 1.0
"""s"""
FROZEN = 0.45
"""s before a gate in which it is flown through as planned: a new plan could only meet it with a detour."""


class Navigator:
    """Turns a goal and a gate map into requests for the planner, and only when the plan has to change."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._serial = -1
        self._planned: tuple[GateEstimate, ...] = ()
        self._end: Vector | None = None
        self._asked = -math.inf
        self._lead = config.planning.lead
        self.waiting_for: GateEstimate | None = None

    def request(self, now: float, goal: Goal, gate_map: GateMap | None, line: Line) -> PlanRequest | None:
        """What to plan at ``now``; None while the line that is being flown will do."""
        fresh = goal.serial != self._serial
        if not fresh and (goal.waypoints is not None or now < self._asked + self._config.planning.replan_interval):
            return None
        stamp = now + self._lead
        if not fresh and self._gate_is_near(line.latest, stamp):
            return None
        start = line.motion(stamp)
        leg = self._course(goal, gate_map, line.latest, stamp, start.position)
        self.waiting_for = leg.waiting_for
        if not fresh and not self._changed(leg):
            return None
        look_at = leg.following.position if leg.following else None
        self._asked = now
        return PlanRequest(stamp, start, leg.gates, leg.end, goal.limits, look_at)

    def accepted(self, goal: Goal, request: PlanRequest) -> None:
        """``request`` has become the line being flown."""
        self._serial = goal.serial
        self._planned = request.gates
        self._end = request.end

    def took(self, elapsed: float) -> None:
        """Planning took ``elapsed`` s: the next plan begins late enough to be there in time, if need be."""
        self._lead = max(self._config.planning.lead, min(LEAD_MARGIN * elapsed, LEAD_MAX))

    def _course(
        self, goal: Goal, gate_map: GateMap | None, flown: Trajectory | None, stamp: float, origin: Vector
    ) -> Course:
        if not goal.gate_ids or gate_map is None:
            return Course((), goal.end, None)
        by_id = {gate.gate_id: gate for gate in gate_map.gates}
        ahead = [by_id[gate_id] for gate_id in goal.gate_ids[self._passed(goal, flown, stamp) :]]
        race = self._config.race
        horizon = self._config.planning.horizon
        return course(ahead, origin, goal.end, self._config.mapping.known_sigma, race.standoff, horizon)

    def known(self, gate_map: GateMap | None) -> tuple[GateEstimate, ...]:
        """The gates whose frames a plan must keep clear of."""
        if gate_map is None:
            return ()
        return tuple(gate for gate in gate_map.gates if is_known(gate, self._config.mapping.known_sigma))

    def _gate_is_near(self, flown: Trajectory | None, stamp: float) -> bool:
        if flown is None:
            return False
        return any(stamp < flown.stamp + time <= stamp + FROZEN for time in flown.gate_times)

    def _passed(self, goal: Goal, flown: Trajectory | None, stamp: float) -> int:
        """How many gates will be behind at ``stamp`` by the plan."""
        passed = goal.passed
        if flown is None or goal.serial != self._serial:
            return passed
        crossed = [
            gate_id
            for gate_id, time in zip(flown.gate_ids, flown.gate_times, strict=True)
            if flown.stamp + time <= stamp
        ]
        while passed < len(goal.gate_ids) and goal.gate_ids[passed] in crossed:
            crossed = crossed[crossed.index(goal.gate_ids[passed]) + 1 :]
            passed += 1
        return passed

    def _changed(self, leg: Course) -> bool:
        limit = self._config.planning.replan_distance
        if _moved(leg.end, self._end, limit if leg.following is None else 10.0 * limit):
            return True
        tail = self._planned[len(self._planned) - len(leg.gates) :]
        if [gate.gate_id for gate in tail] != [gate.gate_id for gate in leg.gates]:
            return True
        return any(_moved(new.position, old.position, limit) for new, old in zip(leg.gates, tail, strict=True))


def _moved(new: Vector, old: Vector | None, limit: float) -> bool:
    return old is None or float(np.max(np.abs(new - old))) > limit
