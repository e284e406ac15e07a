"""Keeps the pace at which plans are flown, and changes it where that asks nothing new of the vehicle."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flightapp.config import Config
from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import Limits, PlanRequest
from flightapp.jit import kernel
from flightapp.planning.pacing import STEADY, Pace, contiguous, paced, progress
from flightapp.trajectory import Trajectory, evaluate

RAMPS = (0.6, 0.9, 1.4, 2.0, 3.0)
"""s, durations of a change that are tried, the shortest first."""
SETTLE = 0.01
"""s from a takeover to the beginning of its change."""
TOLERATED = 1.02
"""Share of a limit, or of what the plan itself takes there, that a change may take."""
SLOWER = (1.0, 0.97, 0.94, 0.9, 0.85, 0.8, 0.7)
"""Shares of the wanted rate at which a new plan is offered."""
SAME = 1e-3
"""Rates that differ by less are one."""
STEP = 0.02
"""s between the moments of a change at which the limits are looked at; what follows is looked at half as often."""
WEAKEST = 0.5
"""m/s², specific force for which body rates are told; the thrust's direction may turn at any rate in free fall."""


@kernel
def _demand(row: Vector, s: float, s1: float, s2: float, out: Vector) -> None:
    """Acceleration, specific force and body rate (lengths) of the plan's motion ``row`` (17,) at a rate, into ``out``.

    ``s1`` and ``s2`` are the rate's derivatives (1/s, 1/s²). The vehicle is one without drag.
    """
    acceleration = force = turn = along = 0.0
    for axis in range(3):
        a = s * s * row[6 + axis] + s1 * row[3 + axis]
        f = a + (GRAVITY if axis == 2 else 0.0)
        j = s * s * s * row[9 + axis] + 3.0 * s * s1 * row[6 + axis] + s2 * row[3 + axis]
        acceleration += a * a
        force += f * f
        turn += j * j
        along += j * f
    out[0], out[1] = math.sqrt(acceleration), math.sqrt(force)
    weight = max(out[1], WEAKEST)
    out[2] = math.sqrt(max(turn - along * along / (weight * weight), 0.0)) / weight


@kernel
def _excess(
    knots: Vector, coefficients: Vector, begun: float, before: float, after: float, ramp: float, limits: Vector
) -> float:
    """The greatest ratio of what a change asks for to ``limits``, or to what the plan does there if that is more.

    ``limits`` (4,) are acceleration, least and greatest specific force, and body rate. The change begins where the
    plan has got to ``begun``.
    """
    still, rest = np.zeros(2), np.zeros((1, 4))
    still[1] = knots[-1]
    row, own, asked = np.empty(17), np.empty(3), np.empty(3)
    worst, t, place = 0.0, 0.0, begun
    while place < knots[-1]:
        evaluate(knots, coefficients, still, rest, place, row)
        _demand(row, 1.0, 0.0, 0.0, own)
        _, s, s1, s2 = progress(before, after, ramp, t)
        _demand(row, s, s1, s2, asked)
        worst = max(worst, asked[0] / max(limits[0], own[0]), asked[1] / max(limits[2], own[1]))
        worst = max(worst, min(limits[1], own[1]) / max(asked[1], 1e-6), asked[2] / max(limits[3], own[2]))
        t += STEP if t < ramp else 2.0 * STEP
        place = begun + progress(before, after, ramp, t)[0]
    return worst


@dataclass(frozen=True, slots=True)
class Paced:
    """A plan, the pace at which it is flown, and the trajectory that this makes."""

    plan: Trajectory
    begun: float
    """s of the plan that are over where the trajectory starts."""
    pace: Pace
    flown: Trajectory

    def place(self, stamp: float) -> float:
        """s of the plan that are over at ``stamp``."""
        return self.begun + self.pace.progress(self.flown.stamp, stamp)


class Pacer:
    """Knows how what is flown came from its plan, so that a change of pace is always one of the plan itself."""

    def __init__(self, config: Config) -> None:
        planning, vehicle = config.planning, config.vehicle
        self._least = config.guard.thrust_min
        self._most = planning.thrust_share * vehicle.thrust_max
        self._turning = planning.rate_share * vehicle.rate_max
        self._least_rate = planning.pace_min
        self._flying: Paced | None = None

    @property
    def flying(self) -> Paced | None:
        """What was taken last."""
        return self._flying

    @property
    def pace(self) -> Pace:
        """The pace at present."""
        return self._flying.pace if self._flying else STEADY

    def offers(self, plan: Trajectory, request: PlanRequest, wanted: float) -> Iterator[Paced]:
        """Ways to fly a new ``plan``, the most wanted first: at the rate ``wanted``, as now, slower down to `pace_min`.

        All of them take over without a jump from the motion for which the plan was asked for.
        """
        stamp, start, pace = plan.stamp, request.start, self.pace
        slower = [share * wanted for share in SLOWER if share * wanted >= self._least_rate]
        if not (np.any(start.velocity) or np.any(start.acceleration) or np.any(start.jerk) or start.yaw_rate):
            for rate in dict.fromkeys((wanted, *slower)):
                yield _flown(plan, 0.0, Pace(stamp, rate, rate, 0.0), stamp)
            return
        if not pace.settled(stamp):
            yield _flown(plan, 0.0, pace, stamp)
            return
        now = pace.rate(stamp)
        for rate in dict.fromkeys((wanted, now, *slower)):
            changed = self._changed(plan, 0.0, stamp, now, rate, request.limits)
            if changed is not None:
                yield changed

    def took(self, choice: Paced) -> None:
        """``choice`` is what will be flown."""
        self._flying = choice

    def change(self, latest: Trajectory | None, stamp: float, wanted: float, limits: Limits) -> Paced | None:
        """The plan being flown, changing to the rate ``wanted`` from ``stamp`` on.

        None where nothing can or need be changed: ``latest``, what is flown last, is no plan of ours, it is over or
        not begun, still changing, at that rate, or no change would keep to the limits just here.
        """
        flying = self._flying
        if flying is None or flying.flown is not latest or stamp <= latest.stamp:
            return None
        pace = flying.pace
        rate = pace.rate(stamp)
        if abs(rate - wanted) < SAME or not pace.settled(stamp):
            return None
        begun = flying.place(stamp)
        if begun >= flying.plan.duration - RAMPS[0]:
            return None
        return self._changed(flying.plan, begun, stamp, rate, wanted, limits)

    def _changed(
        self, plan: Trajectory, begun: float, stamp: float, rate: float, wanted: float, limits: Limits
    ) -> Paced | None:
        if abs(rate - wanted) < SAME:
            return _flown(plan, begun, Pace(stamp, rate, rate, 0.0), stamp)
        bounds = np.array((limits.a_max, self._least, self._most, self._turning))
        path = contiguous(plan.knots), contiguous(plan.coefficients)
        for ramp in RAMPS:
            if _excess(*path, begun + SETTLE * rate, rate, wanted, ramp, bounds) <= TOLERATED:
                return _flown(plan, begun, Pace(stamp + SETTLE, rate, wanted, ramp), stamp)
        return None


def _flown(plan: Trajectory, begun: float, pace: Pace, stamp: float) -> Paced:
    return Paced(plan, begun, pace, paced(plan, begun, pace, stamp))
