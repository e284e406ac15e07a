"""From points to a plan that is fast and keeps to the limits.

First the times through the points alone; then, where free points are wanted, each leg is divided at points of
the line found so far, which are moved together with the times; last, an exact step that makes the densely
sampled plan keep to the limits. The steps are compiled one by one and put together here: compiled as one they
would be compiled again at every level.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.planning.descent import descend
from flightapp.planning.hermite import (
    DENSE_BASIS,
    DENSE_SAMPLES,
    duration_powers,
    polynomial_coefficients,
    segment_ends,
)
from flightapp.planning.objective import ACCELERATION, CROSSING, SPEED

TOLERATED = 1.001
"""Ratio to a limit that counts as keeping to it."""
WEIGHT = 100.0
"""s per squared relative excess, of the penalty."""
ROUGH, ANCHORED, FREE = 20, 50, 80
"""Steps of descent: on times before points are freed, on times alone, on times and points."""
ROUNDS = 5
"""Attempts to bring a plan with a moving start within the limits."""
FIRST_LEG = (1.0, 2.0, 4.0, 0.5)
"""Factors on the time guessed for the first leg, tried in turn until a plan is good enough."""
PATIENCE, GRACE = 3.0, 2.0
"""A plan is late if it takes longer than the first guess by this factor and this many s."""
ASKEW = 0.07
"""Shortfall of the cosine of a crossing angle that is put up with (25° may become 33°)."""
BRIEF = 0.4
"""Of the median duration of the legs; a leg that takes less is not divided."""
SHORT = 1e-2
"""m, a leg is counted as at least this long when its time is guessed."""


@dataclass(slots=True, eq=False)
class Spline:
    """A plan in the making: n segments that end at rest."""

    times: Vector
    """(n,) s."""
    points: Vector
    """(n + 1, 3) m."""
    free: Vector
    """(n + 1,) 1 where the point may be moved, else 0."""
    normals: Vector
    """(n + 1, 3) directions of passage, zero where there is no gate."""
    derivatives: Vector
    """(3 (n + 1), 3) v, a and j of each knot."""
    anchors: NDArray[np.intp]
    """(m + 1,) which of the points are waypoints."""

    def copy(self) -> "Spline":
        """One that can be changed without changing this one."""
        return replace(self, times=self.times.copy(), points=self.points.copy(), derivatives=self.derivatives.copy())


@kernel
def peaks(times: Vector, points: Vector, derivatives: Vector) -> tuple[float, float]:
    """Greatest speed (m/s) and acceleration (m/s²) among dense samples."""
    speed, acceleration = 0.0, 0.0
    y, scales = np.empty((7, 3)), np.empty(7)
    for i in range(times.size):
        duration_powers(times[i], scales)
        segment_ends(i, scales, points, derivatives, y)
        for k in range(DENSE_SAMPLES + 1):
            v2, a2 = 0.0, 0.0
            for axis in range(3):
                v, a = 0.0, 0.0
                for q in range(7):
                    v += DENSE_BASIS[k, 1, q] * y[q, axis]
                    a += DENSE_BASIS[k, 2, q] * y[q, axis]
                v2 += v * v
                a2 += a * a
            speed = max(speed, math.sqrt(v2) / scales[0])
            acceleration = max(acceleration, math.sqrt(a2) / scales[1])
    return speed, acceleration


def excesses(spline: Spline, limits: Vector) -> tuple[float, float]:
    """Peaks of speed and acceleration in units of their limits."""
    speed, acceleration = peaks(spline.times, spline.points, spline.derivatives)
    return speed / limits[SPEED], acceleration / limits[ACCELERATION]


def slowdown(spline: Spline, limits: Vector) -> float:
    """How many times slower a plan must be flown to keep to the limits exactly."""
    speed, acceleration = excesses(spline, limits)
    return max(speed, math.sqrt(acceleration))


def stretch(spline: Spline, factor: float) -> None:
    """Fly a plan that starts and ends at rest ``factor`` times slower, exactly."""
    spline.times *= factor
    spline.derivatives.reshape(-1, 3, 3)[:] /= np.array([factor, factor**2, factor**3])[:, None]


def first_times(points: Vector, start: Vector, limits: Vector) -> Vector:
    """(n,) s, a guess for each leg from its length, the limits and the start's velocity."""
    v_max, a_max = limits[SPEED], limits[ACCELERATION]
    legs = np.diff(points, axis=0)
    lengths = np.maximum(np.sqrt((legs * legs).sum(axis=1)), SHORT)
    times: Vector = np.maximum(lengths / v_max, np.sqrt(2.0 * lengths / a_max))
    if start.any():
        ahead = legs[0] / lengths[0]
        closing = max(float(start[0] @ ahead), 0.0)
        reached = min(v_max, math.sqrt(closing**2 + 2.0 * a_max * lengths[0]))
        aside = float(np.linalg.norm(start[0] - closing * ahead))
        times[0] = 2.0 * lengths[0] / (closing + reached) + 0.5 * aside / a_max
    return times


