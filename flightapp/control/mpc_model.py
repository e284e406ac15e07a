"""The vehicle that a horizon is planned for: one step of its motion, and how that changes with state and input.

The model is that of `prediction`: body rates and thrust follow their commands with first-order lags, and the body moves
under thrust, linear drag, gravity and a steady push. A state is position, velocity, q_wb, body rates and specific
thrust (14 numbers), its small changes have the 13 components position, velocity, turn (of the body, in its own
axes), body rates and thrust; an input is three commanded body rates and the commanded specific force.
"""

from flightapp.control.foresight import model_acceleration
from flightapp.control.parameters import Parameters
from flightapp.control.prediction import lagged
from flightapp.control.riccati import WIDE, places
from flightapp.control.vectors import Triple, along, axes, dot, scaled, turned
from flightapp.frames import Vector
from flightapp.jit import fused

STATE, TANGENT, INPUTS = 14, 13, 4
GRID = 5
"""Numbers of a step: its duration (s), what the lags of rates, yaw rate and thrust leave, s from now to its middle."""
CHANGES = 48
"""Numbers of a step's derivatives, matrices of 3 × 3 column by column; see `linearise`."""

Columns = tuple[Triple, Triple, Triple]


@fused
def _mean_rates(x: Vector, u: Vector, g: Vector) -> Triple:
    """Mean of the body rates before and after a step."""
    return (
        0.5 * (x[10] + lagged(x[10], u[0], g[1])),
        0.5 * (x[11] + lagged(x[11], u[1], g[1])),
        0.5 * (x[12] + lagged(x[12], u[2], g[2])),
    )


@fused
def step(p: Parameters, x: Vector, u: Vector, g: Vector, push: Triple, out: Vector) -> None:
    """The state ``out`` after the step ``g`` (GRID,) from ``x`` under the input ``u``, by the midpoint rule.

    ``push`` is an acceleration (world, m/s²) from outside.
    """
    h = g[0]
    velocity, mean = (x[3], x[4], x[5]), _mean_rates(x, u, g)
    middle = turned((x[6], x[7], x[8], x[9]), mean, 0.5 * h)
    thrust = lagged(x[13], u[3], g[3])
    drag = (p.drag_x, p.drag_y, p.drag_z)
    a = model_acceleration(drag, axes(middle), velocity, 0.5 * (x[13] + thrust), push)
    out[0], out[1], out[2] = along(along((x[0], x[1], x[2]), h, velocity), 0.5 * h * h, a)
    out[3], out[4], out[5] = along(velocity, h, a)
    out[6], out[7], out[8], out[9] = turned(middle, mean, 0.5 * h)
    out[10], out[11], out[12] = along(scaled(2.0, mean), -1.0, (x[10], x[11], x[12]))
    out[13] = thrust


@fused
def difference(x: Vector, y: Vector, out: Vector) -> None:
    """The change ``out`` (13,) that leads from the state ``x`` to ``y``."""
    for i in range(6):
        out[i] = y[i] - x[i]
    w = x[6] * y[6] + x[7] * y[7] + x[8] * y[8] + x[9] * y[9]
    twice = 2.0 if w >= 0.0 else -2.0
    out[6] = twice * (x[6] * y[7] - x[7] * y[6] - x[8] * y[9] + x[9] * y[8])
    out[7] = twice * (x[6] * y[8] + x[7] * y[9] - x[8] * y[6] - x[9] * y[7])
    out[8] = twice * (x[6] * y[9] - x[7] * y[8] + x[8] * y[7] - x[9] * y[6])
    for i in range(4):
        out[9 + i] = y[10 + i] - x[10 + i]


@fused
def _series(v: Triple, first: float, second: float) -> Columns:
    """I - ``first`` [v]× + ``second`` [v]×², column by column."""
    x, y, z = v
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    xx, yy, zz = second * x * x, second * y * y, second * z * z
    return (
        (1.0 - yy - zz, xy - first * z, xz + first * y),
        (xy + first * z, 1.0 - xx - zz, yz - first * x),
        (xz - first * y, yz + first * x, 1.0 - xx - yy),
    )


@fused
def _product(a: Columns, b: Columns) -> Columns:
    return _times(a, b[0]), _times(a, b[1]), _times(a, b[2])


@fused
def _times(a: Columns, v: Triple) -> Triple:
    return along(along(scaled(v[0], a[0]), v[1], a[1]), v[2], a[2])


@fused
def _keep(j: Vector, first: int, columns: Columns, scale: float) -> None:
    for c in range(3):
        j[first + 3 * c], j[first + 3 * c + 1], j[first + 3 * c + 2] = scaled(scale, columns[c])


