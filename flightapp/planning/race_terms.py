"""What the inequalities of a race line contribute at samples: derivatives by position, velocity, acceleration, jerk.

All of it lies in rows of one flat array, so that compilers see that they do not overlap, and work side by side.
"""

import math

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import fused
from flightapp.planning.race_problem import (
    ACCELERATION,
    ALONG,
    CLEARANCE,
    FLOOR,
    FORCE,
    G2,
    KINDS,
    LEAST_FORCE,
    RATE,
    SPEED,
    TILT,
    Problem,
)
from flightapp.planning.race_rows import (
    AT_AA,
    AT_AWAY,
    AT_FF,
    AT_FJ,
    AT_FOLDED,
    AT_JJ,
    AT_PP,
    AT_PULL,
    AT_PUSH,
    AT_RATIO,
    AT_VV,
    S,
)
from flightapp.planning.race_samples import AT_A, AT_F, AT_J, AT_P, AT_V
from flightapp.planning.race_work import Work


@fused
def _weigh(i: int, mu: float, work: Work, s: Vector) -> None:
    """Fill the rows of ratios and forces."""
    slack, dual, c = work.slack[i], work.dual[i], work.c[i]
    for k in range(KINDS * S):
        inverse = 1.0 / slack[k]
        s[AT_RATIO + k] = dual[k] * inverse
        s[AT_PUSH + k] = (mu + dual[k] * (c[k] + slack[k])) * inverse


@fused
def _add_square(kind: int, at: int, to: int, limits: tuple[float, float], s: Vector, g: Vector, dual: Vector) -> None:
    """Fill ``g`` for an inequality that is the square at rows ``at`` times a limit, and add what it contributes.

    ``limits`` are that and what counts of it in the second derivative. Specific forces have gravity on top.
    """
    limit, bend = limits
    lift = GRAVITY if at == AT_F else 0.0
    for k in range(S):
        ratio, push, own = s[AT_RATIO + kind * S + k], s[AT_PUSH + kind * S + k], 2.0 * bend * dual[kind * S + k]
        x, y, z = 2.0 * limit * s[at + k], 2.0 * limit * s[at + S + k], 2.0 * limit * (s[at + 2 * S + k] + lift)
        g[kind * 6 * S + k], g[kind * 6 * S + S + k], g[kind * 6 * S + 2 * S + k] = x, y, z
        s[AT_PULL + at + k] += push * x
        s[AT_PULL + at + S + k] += push * y
        s[AT_PULL + at + 2 * S + k] += push * z
        s[to + k] += ratio * x * x + own
        s[to + S + k] += ratio * x * y
        s[to + 2 * S + k] += ratio * x * z
        s[to + 3 * S + k] += ratio * y * y + own
        s[to + 4 * S + k] += ratio * y * z
        s[to + 5 * S + k] += ratio * z * z + own


@fused
def _by_tilt(limit: float, s: Vector, g: Vector) -> None:
    for k in range(S):
        x, y, z = s[AT_F + k], s[AT_F + S + k], s[AT_F + 2 * S + k] + GRAVITY
        scale = limit / (GRAVITY * math.sqrt(x * x + y * y + z * z))
        g[TILT * 6 * S + k], g[TILT * 6 * S + S + k] = scale * x, scale * y
        g[TILT * 6 * S + 2 * S + k] = scale * z - 1.0 / GRAVITY


@fused
def _add_floor(s: Vector, g: Vector) -> None:
    for k in range(S):
        g[FLOOR * 6 * S + 2 * S + k] = -1.0
        s[AT_PULL + AT_P + 2 * S + k] -= s[AT_PUSH + FLOOR * S + k]
        s[AT_PP + 5 * S + k] += s[AT_RATIO + FLOOR * S + k]


@fused
def _by_clearance(s: Vector, g: Vector) -> None:
    for k in range(3 * S):
        g[CLEARANCE * 6 * S + k] = -s[AT_AWAY + k]


@fused
def _add_three(kind: int, row: int, at: int, to: int, s: Vector, g: Vector) -> None:
    """Add an inequality by three rows, from ``row`` of its gradients: its force, and its square at ``to``."""
    for k in range(S):
        ratio, push = s[AT_RATIO + kind * S + k], s[AT_PUSH + kind * S + k]
        x, y, z = g[row * S + k], g[row * S + S + k], g[row * S + 2 * S + k]
        s[AT_PULL + at + k] += push * x
        s[AT_PULL + at + S + k] += push * y
        s[AT_PULL + at + 2 * S + k] += push * z
        s[to + k] += ratio * x * x
        s[to + S + k] += ratio * x * y
        s[to + 2 * S + k] += ratio * x * z
        s[to + 3 * S + k] += ratio * y * y
        s[to + 4 * S + k] += ratio * y * z
        s[to + 5 * S + k] += ratio * z * z


