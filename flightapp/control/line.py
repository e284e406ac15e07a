"""The trajectory as the control kernel reads it: packed behind its other numbers, remembered where it was read last."""

import math

import numpy as np

from flightapp.control import layout as at
from flightapp.control.vectors import Triple
from flightapp.frames import Vector
from flightapp.jit import fused, shared
from flightapp.trajectory import ORDER, Trajectory

Reference = tuple[Triple, Triple, Triple, Triple, Triple]
"""Position and its first four derivatives."""
WIDTH = 3 * ORDER
S3, S5, S7 = -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0
C4, C6, C8 = 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0


def packed_line(trajectory: Trajectory) -> Vector:
    """``trajectory``'s numbers from `layout.LINE` on."""
    parts = (trajectory.knots, trajectory.coefficients.transpose(0, 2, 1), trajectory.yaw_knots)
    return np.concatenate([np.ravel(part) for part in (*parts, trajectory.yaw_coefficients)]).astype(float)


@fused
def _segment(m: Vector, knots: int, count: int, kept: int, t: float) -> int:
    """Index of the segment that holds ``t``, looked for from the one read last, which ``m[kept]`` remembers."""
    i = int(m[kept])
    while i < count - 1 and t >= m[knots + i + 1]:
        i += 1
    while i > 0 and t < m[knots + i]:
        i -= 1
    m[kept] = i
    return i


@fused
def _axis(m: Vector, c: int, s: float) -> tuple[float, float, float, float, float]:
    """Value and four derivatives at ``s`` of the polynomial at ``c``, by Horner's scheme for Taylor coefficients."""
    p = m[c + 21]
    v, p = p, p * s + m[c + 18]
    a, v, p = v, v * s + p, p * s + m[c + 15]
    j, a, v, p = a, a * s + v, v * s + p, p * s + m[c + 12]
    n, j, a, v, p = j, j * s + a, a * s + v, v * s + p, p * s + m[c + 9]
    n, j, a, v, p = n * s + j, j * s + a, a * s + v, v * s + p, p * s + m[c + 6]
    n, j, a, v, p = n * s + j, j * s + a, a * s + v, v * s + p, p * s + m[c + 3]
    n, j, a, v, p = n * s + j, j * s + a, a * s + v, v * s + p, p * s + m[c]
    return p, v, 2.0 * a, 6.0 * j, 24.0 * n


@fused
def reference(m: Vector, t: float) -> Reference:
    """The reference ``t`` s after the start; outside of the trajectory its resting first and last point."""
    n = int(m[at.SEGMENTS])
    clamped = min(max(t, m[at.LINE]), m[at.LINE + n])
    i = _segment(m, at.LINE, n, at.SEGMENT, clamped)
    c, s = at.LINE + n + 1 + WIDTH * i, clamped - m[at.LINE + i]
    x, y, z = _axis(m, c, s), _axis(m, c + 1, s), _axis(m, c + 2, s)
    place = (x[0], y[0], z[0])
    if clamped != t:
        return place, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return place, (x[1], y[1], z[1]), (x[2], y[2], z[2]), (x[3], y[3], z[3]), (x[4], y[4], z[4])


@fused
def heading(m: Vector, t: float, lead: float) -> tuple[float, float]:
    """The yaw ``t`` s after the start, and its rate ``lead`` s later."""
    n, turns = int(m[at.SEGMENTS]), int(m[at.TURNS])
    knots = at.LINE + (n + 1) + WIDTH * n
    first, last = m[knots], m[knots + turns]
    clamped = min(max(t, first), last)
    i = _segment(m, knots, turns, at.TURN, clamped)
    c, s = knots + turns + 1 + 4 * i, clamped - m[knots + i]
    yaw = m[c] + s * (m[c + 1] + s * (m[c + 2] + s * m[c + 3]))
    later = min(max(t + lead, first), last)
    while i < turns - 1 and later >= m[knots + i + 1]:
        i += 1
    c, s = knots + turns + 1 + 4 * i, later - m[knots + i]
    rate = m[c + 1] + s * (2.0 * m[c + 2] + s * 3.0 * m[c + 3])
    return yaw, rate if later == t + lead else 0.0


@shared
def direction(angle: float) -> tuple[float, float]:
    """Cosine and sine of ``angle``, to 4e-7: series about the nearest quarter turn, faster than the library."""
    quarters = math.floor(angle * (2.0 / math.pi) + 0.5)
    r = angle - quarters * (0.5 * math.pi)
    r2 = r * r
    sine = r * (1.0 + r2 * (S3 + r2 * (S5 + r2 * S7)))
    cosine = 1.0 + r2 * (-0.5 + r2 * (C4 + r2 * (C6 + r2 * C8)))
    turned = int(quarters) & 3
    c, s = (sine, cosine) if turned & 1 else (cosine, sine)
    return (-c if (turned + 1) & 2 else c), (-s if turned & 2 else s)
