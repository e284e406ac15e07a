"""Vectors and rotations as tuples, which kernels keep in registers: no allocation on the way to a command."""

import math

from flightapp.jit import shared

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
SIXTH = 1.0 / 6.0


@shared
def dot(a: Triple, b: Triple) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@shared
def cross(a: Triple, b: Triple) -> Triple:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@shared
def along(a: Triple, s: float, b: Triple) -> Triple:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@shared
def scaled(s: float, a: Triple) -> Triple:
    """s a."""
    return s * a[0], s * a[1], s * a[2]


@shared
def axes(q: Quaternion) -> tuple[Triple, Triple, Triple]:
    """The body's x, y and z axes in the world, of a unit quaternion q_wb."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@shared
def product(q: Quaternion, r: Quaternion) -> Quaternion:
    """q ⊗ r."""
    return (
        q[0] * r[0] - q[1] * r[1] - q[2] * r[2] - q[3] * r[3],
        q[0] * r[1] + q[1] * r[0] + q[2] * r[3] - q[3] * r[2],
        q[0] * r[2] - q[1] * r[3] + q[2] * r[0] + q[3] * r[1],
        q[0] * r[3] + q[1] * r[2] - q[2] * r[1] + q[3] * r[0],
    )


@shared
def unit(q: Quaternion) -> Quaternion:
    """``q`` (not 0) at length 1."""
    n = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return n * q[0], n * q[1], n * q[2], n * q[3]


@shared
def small_turn(angle: Triple) -> Quaternion:
    """The turn by the rotation vector ``angle`` (rad), of length 1 to 1e-5 for turns up to 0.3 rad.

    Sine and cosine are cut after the third order.
    """
    x, y, z = scaled(0.5, angle)
    square = x * x + y * y + z * z
    s = 1.0 - SIXTH * square
    return 1.0 - 0.5 * square, s * x, s * y, s * z


@shared
def turned(q: Quaternion, rates: Triple, duration: float) -> Quaternion:
    """``q`` (q_wb) after turning at ``rates`` (rad/s, body) for ``duration`` s, by a `small_turn`, normalised."""
    return unit(product(q, small_turn(scaled(duration, rates))))
