"""The compiled part of `corridor` about straight legs: which are free, and of which points a way is made."""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel, lean_kernel
from flightapp.planning.obstacles import MARGIN, beyond, distance, farther

HALVINGS = 24
"""Of a leg, at the most, to find where it comes nearest to a solid: to within a micrometre for 16 m."""
NUDGES = 30
"""Steps by which a point of a way is moved clear, away from what it is deepest in each time."""
TOUCH = 1e-3
"""m"""


@lean_kernel
def deepest(p: Vector, rows: Vector, reach: Vector, gradient: Vector) -> tuple[int, float]:
    """The row that point ``p`` (3,) m is most too close to by its ``reach`` (k,) m, and by how much; -1 and 0 if clear.

    Overwrites ``gradient`` (3,).
    """
    found, depth = -1, 0.0
    for i in range(rows.shape[0]):
        if not (beyond(p, rows, i, reach[i]) or farther(p, rows, i, reach[i])):
            lacking = reach[i] - distance(p, rows, i, gradient)
            if lacking > depth:
                found, depth = i, lacking
    return found, depth


@kernel
def nearer(a: Vector, b: Vector, rows: Vector, i: int, reach: float) -> bool:
    """Whether the straight leg from ``a`` to ``b`` (3,) m comes nearer to row ``i`` than ``reach`` m.

    The distance from a convex solid is convex along a line: it lies above its tangents, and between the points where
    it falls and where it rises it is least.
    """
    gradient, p = np.empty(3), np.empty(3)
    low, high = 0.0, 1.0
    for halving in range(HALVINGS + 2):
        s = float(halving) if halving < 2 else 0.5 * (low + high)
        for j in range(3):
            p[j] = a[j] + s * (b[j] - a[j])
        away = distance(p, rows, i, gradient) - reach
        if away < 0.0:
            return True
        slope = 0.0
        for j in range(3):
            slope += gradient[j] * (b[j] - a[j])
        left = high - s if slope < 0.0 else low - s
        if away + slope * left >= 0.0:
            return False
        if slope < 0.0:
            low = s
        else:
            high = s
    return False


@kernel
def blocked_on(a: Vector, b: Vector, rows: Vector, reach: Vector) -> int:
    """The first of ``rows`` that the leg from ``a`` to ``b`` comes nearer to than its ``reach`` (k,) m; -1 for none."""
    middle = np.empty(3)
    square = 0.0
    for j in range(3):
        middle[j] = 0.5 * (a[j] + b[j])
        square += (a[j] - middle[j]) ** 2
    half = math.sqrt(square)
    for i in range(rows.shape[0]):
        if not beyond(middle, rows, i, reach[i] + half) and nearer(a, b, rows, i, reach[i]):
            return i
    return -1


@kernel
def reaches(a: Vector, b: Vector, rows: Vector, step: float) -> Vector:
    """(k,) m to keep from each of ``rows`` between ``a`` and ``b`` (3,): the margin, or less where an end is closer.

    Two points ``step`` m apart at this distance from a convex solid have at least its margin all the way between.
    """
    out, gradient = np.empty(rows.shape[0]), np.empty(3)
    for i in range(rows.shape[0]):
        reach = math.sqrt(rows[i, MARGIN] ** 2 + 0.25 * step * step)
        nearest = min(distance(a, rows, i, gradient), distance(b, rows, i, gradient))
        out[i] = min(reach, nearest - TOUCH)
    return out


@kernel
def clear_legs(points: Vector, directions: Vector, rows: Vector, one_way: bool) -> NDArray[np.bool_]:
    """(n - 1,) which of the straight legs between ``points`` (n, 3) m will do.

    ``directions`` (n, 3) are those of passage, zero for any; where they are ``one_way`` a leg has to leave and to
    come with them.
    """
    out = np.empty(points.shape[0] - 1, np.bool_)
    for k in range(out.size):
        out[k] = True
        for place in range(k, k + 2):
            ahead, given = 0.0, False
            for j in range(3):
                ahead += directions[place, j] * (points[k + 1, j] - points[k, j])
                given = given or directions[place, j] != 0.0
            if one_way and given and ahead <= 0.0:
                out[k] = False
        if out[k]:
            reach = reaches(points[k], points[k + 1], rows, 0.0)
            out[k] = blocked_on(points[k], points[k + 1], rows, reach) < 0
    return out


@kernel
def corners(way: Vector, rows: Vector, reach: Vector) -> NDArray[np.bool_]:
    """(n,) which points of ``way`` (n, 3) are enough for straight legs between them to keep clear.

    From each the next is the last one in sight, as found by bisection; it is behind those in sight where a way turns
    to one side only.
    """
    n = way.shape[0]
    kept = np.zeros(n, np.bool_)
    kept[0] = True
    here = 0
    while here < n - 1:
        there, hidden, tried = here + 1, n, n - 1
        while tried > there:
            if blocked_on(way[here], way[tried], rows, reach) < 0:
                there = tried
            else:
                hidden = tried
            tried = (there + hidden) // 2
        kept[there] = True
        here = there
    return kept


@kernel
def nudged(way: Vector, rows: Vector, reach: Vector) -> None:
    """Move the points between the ends of ``way`` (n, 3) clear of ``rows``, where they are not and can be."""
    gradient = np.empty(3)
    for k in range(1, way.shape[0] - 1):
        for _ in range(NUDGES):
            found, depth = deepest(way[k], rows, reach, gradient)
            if found < 0:
                break
            distance(way[k], rows, found, gradient)
            for j in range(3):
                way[k, j] += (depth + 0.1 * TOUCH) * gradient[j]
