"""How a line goes on at the rate at which it is flown along: progress, its bounds, and what the line then needs."""

import math

from flightapp.control import layout as at
from flightapp.control.line import Reference, heading, reference
from flightapp.control.mpc_horizon import needed
from flightapp.control.mpcc_work import Contour, ContourWork
from flightapp.control.parameters import Parameters
from flightapp.control.vectors import Triple, along, dot, scaled
from flightapp.frames import Vector
from flightapp.jit import fused, lean_kernel

RETURN = 3.0
"""1/s, rate at which a progress that is too far from the line's time comes back."""
SLOWEST = 0.3
"""m/s, below which a line has no direction."""
SAMPLES = 8
"""Of the speed in each segment."""


@fused
def contour_from(a: Vector) -> Contour:
    """The `Contour` whose values are in ``a`` (10,)."""
    return Contour(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9])


@lean_kernel
def top_speed(m: Vector) -> float:
    """m/s, the greatest speed of the line in ``m``, nearly."""
    n, top = int(m[at.SEGMENTS]), 0.0
    for i in range(n):
        begin, end = m[at.LINE + i], m[at.LINE + i + 1]
        for k in range(SAMPLES):
            _, v, _, _, _ = reference(m, begin + (k + 0.5) / SAMPLES * (end - begin))
            top = max(top, dot(v, v))
    return math.sqrt(top)


@fused
def _bounded(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@fused
def rate_bounds(c: Contour, top: float, speed: float, lead: float, over: bool) -> tuple[float, float]:
    """Least and greatest rate of the progress where the line has this ``speed`` and the progress this ``lead`` (s).

    The line is never flown along faster than at its ``top`` speed (m/s). Where it is ``over``, or has not begun, the
    lead is given up.
    """
    back = _bounded(1.0 - RETURN * lead, c.rate_min, c.rate_max)
    if over:
        return back, back
    far = c.reach / max(speed, SLOWEST)
    high = _bounded(1.0 + RETURN * (min(c.ahead, far) - lead), c.rate_min, c.rate_max)
    high = min(high, max(top / max(speed, SLOWEST), 1.0))
    return min(max(c.rate_min, 1.0 - RETURN * (min(c.behind, far) + lead)), high), high


@fused
def stiffness(c: Contour, line: Vector, first: int, t: float, speed: float) -> tuple[float, int]:
    """Share of the bandwidths at the time ``t`` of the line, and the place in ``line`` of the nearest gate by then.

    ``first`` is such a place for an earlier time.
    """
    k = first
    while k + 1 < line.shape[0] and abs(line[k + 1] - t) <= abs(line[k] - t):
        k += 1
    if line.shape[0] < 2:
        return c.away, k
    away = (line[k] - t) * speed / c.zone
    return c.away + (c.near - c.away) / (1.0 + away * away * (1.0 + away * away)), k


@fused
def _at_rate(goal: Reference, s: float) -> Reference:
    """The motion ``goal`` at the rate ``s``."""
    p, v, a, j, n = goal
    return p, scaled(s, v), scaled(s * s, a), scaled(s * s * s, j), scaled(s * s * s * s, n)


@fused
def look_along(p: Parameters, m: Vector, begin: float, lead: float, push: Triple, work: ContourWork) -> None:
    """Fill `reference`, `asked` and the `bounds` of the rates of ``work`` for the line in ``m``, from ``begin`` s on.

    ``lead`` (s) is by how much that is ahead of the line's own time. The progress carried on is in `rates`, and is put
    within its bounds. As in the flatness controller position errors beyond `error_max` count no more.
    """
    c, n = contour_from(work.contour), work.u.shape[0]
    first, _, _, _, _ = reference(m, begin)
    x = work.x[0]
    away = (first[0] - x[2], first[1] - x[3], first[2] - x[4])
    beyond = 1.0 - min(1.0, p.error_max / max(math.sqrt(dot(away, away)), 1e-9))
    start, final = m[at.LINE], m[at.LINE + int(m[at.SEGMENTS])]
    t, before, gate = begin, work.rates[0], 1
    for k in range(n):
        h, row, bounds = work.grid[k, 0], work.reference[k + 1], work.bounds[k]
        own = begin - lead + work.grid[k, 4] + 0.5 * h
        _, v, _, _, _ = reference(m, t + h * before)
        speed = math.sqrt(dot(v, v))
        low, high = rate_bounds(c, work.line[0], speed, t + h * before - own, t < start or t >= final)
        bounds[0, 4], bounds[1, 4] = low, high
        rate = work.rates[k + 1] = _bounded(work.rates[k + 1], low, high)
        mean = 0.5 * (before + rate)
        _ask(p, m, t + 0.25 * h * (before + mean), mean, push, work.asked[k])
        t += h * mean
        gate = _fill(p, m, t, rate, push, row, work, gate)
        row[0], row[1], row[2] = along((row[0], row[1], row[2]), -beyond, away)
        before = rate


@fused
def _ask(p: Parameters, m: Vector, t: float, rate: float, push: Triple, asked: Vector) -> None:
    """What body rates (world) and thrust the line needs at its time ``t``, at a ``rate``."""
    yaw, yaw_rate = heading(m, t, p.yaw_lead)
    _, _, omega, _, thrust, thrust_rate = needed(p, _at_rate(reference(m, t), rate), yaw, rate * yaw_rate, push)
    asked[0], asked[1], asked[2] = omega
    asked[3] = thrust + p.thrust_lead * thrust_rate


@fused
def _fill(p: Parameters, m: Vector, t: float, rate: float, push: Triple, row: Vector, work: ContourWork, k: int) -> int:
    """The reference ``row`` of the line's time ``t``; the place of its gate after ``k``."""
    goal, (yaw, _) = reference(m, t), heading(m, t, 0.0)
    z, x, _, weight, thrust, _ = needed(p, _at_rate(goal, rate), yaw, 0.0, push)
    speed = math.sqrt(dot(goal[1], goal[1]))
    row[0], row[1], row[2] = goal[0]
    row[3], row[4], row[5] = goal[1]
    row[6], row[7], row[8] = z
    row[9], row[10], row[11] = x
    row[12], row[13] = thrust, weight
    row[14], row[15], row[16] = goal[2]
    row[17] = t
    row[18], gate = stiffness(contour_from(work.contour), work.line, k, t, speed)
    row[19], row[20], row[21] = scaled(1.0 / max(speed, SLOWEST), goal[1])
    return gate
