"""What a plan costs, and how that changes with its times.

The cost is the duration plus a smooth penalty on what exceeds the limits (`penalty`). The spline is always the
smoothest one (`minimum`), so that the cost depends on the times alone; its gradient is found with one more solve on
the same factors (adjoint method).
"""

import math

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.hermite import (
    COEFFICIENTS,
    DENSER,
    ENERGY_CHANGE,
    PLACES,
    SAMPLES,
    SNAP,
    Order,
    pull_end,
    pull_start,
    segment_ends,
)
from flightapp.planning.minimum import energy_weight, smoothest, solve
from flightapp.planning.penalty import Weights, motion_at, penalties, pull, weights_of
from flightapp.planning.spline import Spline, piece
from flightapp.trajectory import ORDER


@inlined
def _spread(order: Order, i: int, t: float, y: Vector, g: Vector, pulls: Vector) -> float:
    """Add the gradient ``g`` (8, 3) by coefficients of segment ``i`` to that by its knots; returns that by T."""
    free = len(order)
    by_time, power = 0.0, 1.0
    for q in range(free):
        power *= t
        for axis in range(3):
            first, second = 0.0, 0.0
            for m in range(q + 1, 2 * free + 2):
                first += COEFFICIENTS[free - 1, m, q] * g[m, axis]
            for m in range(free + 1, 2 * free + 2):
                second += COEFFICIENTS[free - 1, m, free + q] * g[m, axis]
            pulls[i, q, axis] += power * first
            pulls[i + 1, q, axis] += power * second
            by_time += (q + 1.0) / t * (first * y[q, axis] + second * y[free + q, axis])
    return by_time


@inlined
def _clear(order: Order, rows: Vector) -> None:
    """Zero the first d of the derivatives of a knot, ``rows`` (3, 3)."""
    for p in range(len(order)):
        for axis in range(3):
            rows[p, axis] = 0.0


@inlined
def _unmap(order: Order, map_: Vector, g: Vector) -> None:
    """Turn the gradient ``g`` (8, 3) by the coefficients of a part into that by those of its segment."""
    for axis in range(3):
        for k in range(2 * len(order) + 1, -1, -1):
            total = 0.0
            for m in range(k + 1):
                total += map_[m, k] * g[m, axis]
            g[k, axis] = total


@inlined
def _gradient(order: Order, s: Spline, i: int, part: int, t: float, weights: Weights, share: float) -> float:
    """Add the gradient of a piece's penalties, `Spline.over`, to `Spline.pulls`; returns that by log T."""
    by_time = 0.0
    for m in range(ORDER):
        for axis in range(3):
            s.g[m, axis] = 0.0
    for k in range(SAMPLES):
        if s.over[k] > 0.0:
            motion_at(DENSER * k, t, s.c, s.motion)
            by_time += share * s.over[k] + pull(DENSER * k, t, s.motion, weights, share * t, s.g)
    if part == 0:
        by_time += pull_start(order, t, s.ends[0], s.g)
    elif part == 3:
        by_time += pull_end(order, t, s.ends[1], s.g)
    if part >= 0:
        _unmap(order, s.maps[part], s.g)
    whole: float = s.times[i]
    return t * by_time + whole * _spread(order, i, whole, s.y, s.g, s.pulls)


@inlined
def _through_spline(order: Order, s: Spline, gradient: Vector) -> None:
    """Add to ``gradient`` what the times do by way of the knots' derivatives; `Spline.pulls` holds the adjoint."""
    free, R, pulls, y = len(order), ENERGY_CHANGE[len(order) - 1], s.pulls, s.y
    for i in range(s.times.size):
        t = s.times[i]
        segment_ends(order, i, t, s.points, s.derivatives, y)
        change, power = 0.0, 1.0
        for p in range(free):
            power *= t
            for axis in range(3):
                first, second = 0.0, 0.0
                for q in range(2 * free + 1):
                    first += R[p, q] * y[q, axis]
                    second += R[free + p, q] * y[q, axis]
                change += power * (pulls[i, p, axis] * first + pulls[i + 1, p, axis] * second)
        gradient[i] -= energy_weight(order, t) * change


@lean_kernel
def cost(order: Order, s: Spline, limits: Vector, weight: float, gradient: Vector) -> float:
    """Duration plus penalties (s) of ``s`` with its times; fills its derivatives and ``gradient`` (n,) by log time.

    ``weight`` is s per s of squared relative excess. Infinite where the spline cannot be computed.
    """
    n, weights, share = s.times.size, weights_of(limits), weight / SAMPLES
    if not smoothest(order, s.times, s.points, s.ends, s.derivatives, s.factors, s.couplings):
        return math.inf
    for i in range(n):
        gradient[i] = s.times[i]
        _clear(order, s.pulls[i])
    _clear(order, s.pulls[n])
    value = 0.0
    for p in range(n + 2):
        i, part, t = piece(order, p, s, s.y, s.c)
        if part in (0, 3):
            penalties(SNAP, t, s.c, PLACES, weights, s.over)
        else:
            penalties(order, t, s.c, PLACES, weights, s.over)
        penalty = 0.0
        for k in range(SAMPLES):
            penalty += s.over[k]
        value += t + share * t * penalty
        if penalty > 0.0:
            gradient[i] += _gradient(order, s, i, part, t, weights, share)
    solve(order, n, s.factors, s.couplings, s.pulls)
    _clear(order, s.pulls[0])
    _clear(order, s.pulls[n])
    _through_spline(order, s, gradient)
    return value