@fused
def linearise(p: Parameters, x: Vector, u: Vector, g: Vector, j: Vector) -> None:
    """The derivatives ``j`` (CHANGES,) of `step` at ``x`` and ``u``.

    They are, from 0, 9, 18, 27, 36 and 45 on: of the acceleration by velocity, turn and mean rates; of the turn
    after the step by the turn before and by the mean rates; of the acceleration by the mean thrust. Turns of a
    step are small, so that the series of the rotation and of its derivative are cut after the second order.
    """
    h, mean = g[0], _mean_rates(x, u, g)
    body = axes(turned((x[6], x[7], x[8], x[9]), mean, 0.5 * h))
    velocity = (x[3], x[4], x[5])
    vx, vy, vz = dot(body[0], velocity), dot(body[1], velocity), dot(body[2], velocity)
    dx, dy, dz = p.drag_x, p.drag_y, p.drag_z
    force = (-dx * vx, -dy * vy, 0.5 * (x[13] + lagged(x[13], u[3], g[3])) - dz * vz)
    # Turning the body by θ adds θ × force, and drag of the velocity that it then sees.
    by_turn = _product(
        body,
        (
            (0.0, -force[2] - dy * vz, force[1] + dz * vy),
            (force[2] + dx * vz, 0.0, -force[0] - dz * vx),
            (-force[1] - dx * vy, force[0] + dy * vx, 0.0),
        ),
    )
    half, whole = scaled(0.5 * h, mean), scaled(h, mean)
    for c in range(3):
        column = along(scaled(-dx * body[0][c], body[0]), -dy * body[1][c], body[1])
        j[3 * c], j[3 * c + 1], j[3 * c + 2] = along(column, -dz * body[2][c], body[2])
    _keep(j, 9, _product(by_turn, _series(half, 1.0, 0.5)), 1.0)
    _keep(j, 18, _product(by_turn, _series(half, 0.5, 1.0 / 6.0)), 0.5 * h)
    _keep(j, 27, _series(whole, 1.0, 0.5), 1.0)
    _keep(j, 36, _series(whole, 0.5, 1.0 / 6.0), h)
    j[45], j[46], j[47] = body[2]


@fused
def pull_back(j: Vector, g: Vector, rows: Vector, out: Vector) -> None:
    """``out`` (17 WIDE,) = Fᵀ ``rows`` (13 WIDE,), where F (13, 17) are a step's derivatives by state and input.

    F is never written out: position and velocity change with the acceleration alone, and rates and thrust with the mean
    of what they were and are.
    """
    h = g[0]
    hh = 0.5 * h * h
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = j[0], j[1], j[2], j[3], j[4], j[5], j[6], j[7], j[8]
    b00, b01, b02, b10, b11, b12, b20, b21, b22 = j[9], j[10], j[11], j[12], j[13], j[14], j[15], j[16], j[17]
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = j[18], j[19], j[20], j[21], j[22], j[23], j[24], j[25], j[26]
    d00, d01, d02, d10, d11, d12, d20, d21, d22 = j[27], j[28], j[29], j[30], j[31], j[32], j[33], j[34], j[35]
    e00, e01, e02, e10, e11, e12, e20, e21, e22 = j[36], j[37], j[38], j[39], j[40], j[41], j[42], j[43], j[44]
    f0, f1, f2 = j[45], j[46], j[47]
    rate, yaw, lift = g[1], g[2], g[3]
    rate_mean, yaw_mean, lift_mean = 0.5 * (1.0 + rate), 0.5 * (1.0 + yaw), 0.5 * (1.0 + lift)
    for c in range(places(rows, TANGENT)):
        p0, p1, p2 = rows[c], rows[WIDE + c], rows[2 * WIDE + c]
        v0, v1, v2 = rows[3 * WIDE + c], rows[4 * WIDE + c], rows[5 * WIDE + c]
        t0, t1, t2 = rows[6 * WIDE + c], rows[7 * WIDE + c], rows[8 * WIDE + c]
        s0, s1, s2 = hh * p0 + h * v0, hh * p1 + h * v1, hh * p2 + h * v2
        out[c], out[WIDE + c], out[2 * WIDE + c] = p0, p1, p2
        out[3 * WIDE + c] = h * p0 + v0 + a00 * s0 + a01 * s1 + a02 * s2
        out[4 * WIDE + c] = h * p1 + v1 + a10 * s0 + a11 * s1 + a12 * s2
        out[5 * WIDE + c] = h * p2 + v2 + a20 * s0 + a21 * s1 + a22 * s2
        out[6 * WIDE + c] = b00 * s0 + b01 * s1 + b02 * s2 + d00 * t0 + d01 * t1 + d02 * t2
        out[7 * WIDE + c] = b10 * s0 + b11 * s1 + b12 * s2 + d10 * t0 + d11 * t1 + d12 * t2
        out[8 * WIDE + c] = b20 * s0 + b21 * s1 + b22 * s2 + d20 * t0 + d21 * t1 + d22 * t2
        m0 = c00 * s0 + c01 * s1 + c02 * s2 + e00 * t0 + e01 * t1 + e02 * t2
        m1 = c10 * s0 + c11 * s1 + c12 * s2 + e10 * t0 + e11 * t1 + e12 * t2
        m2 = c20 * s0 + c21 * s1 + c22 * s2 + e20 * t0 + e21 * t1 + e22 * t2
        w0, w1, w2, f = rows[9 * WIDE + c], rows[10 * WIDE + c], rows[11 * WIDE + c], rows[12 * WIDE + c]
        out[9 * WIDE + c] = rate_mean * m0 + rate * w0
        out[10 * WIDE + c] = rate_mean * m1 + rate * w1
        out[11 * WIDE + c] = yaw_mean * m2 + yaw * w2
        out[13 * WIDE + c] = (1.0 - rate_mean) * m0 + (1.0 - rate) * w0
        out[14 * WIDE + c] = (1.0 - rate_mean) * m1 + (1.0 - rate) * w1
        out[15 * WIDE + c] = (1.0 - yaw_mean) * m2 + (1.0 - yaw) * w2
        up = f0 * s0 + f1 * s1 + f2 * s2
        out[12 * WIDE + c] = lift_mean * up + lift * f
        out[16 * WIDE + c] = (1.0 - lift_mean) * up + (1.0 - lift) * f
