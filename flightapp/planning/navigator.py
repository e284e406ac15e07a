"""Decides when to plan anew, from what, and at which pace: the pure part of the planning task."""

import math

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import PlanRequest
from flightapp.messages import GateEstimate, GateMap
from flightapp.planning.caution import Caution
from flightapp.planning.course import Course, course, is_known
from flightapp.planning.goal import Goal
from flightapp.planning.line import Line
from flightapp.planning.pacer import Paced, Pacer
from flightapp.track import Track
from flightapp.trajectory import Trajectory

LEAD_MARGIN = 1.5
"""Share of the time that a plan took, after which the next may begin."""
LEAD_MAX = 2.0
"""s"""
FROZEN = 0.25
"""s before a gate in which it is flown through as planned: a new plan could only meet it with a detour."""
DETOUR = 0.3
"""s by which a new plan may be later at the next gate: one that still meets it is hardly late, one that flies a loop to
meet it is late by more than a second."""
SCREENING = 0.01
"""s that must be left before a plan's start for a forward simulation of it."""
PACE_LEAD = 0.03
"""s from the decision to change the pace to the takeover."""


class Navigator:
    """Turns a goal and a gate map into requests for the planner, and only when the plan has to change."""

    def __init__(self, config: Config, track: Track) -> None:
        self._config = config
        self._shape, self._obstacles = track.gate, track.obstacles
        self._serial = -1
        self._planned: tuple[GateEstimate, ...] = ()
        self._end: Vector | None = None
        self._asked, self._asked_serial = -math.inf, -1
        self._asked_behind = self._behind = 0
        self._lead, self._took = config.planning.lead, 0.0
        self._rate = self._cap = 1.0
        self.pacer = Pacer(config)
        self.caution = Caution(config)
        self.waiting_for: GateEstimate | None = None

    def request(self, now: float, goal: Goal, gate_map: GateMap | None, line: Line) -> PlanRequest | None:
        """What to plan at ``now``; None while the line that is being flown will do.

        The request starts from the plan being flown at its full pace: its answer is for `Pacer.offers`.
        """
        fresh = goal.serial != self._serial
        if not fresh and goal.waypoints is not None:
            return None
        if goal.serial == self._asked_serial and now < self._asked + self._config.planning.replan_interval:
            return None
        flown = line.latest
        stamp = now + self._lead if flown is None else max(now + self._lead, flown.stamp)
        if not fresh and self._gate_is_near(flown, stamp):
            return None
        start = self.pacer.pace.full(line.motion(stamp), stamp)
        behind = self._passed(goal, flown, stamp)
        leg = self._course(goal, gate_map, behind, start.position)
        self.waiting_for = leg.waiting_for
        if (leg.blind and not leg.gates) or (not fresh and not self._changed(leg)):
            return None
        look_at = leg.following.position if leg.following else None
        self._asked, self._asked_serial, self._asked_behind = now, goal.serial, behind
        return PlanRequest(
            stamp,
            start,
            leg.gates,
            leg.end,
            goal.limits,
            look_at,
            shape=self._shape,
            obstacles=self._obstacles,
            frames=self.known(gate_map),
        )

    def detour(self, goal: Goal, request: PlanRequest, choice: Paced, line: Line) -> str:
        """Why ``choice`` is not worth flying; empty where it is.

        It is not if it goes a long way round to a gate through which the line being flown leads as well.
        """
        flown, new = line.latest, choice.flown
        if flown is None or goal.serial != self._serial or not (new.gate_times and request.gates):
            return ""
        gate, planned = request.gates[0], self._planned[len(self._planned) - len(flown.gate_ids) :]
        room = 0.5 * self._shape.opening - self._config.vehicle.radius
        for old, time in zip(planned, flown.gate_times, strict=False):
            if flown.stamp + time <= new.stamp:
                continue
            late = new.stamp + new.gate_times[0] - flown.stamp - time
            if old.gate_id != gate.gate_id or _moved(gate.position, old.position, room) or late <= DETOUR:
                return ""
            return f"meets gate {gate.gate_id} {late:.1f} s later than the line being flown: a detour"
        return ""

    def accepted(self, goal: Goal, request: PlanRequest, choice: Paced) -> None:
        """``choice``, the answer to ``request``, has become the line being flown."""
        self._serial = goal.serial
        self._planned = request.gates
        self._end = request.end
        self._behind = self._asked_behind
        self._cap = 1.0 if choice.pace.after >= self.rate else choice.pace.after
        self.pacer.took(choice)

    def took(self, elapsed: float) -> None:
        """Planning took ``elapsed`` s: the next plan begins late enough to be there in time, if need be."""
        self._took = elapsed
        self._lead = max(self._config.planning.lead, min(LEAD_MARGIN * elapsed, LEAD_MAX))

    @property
    def has_time(self) -> bool:
        """Whether the next plan may be flown in a forward simulation before it has to take over."""
        return self._lead - self._took >= SCREENING

    @property
    def rate(self) -> float:
        """The pace wanted of new plans."""
        return min(self._rate, self._config.planning.pace_min) if self.caution.held else self._rate

    def repace(
        self,
        now: float,
        goal: Goal,
        gate_map: GateMap | None,
        line: Line,
        voltage: float = math.nan,
        push: float = 0.0,
    ) -> tuple[Paced, str] | None:
        """The plan being flown at another pace, to be accepted at once, and what to tell of it; None to go on as is.

        ``voltage`` (V) is the battery's, NaN where it is not known, and ``push`` (m/s²) the wind's.
        """
        flying = self.pacer.flying
        if flying is None or line.latest is not flying.flown:
            return None
        stamp = max(now, flying.flown.stamp) + PACE_LEAD
        gates = gate_map.gates if gate_map else ()
        wanted, why = self.caution.wanted(stamp, flying, gates, self._shape, voltage, push)
        before, wanted = flying.pace.after, min(wanted, self._cap)
        if not self.caution.changes(now, before, wanted):
            return None
        choice = self.pacer.change(line.latest, stamp, wanted, goal.limits)
        if choice is None:
            return None
        return choice, f"pace {before:.2f} to {wanted:.2f} within {choice.pace.ramp:.1f} s: {why}"

    def repaced(self, choice: Paced) -> None:
        """What `repace` returned has become the line being flown."""
        self._rate = choice.pace.after
        self.pacer.took(choice)

    def _course(self, goal: Goal, gate_map: GateMap | None, behind: int, origin: Vector) -> Course:
        if not goal.gate_ids:
            return Course((), goal.end, None)
        by_id = {gate.gate_id: gate for gate in gate_map.gates} if gate_map else {}
        ahead = [by_id.get(gate_id) for gate_id in goal.gate_ids[behind:]]
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
        """How many gates will be behind at ``stamp`` by the plan.

        A gate that a plan has left behind stays behind, even while the vehicle, a little late, is still before it.
        """
        if flown is None or goal.serial != self._serial:
            return goal.passed
        crossed = sum(flown.stamp + time <= stamp for time in flown.gate_times)
        return min(max(goal.passed, self._behind + crossed), len(goal.gate_ids))

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