def divide(spline: Spline, parts: int) -> Spline:
    """The same line with its legs in ``parts`` of equal duration, whose new ends are free.

    A leg that is brief beside the others stays whole: knots close together make the descent stall.
    """
    whole = spline.times < BRIEF * np.median(spline.times)
    counts = np.where(whole, 1, parts)
    anchors = np.concatenate(([0], np.cumsum(counts)))
    leg = np.repeat(np.arange(counts.size), counts)
    part = np.arange(leg.size) - anchors[leg]
    times = spline.times[leg] / counts[leg]
    coefficients = polynomial_coefficients(spline.times, spline.points, spline.derivatives)
    powers = (part * times)[:, None] ** np.arange(8)
    points = np.vstack((np.einsum("iam,im->ia", coefficients[leg], powers), spline.points[-1:]))
    free, normals = np.ones(leg.size + 1), np.zeros((leg.size + 1, 3))
    points[anchors], normals[anchors], free[anchors] = spline.points, spline.normals, 0.0
    derivatives = np.zeros((3 * (leg.size + 1), 3))
    derivatives[:3] = spline.derivatives[:3]
    return Spline(times, points, free, normals, derivatives, anchors)


def optimise(waypoints: Vector, directions: Vector, start: Vector, limits: Vector, order: int, knots: int) -> Spline:
    """A plan through ``waypoints`` (m + 1, 3), which begin with the start; it ends at rest.

    ``directions`` (m + 1, 3) are those of passage, zero for plain points; ``start`` (3, 3) is v, a and j
    there; ``limits`` is that of `objective`; ``order`` is the derivative to minimise; ``knots`` free points
    are put into each leg. From rest the plan keeps to speed and acceleration; from a moving start it may
    exceed them where nothing better was found. Descent finds the nearest minimum: where that is a poor one, it
    is repeated from other times of the first leg, on which most depends.
    """
    guess = first_times(waypoints, start, limits)
    found: list[tuple[float, int, Spline]] = []
    for i, factor in enumerate(FIRST_LEG):
        times = guess.copy()
        times[0] *= factor
        spline = _attempt(times, waypoints, directions, start, limits, order, knots)
        late = float(spline.times.sum()) - PATIENCE * float(guess.sum()) - GRACE
        score = 1e3 * _faults(spline, limits) + max(late, 0.0)
        found.append((score if math.isfinite(score) else math.inf, i, spline))
        if score == 0.0:
            break
    return min(found)[2]


def _attempt(
    times: Vector, waypoints: Vector, directions: Vector, start: Vector, limits: Vector, order: int, knots: int
) -> Spline:
    """One descent from the ``times`` (m,) guessed for the legs."""
    free, derivatives = np.zeros(len(waypoints)), np.zeros((3 * len(waypoints), 3))
    spline = Spline(times, waypoints.copy(), free, directions, derivatives, np.arange(len(waypoints)))
    spline.derivatives[:3] = start
    moving = bool(start.any())
    if not moving:
        _descend(spline, limits, order, WEIGHT, 0)
        stretch(spline, slowdown(spline, limits))
    _descend(spline, limits, order, WEIGHT, ROUGH if knots else ANCHORED)
    if knots:
        spline = divide(spline, knots + 1)
        _descend(spline, limits, order, WEIGHT, FREE)
    if moving:
        return _tighten(spline, limits, order)
    stretch(spline, max(1.0, slowdown(spline, limits)))
    return spline


def _faults(spline: Spline, limits: Vector) -> float:
    """By how much a plan exceeds the limits and misses the gates' directions, 0 where it does neither."""
    over = max(excesses(spline, limits)) - TOLERATED
    velocities = spline.derivatives[::3]
    gates = spline.normals.any(axis=1)
    along = (velocities * spline.normals).sum(axis=1)[gates]
    speeds = np.sqrt((velocities * velocities).sum(axis=1))[gates]
    askew = limits[CROSSING] - ASKEW - along / np.maximum(speeds, 1e-9)
    return float(np.maximum(np.max(askew, initial=0.0), over))


def _descend(spline: Spline, limits: Vector, order: int, weight: float, steps: int) -> None:
    descend(spline.times, spline.points, spline.free, spline.normals, limits, order, weight, spline.derivatives, steps)


def _tighten(spline: Spline, limits: Vector, order: int) -> Spline:
    """The plan that exceeds the limits least, found by aiming ever further below them."""
    aim, weight = limits.copy(), WEIGHT
    best, least = spline, slowdown(spline, limits)
    for _ in range(ROUNDS):
        speed, acceleration = excesses(spline, limits)
        if max(speed, acceleration) <= TOLERATED:
            return spline
        aim[SPEED] *= min(1.0, max(0.9, 1.0 / speed))
        aim[ACCELERATION] *= min(1.0, max(0.8, 1.0 / acceleration))
        weight *= 3.0
        spline = spline.copy()
        _descend(spline, aim, order, weight, FREE // 2)
        if slowdown(spline, limits) < least:
            best, least = spline, slowdown(spline, limits)
    return best
