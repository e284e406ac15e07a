"""From points to a plan that is fast and keeps to the limits: one compiled call.

First the times that a trapezoid of speed (or the last plan) suggests, then descent on them, then an exact step:
a plan from rest to rest is flown as much faster or slower as brings its densest samples to the limits. A plan with
motion at an end cannot be: there the descent is repeated, aiming ever further below the limits, until none is exceeded.
"""

import math

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.descent import Search, descend
from flightapp.planning.guess import guess_times, recall_times
from flightapp.planning.hermite import DENSE_PLACES, Order
from flightapp.planning.measure import NARROW, NARROW_RATE, body_rate, slowdown
from flightapp.planning.penalty import FORCE, LEAST, RATE, SPEED, THRUST
from flightapp.planning.spline import Spline, divide, piece
from flightapp.trajectory import ORDER

FOUND, EXCEEDED, UNEVEN = 0, 1, 2
"""Outcomes: a plan; none that keeps to the limits; the arithmetic failed."""
WEIGHT, WEIGHT_MOVING = 100.0, 200.0
"""s per squared relative excess, of the penalty; the latter where the plan cannot be flown slower afterwards."""
BELOW = 0.99
"""Share of the limits that is aimed at then."""
TOLERANCE, TOLERANCE_MOVING = 2e-3, 1e-2
"""Relative descent of one step below which the search is given up; the latter where the plan has moving ends."""
PATIENCE, PATIENCE_MOVING = 2, 1
"""Such steps in a row."""
BENT = 1.0
"""s, about the part of the first and last segment that is bent to what is asked for at the ends."""
MOST_BENT = 0.9
"""Greatest share of a segment that is bent."""
ROUNDS = 6
"""Attempts to bring a plan with moving ends within the limits."""
EVEN = 1.0 + 1e-6
"""Share of a limit that arithmetic may add."""
FASTER = 0.9
"""A plan at rest at its ends may turn out to admit being flown in this share of its time."""


@inlined
def _allow(s: Spline, limits: Vector) -> None:
    """Raise ``limits`` (5,) to what the ends themselves have: that does not count as exceeding them."""
    for end in range(2):
        v, a, j = s.ends[end, 0], s.ends[end, 1], s.ends[end, 2]
        flat, up = a[0] * a[0] + a[1] * a[1], a[2] + GRAVITY
        force = math.sqrt(flat + up * up)
        rate = body_rate(a[0], a[1], a[2], j[0], j[1], j[2], 1.0)
        limits[SPEED] = max(limits[SPEED], EVEN * math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))
        limits[THRUST] = max(limits[THRUST], EVEN * math.sqrt(flat + a[2] * a[2]))
        limits[FORCE] = max(limits[FORCE], EVEN * force)
        limits[LEAST] = min(limits[LEAST], force / EVEN)
        limits[RATE] = max(limits[RATE], EVEN * rate)


@lean_kernel
def write(order: Order, s: Spline, knots: Vector, coefficients: Vector) -> bool:
    """Fill ``knots`` (n + 3,) s and ``coefficients`` (n + 2, 3, 8), ascending powers; False where they are not finite.

    The first and last segment are in two parts each, or in three if they are one.
    """
    knots[0], total = 0.0, 0.0
    for p in range(s.times.size + 2):
        i, _, t = piece(order, p, s, s.y, s.c)
        knots[p + 1] = knots[p] + t
        scale = 1.0
        for m in range(ORDER):
            for axis in range(3):
                coefficients[p, axis, m] = scale * s.c[m, axis]
                if m == 0:
                    coefficients[p, axis, 0] += s.points[i, axis]
                total += coefficients[p, axis, m]
            scale /= t
    return math.isfinite(total + knots[-1])


@lean_kernel
def optimise(
    order: Order,
    s: Spline,
    search: Search,
    limits: Vector,
    last: tuple[Vector, Vector, float],
    moving: bool,
    knots: Vector,
    coefficients: Vector,
) -> int:
    """Find the times of ``s``, and `write` it to ``knots`` and ``coefficients``; an outcome.

    ``limits`` (4, 5) has those to keep to in its first row; the others are room, of which the last is left with the
    ratios to them. ``last`` are the last plan's points (m + 1, 3) and times (m,), and the s from its start to this.
    """
    bound, aim, ratios = limits[1], limits[2], limits[3]
    n = s.times.size
    for m in range(5):
        bound[m] = aim[m] = limits[0, m] * (NARROW_RATE if m == RATE else 1.0 / NARROW if m == LEAST else NARROW)
    if moving:
        _allow(s, bound)
        for m in range(5):
            aim[m] *= 1.0 / BELOW if m == LEAST else BELOW
    guess_times(s, aim, s.factors[:, 0, 0])
    if last[1].size > 0:
        recall_times(s, last[0], last[1], last[2])
    most = MOST_BENT if n > 1 else 0.5 * MOST_BENT
    divide(s, min(most, BENT / s.times[0]), min(most, BENT / s.times[n - 1]))
    weight, slow, more = WEIGHT_MOVING if moving else WEIGHT, 1.0 if moving else FASTER, math.inf
    tolerance, patience = (TOLERANCE_MOVING, PATIENCE_MOVING) if moving else (TOLERANCE, PATIENCE)
    for attempt in range(ROUNDS):
        if (moving or attempt == 0) and not descend(order, s, search, aim, weight, tolerance, patience) < math.inf:
            return UNEVEN
        more = slowdown(order, s, bound, DENSE_PLACES, slow, ratios)
        if more == slow or not more < math.inf:
            break
        if moving:
            _tighten(aim, ratios)
            weight *= 3.0
        else:
            slow = more
    if moving and more != slow:
        return EXCEEDED
    if not slow < math.inf:
        return UNEVEN
    if not moving:
        _stretch(s, slow)
    return FOUND if write(order, s, knots, coefficients) else UNEVEN


@inlined
def _tighten(aim: Vector, ratios: Vector) -> None:
    """Aim further below what was exceeded."""
    for m in range(5):
        share = max(1.0 / ratios[m], 0.8)
        aim[m] = aim[m] / share if m == LEAST else aim[m] * share


@inlined
def _stretch(s: Spline, slow: float) -> None:
    """Fly a plan that is at rest at its ends ``slow`` times slower."""
    for i in range(s.times.size):
        s.times[i] *= slow
        power = 1.0
        for p in range(3):
            power /= slow
            for axis in range(3):
                s.derivatives[i, p, axis] *= power