@fused
def _bend_across(kind: int, to: int, limit: float, s: Vector, dual: Vector) -> None:
    """Add the second derivative of body rate or tilt: nearly that of a square across the specific force."""
    for k in range(S):
        x, y, z = s[AT_F + k], s[AT_F + S + k], s[AT_F + 2 * S + k] + GRAVITY
        force = x * x + y * y + z * z
        gain = dual[kind * S + k] * limit * (2.0 / G2 if kind == RATE else 1.0 / (GRAVITY * math.sqrt(force)))
        loss = gain * (ALONG if kind == RATE else 1.0) / force
        s[to + k] += gain - loss * x * x
        s[to + S + k] -= loss * x * y
        s[to + 2 * S + k] -= loss * x * z
        s[to + 3 * S + k] += gain - loss * y * y
        s[to + 4 * S + k] -= loss * y * z
        s[to + 5 * S + k] += gain - loss * z * z


@fused
def _by_rate(limit: float, s: Vector, g: Vector) -> None:
    for k in range(S):
        x, y, up = s[AT_F + k], s[AT_F + S + k], s[AT_F + 2 * S + k] + GRAVITY
        a, b, c = s[AT_J + k], s[AT_J + S + k], s[AT_J + 2 * S + k]
        lost = ALONG * (a * x + b * y + c * up) / (x * x + y * y + up * up)
        scale = 2.0 * limit / G2
        fall = 2.0 / G2 - scale * lost * lost / ALONG
        g[RATE * 6 * S + k] = -fall * x - scale * lost * a
        g[RATE * 6 * S + S + k] = -fall * y - scale * lost * b
        g[RATE * 6 * S + 2 * S + k] = -fall * up - scale * lost * c
        g[RATE * 6 * S + 3 * S + k] = scale * (a - lost * x)
        g[RATE * 6 * S + 4 * S + k] = scale * (b - lost * y)
        g[RATE * 6 * S + 5 * S + k] = scale * (c - lost * up)


@fused
def _add_rate(s: Vector, g: Vector) -> None:
    """Add what of the body rate is by acceleration and jerk, both."""
    for k in range(S):
        ratio = s[AT_RATIO + RATE * S + k]
        x, y, z = (
            ratio * g[RATE * 6 * S + k],
            ratio * g[RATE * 6 * S + S + k],
            ratio * g[RATE * 6 * S + 2 * S + k],
        )
        a, b, c = g[RATE * 6 * S + 3 * S + k], g[RATE * 6 * S + 4 * S + k], g[RATE * 6 * S + 5 * S + k]
        s[AT_FJ + k] += x * a
        s[AT_FJ + S + k] += x * b
        s[AT_FJ + 2 * S + k] += x * c
        s[AT_FJ + 3 * S + k] += y * a
        s[AT_FJ + 4 * S + k] += y * b
        s[AT_FJ + 5 * S + k] += y * c
        s[AT_FJ + 6 * S + k] += z * a
        s[AT_FJ + 7 * S + k] += z * b
        s[AT_FJ + 8 * S + k] += z * c


@fused
def sum_samples(i: int, problem: Problem, mu: float, work: Work) -> None:
    """Fill ``work.gradients[i]`` and the rows of sums in ``work.samples`` from segment ``i``'s samples and multipliers.

    Second derivatives of the inequalities count where they are convex.
    """
    s, g, dual, active, limits = work.samples, work.gradients[i], work.dual[i], problem.active, problem.limits[i]
    for k in range(AT_PULL, AT_FOLDED):
        s[k] = 0.0
    _weigh(i, mu, work, s)
    if active[SPEED] != 0.0:
        _add_square(SPEED, AT_V, AT_VV, (limits[SPEED], limits[SPEED]), s, g, dual)
    if active[ACCELERATION] != 0.0:
        _add_square(ACCELERATION, AT_A, AT_AA, (limits[ACCELERATION], limits[ACCELERATION]), s, g, dual)
    if active[FORCE] != 0.0:
        _add_square(FORCE, AT_F, AT_FF, (limits[FORCE], limits[FORCE]), s, g, dual)
    if active[LEAST_FORCE] != 0.0:
        _add_square(LEAST_FORCE, AT_F, AT_FF, (-1.0 / G2, 0.0), s, g, dual)
    if active[RATE] != 0.0:
        _by_rate(limits[RATE], s, g)
        _add_three(RATE, 6 * RATE, AT_F, AT_FF, s, g)
        _add_three(RATE, 6 * RATE + 3, AT_J, AT_JJ, s, g)
        _add_rate(s, g)
        _bend_across(RATE, AT_JJ, limits[RATE], s, dual)
    if active[TILT] != 0.0:
        _by_tilt(limits[TILT], s, g)
        _add_three(TILT, 6 * TILT, AT_F, AT_FF, s, g)
        _bend_across(TILT, AT_FF, limits[TILT], s, dual)
    if active[FLOOR] != 0.0:
        _add_floor(s, g)
    if active[CLEARANCE] != 0.0:
        for k in range(4 * S):
            s[AT_AWAY + k] = work.near[i, k]
        _by_clearance(s, g)
        _add_three(CLEARANCE, 6 * CLEARANCE, AT_P, AT_PP, s, g)
