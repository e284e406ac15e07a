"""The first guess of a plan's times: from the last plan, or a trapezoid of speed along each leg."""

import math

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.penalty import FORCE, SPEED, THRUST
from flightapp.planning.spline import Spline

EASE = 1.05
"""Ratio of the durations of smooth legs to those of trapezoids of speed."""
LEAST_LEG = 1e-3
"""m, a leg is counted as at least this long."""
NEAR = 0.3
"""Share of a leg by which its end may have moved since the last plan."""


@inlined
def _leg(s: Spline, i: int) -> float:
    x = s.points[i + 1, 0] - s.points[i, 0]
    y = s.points[i + 1, 1] - s.points[i, 1]
    z = s.points[i + 1, 2] - s.points[i, 2]
    return math.sqrt(x * x + y * y + z * z)


@inlined
def _corner(s: Spline, i: int, before: float, after: float) -> float:
    """m, radius of the arc that touches the legs at point ``i`` in the middle of the shorter one."""
    along = 0.0
    for axis in range(3):
        along += (s.points[i, axis] - s.points[i - 1, axis]) * (s.points[i + 1, axis] - s.points[i, axis])
    cosine = min(max(along / (before * after), -1.0), 1.0)
    return 0.5 * min(before, after) * math.sqrt((1.0 + cosine) / max(1.0 - cosine, 1e-9))


@inlined
def _trapezoid(length: float, first: float, last: float, v: float, a: float) -> float:
    """s along a leg with greatest speed ``v`` and acceleration ``a``."""
    peak = math.sqrt(0.5 * (first * first + last * last) + a * length)
    if peak <= v:
        return (2.0 * peak - first - last) / a
    flat = length - (2.0 * v * v - first * first - last * last) / (2.0 * a)
    return (2.0 * v - first - last) / a + max(flat, 0.0) / v


@lean_kernel
def guess_times(s: Spline, limits: Vector, speeds: Vector) -> None:
    """Fill the times of ``s``; ``speeds`` (n + 1,) is room."""
    n = s.times.size
    a = min(limits[THRUST], math.sqrt(limits[FORCE] ** 2 - GRAVITY**2))
    v = limits[SPEED]
    asides = 0.0, 0.0
    for end in range(2):
        i, j = (0, 1) if end == 0 else (n - 1, n)
        closing, square, length = 0.0, 0.0, max(_leg(s, i), LEAST_LEG)
        for axis in range(3):
            closing += s.ends[end, 0, axis] * (s.points[j, axis] - s.points[i, axis]) / length
            square += s.ends[end, 0, axis] ** 2
        closing = max(closing, 0.0)
        aside = math.sqrt(max(square - closing * closing, 0.0))
        asides = (aside, asides[1]) if end == 0 else (asides[0], aside)
        speeds[n * end] = min(closing, v)
    after = _leg(s, 0)
    for i in range(1, n):
        before, after = after, _leg(s, i)
        speeds[i] = min(v, math.sqrt(a * _corner(s, i, before, after)))
    for i in range(n):
        speeds[i + 1] = min(speeds[i + 1], math.sqrt(speeds[i] ** 2 + 2.0 * a * _leg(s, i)))
    for i in range(n - 1, -1, -1):
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2.0 * a * _leg(s, i)))
    for i in range(n):
        s.times[i] = EASE * _trapezoid(max(_leg(s, i), LEAST_LEG), speeds[i], speeds[i + 1], v, a)
    s.times[0] += asides[0] / a
    s.times[n - 1] += asides[1] / a


@inlined
def _moved(s: Spline, i: int, points: Vector, k: int) -> float:
    total = 0.0
    for axis in range(3):
        total += (s.points[i, axis] - points[k, axis]) ** 2
    return math.sqrt(total)


@lean_kernel
def recall_times(s: Spline, points: Vector, times: Vector, elapsed: float) -> bool:
    """Take over the times that the last plan had for legs that are still ahead; False if there are none.

    ``points`` (m + 1, 3) and ``times`` (m,) are those of the last plan, which began ``elapsed`` s before this one.
    """
    n, m = s.times.size, times.size
    reached, k = 0.0, 0
    while k < m and reached <= elapsed:
        reached += times[k]
        k += 1
    while k <= m and _moved(s, 1, points, k) > NEAR * _leg(s, 0) + 0.1:
        if k < m:
            reached += times[k]
        k += 1
    if k > m or reached <= elapsed:
        return False
    s.times[0] = reached - elapsed
    for i in range(1, n):
        if k + i > m or _moved(s, i + 1, points, k + i) > NEAR * _leg(s, i):
            break
        s.times[i] = times[k + i - 1]
    return True
