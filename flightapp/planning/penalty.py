"""What a motion exceeds the limits by, and how that changes with the coefficients of its polynomial.

Speed, acceleration, specific force (greatest and least) and body rate (|jerk| ≤ rate · |specific force|, from
differential flatness: D. Mellinger and V. Kumar, 2011) are compared with their limits at samples of each piece.
"""

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import inlined
from flightapp.planning.hermite import SLOPES, Order
from flightapp.trajectory import ORDER

SPEED, THRUST, FORCE, LEAST, RATE = 0, 1, 2, 3, 4
"""Places in an array of limits (5,): m/s, m/s² of acceleration, m/s² of specific force, least of it, rad/s."""

Weights = tuple[float, float, float, float, float, float]
"""1/v², 1/a², 1/f², 1/least², 1/(ω g)² and ω²."""


@inlined
def weights_of(limits: Vector) -> Weights:
    """Of limits (5,), what `penalties` compares with."""
    rate = limits[RATE]
    return (
        limits[SPEED] ** -2,
        limits[THRUST] ** -2,
        limits[FORCE] ** -2,
        limits[LEAST] ** -2,
        (rate * GRAVITY) ** -2,
        rate * rate,
    )


@inlined
def _slopes(
    order: Order, u: float, c1: float, c2: float, c3: float, c4: float, c5: float, c6: float, c7: float
) -> tuple[float, float, float]:
    """First to third derivative at ``u`` of a polynomial of degree 2 d + 1."""
    if len(order) == 1:
        return c1 + u * (2.0 * c2 + u * 3.0 * c3), 2.0 * c2 + u * 6.0 * c3, 6.0 * c3
    if len(order) == 2:
        v = c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))
        a = 2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))
        return v, a, 6.0 * c3 + u * (24.0 * c4 + u * 60.0 * c5)
    v = c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * (5.0 * c5 + u * (6.0 * c6 + u * 7.0 * c7)))))
    a = 2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * (20.0 * c5 + u * (30.0 * c6 + u * 42.0 * c7))))
    return v, a, 6.0 * c3 + u * (24.0 * c4 + u * (60.0 * c5 + u * (120.0 * c6 + u * 210.0 * c7)))


@inlined
def _above(excess: float) -> float:
    return excess if excess > 0.0 else 0.0


@inlined
def penalties(order: Order, t: float, c: Vector, places: Vector, weights: Weights, out: Vector) -> None:
    """Fill ``out`` (≥ k,) with the sum of the squared excesses at each of ``places`` (k,) of a segment of ``t`` s.

    Its coefficients ``c`` (8, 3) are of degree 2 d + 1. Nothing else is stored, so that this becomes one loop of
    vector instructions.
    """
    w_speed, w_thrust, w_force, w_least, w_rate, square = weights
    x1, x2, x3, x4, x5, x6, x7 = c[1, 0], c[2, 0], c[3, 0], c[4, 0], c[5, 0], c[6, 0], c[7, 0]
    y1, y2, y3, y4, y5, y6, y7 = c[1, 1], c[2, 1], c[3, 1], c[4, 1], c[5, 1], c[6, 1], c[7, 1]
    z1, z2, z3, z4, z5, z6, z7 = c[1, 2], c[2, 2], c[3, 2], c[4, 2], c[5, 2], c[6, 2], c[7, 2]
    scale = 1.0 / (t * t)
    w_speed *= scale
    w_jerk = w_rate * scale * scale * scale
    for k in range(places.size):
        u = places[k]
        vx, ax, jx = _slopes(order, u, x1, x2, x3, x4, x5, x6, x7)
        vy, ay, jy = _slopes(order, u, y1, y2, y3, y4, y5, y6, y7)
        vz, az, jz = _slopes(order, u, z1, z2, z3, z4, z5, z6, z7)
        ax, ay, az = scale * ax, scale * ay, scale * az
        flat, up = ax * ax + ay * ay, az + GRAVITY
        force = flat + up * up
        e0 = _above((vx * vx + vy * vy + vz * vz) * w_speed - 1.0)
        e1 = _above((flat + az * az) * w_thrust - 1.0)
        e2 = _above(force * w_force - 1.0)
        e3 = _above(1.0 - force * w_least)
        e4 = _above((jx * jx + jy * jy + jz * jz) * w_jerk - square * w_rate * force)
        out[k] = e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3 + e4 * e4


@inlined
def motion_at(k: int, t: float, c: Vector, motion: Vector) -> None:
    """Fill ``motion`` (3, 3) with v, a and j at place ``k`` of the dense ones, of a segment of ``t`` s."""
    scale = 1.0
    for d in range(3):
        scale /= t
        for axis in range(3):
            total = 0.0
            for m in range(1, ORDER):
                total += SLOPES[k, d, m] * c[m, axis]
            motion[d, axis] = scale * total


@inlined
def pull(k: int, t: float, motion: Vector, weights: Weights, scale: float, g: Vector) -> float:
    """Add to ``g`` (8, 3) ``scale`` times the gradient of the penalty of ``motion`` at place ``k`` by coefficients.

    Returns that by the segment's duration ``t`` at fixed coefficients.
    """
    w_speed, w_thrust, w_force, w_least, w_rate, square = weights
    v, a, j = motion[0], motion[1], motion[2]
    flat, up = a[0] * a[0] + a[1] * a[1], a[2] + GRAVITY
    force = flat + up * up
    on_v = 4.0 * scale * _above((v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) * w_speed - 1.0) * w_speed
    on_a = 4.0 * scale * _above((flat + a[2] * a[2]) * w_thrust - 1.0) * w_thrust
    on_j = 4.0 * scale * _above((j[0] * j[0] + j[1] * j[1] + j[2] * j[2] - square * force) * w_rate) * w_rate
    on_f = 4.0 * scale * (_above(force * w_force - 1.0) * w_force - _above(1.0 - force * w_least) * w_least)
    on_f -= on_j * square
    by_time, t1 = 0.0, 1.0 / t
    for axis in range(3):
        gv, gj = on_v * v[axis] * t1, on_j * j[axis] * t1
        ga = (on_a * a[axis] + on_f * (a[axis] + GRAVITY if axis == 2 else a[axis])) * t1
        by_time -= gv * v[axis] + 2.0 * ga * a[axis] + 3.0 * gj * j[axis]
        ga, gj = ga * t1, gj * t1 * t1
        for m in range(1, ORDER):
            g[m, axis] += gv * SLOPES[k, 0, m] + ga * SLOPES[k, 1, m] + gj * SLOPES[k, 2, m]
    return by_time
