"""Vectors and rotations as tuples, which kernels keep in registers: no allocation on the way to a command."""

import math

from flightapp.jit import kernel

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@kernel
def dot(a: Triple, b: Triple) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Triple, b: Triple) -> Triple:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def along(a: Triple, s: float, b: Triple) -> Triple:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@kernel
def scaled(s: float, a: Triple) -> Triple:
    """s a."""
    return s * a[0], s * a[1], s * a[2]


@kernel
def axes(q: Quaternion) -> tuple[Triple, Triple, Triple]:
    """The body's x, y and z axes in the world, of a unit quaternion q_wb."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@kernel
def turned(q: Quaternion, rates: Triple, duration: float) -> Quaternion:
    """``q`` (q_wb) after turning at ``rates`` (rad/s, body) for ``duration`` s, normalised.

    Sine and cosine are cut after the third order, which is exact to 1e-6 rad for turns up to 0.1 rad.
    """
    h = 0.5 * duration
    x, y, z = h * rates[0], h * rates[1], h * rates[2]
    n2 = x * x + y * y + z * z
    s = 1.0 - n2 / 6.0
    dw, dx, dy, dz = 1.0 - 0.5 * n2, s * x, s * y, s * z
    w = q[0] * dw - q[1] * dx - q[2] * dy - q[3] * dz
    i = q[0] * dx + q[1] * dw + q[2] * dz - q[3] * dy
    j = q[0] * dy - q[1] * dz + q[2] * dw + q[3] * dx
    k = q[0] * dz + q[1] * dy - q[2] * dx + q[3] * dw
    n = 1.0 / math.sqrt(w * w + i * i + j * j + k * k)
    return n * w, n * i, n * j, n * k
