"""Every frame and rotation convention, in one place.

World: x forward at start, y left, z up. Body: x forward, y left, z up (FLU). Camera: optical axes
(x right, y down, z forward). Gate: x in the direction of passage, y left, z up, origin in the centre of
the opening. Quaternions are Hamilton, unit and scalar first: ``q_wb`` turns a body vector into a world
vector, and ``R_wb`` is its matrix. NED and FRD appear only in ``autopilot/``, which converts with
`flip_yz`.

All functions are compiled and can be called from Python and from other kernels.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.jit import kernel

Vector = NDArray[np.float64]

GRAVITY = 9.80665
"""Standard gravity in m/s²."""

R_BODY_OPTICAL: Vector = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Optical axes in body axes for a camera that looks straight ahead."""


@kernel
def quat_multiply(a: Vector, b: Vector) -> Vector:
    """Hamilton product ``a ⊗ b`` of quaternions (4,)."""
    return np.array(
        (
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        )
    )


@kernel
def quat_conjugate(q: Vector) -> Vector:
    """Inverse of a unit quaternion (4,)."""
    return np.array((q[0], -q[1], -q[2], -q[3]))


@kernel
def quat_normalize(q: Vector) -> Vector:
    """Unit quaternion (4,) along ``q``; the identity where ``q`` is zero."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if n < 1e-12:
        return np.array((1.0, 0.0, 0.0, 0.0))
    return q / n


@kernel
def quat_rotate(q: Vector, v: Vector) -> Vector:
    """Vector ``v`` (3,) turned by ``q`` (4,)."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    return np.array(
        (
            v[0] + q[0] * tx + q[2] * tz - q[3] * ty,
            v[1] + q[0] * ty + q[3] * tx - q[1] * tz,
            v[2] + q[0] * tz + q[1] * ty - q[2] * tx,
        )
    )


@kernel
def quat_rotate_inverse(q: Vector, v: Vector) -> Vector:
    """Vector ``v`` (3,) turned by the inverse of ``q`` (4,)."""
    return quat_rotate(quat_conjugate(q), v)


@kernel
def quat_to_matrix(q: Vector) -> Vector:
    """Rotation matrix (3, 3) of a unit quaternion (4,)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R = np.empty((3, 3))
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return R


@kernel
def quat_from_matrix(R: Vector) -> Vector:
    """Unit quaternion (4,), w ≥ 0, of a rotation matrix (3, 3), by Shepperd's method."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    q = np.empty(4)
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        q[0] = 0.25 * s
        q[1] = (R[2, 1] - R[1, 2]) / s
        q[2] = (R[0, 2] - R[2, 0]) / s
        q[3] = (R[1, 0] - R[0, 1]) / s
    else:
        i = 0
        if R[1, 1] > R[0, 0]:
            i = 1
        if R[2, 2] > R[i, i]:
            i = 2
        j = (i + 1) % 3
        k = (i + 2) % 3
        s = 2.0 * math.sqrt(max(1.0 + R[i, i] - R[j, j] - R[k, k], 1e-30))
        q[0] = (R[k, j] - R[j, k]) / s
        q[1 + i] = 0.25 * s
        q[1 + j] = (R[j, i] + R[i, j]) / s
        q[1 + k] = (R[k, i] + R[i, k]) / s
    if q[0] < 0.0:
        q = -q
    return quat_normalize(q)


@kernel
def quat_from_rotvec(r: Vector) -> Vector:
    """Unit quaternion (4,) of a rotation vector (3,) in radians."""
    angle = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    half = 0.5 * angle
    scale = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(half) / angle
    return np.array((math.cos(half), scale * r[0], scale * r[1], scale * r[2]))


@kernel
def quat_to_rotvec(q: Vector) -> Vector:
    """Rotation vector (3,) in radians, |r| ≤ π, of a unit quaternion (4,)."""
    sign = 1.0 if q[0] >= 0.0 else -1.0
    n = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if n < 1e-9:
        return np.array((2.0 * sign * q[1], 2.0 * sign * q[2], 2.0 * sign * q[3]))
    scale = 2.0 * sign * math.atan2(n, abs(q[0])) / n
    return np.array((scale * q[1], scale * q[2], scale * q[3]))


@kernel
def quat_from_yaw(yaw: float) -> Vector:
    """Unit quaternion (4,) of a turn by ``yaw`` about the world's z."""
    return np.array((math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)))


@kernel
def quat_from_euler(roll: float, pitch: float, yaw: float) -> Vector:
    """Unit quaternion (4,) of intrinsic z-y-x turns by yaw, pitch and roll, in radians."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return np.array(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def quat_to_euler(q: Vector) -> tuple[float, float, float]:
    """Roll, pitch and yaw in radians of intrinsic z-y-x turns, of a unit quaternion (4,)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    sine = 2.0 * (w * y - z * x)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.atan2(sine, math.sqrt(max(1.0 - sine * sine, 0.0)))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@kernel
def quat_yaw(q: Vector) -> float:
    """Heading in radians of the body's x axis."""
    return math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))


@kernel
def wrap_angle(angle: float) -> float:
    """The same angle in [−π, π)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@kernel
def slerp(a: Vector, b: Vector, fraction: float) -> Vector:
    """Spherical interpolation from ``a`` (fraction 0) to ``b`` (fraction 1) the short way."""
    step = quat_to_rotvec(quat_multiply(quat_conjugate(a), b))
    return quat_multiply(a, quat_from_rotvec(fraction * step))


@kernel
def flip_yz(v: Vector) -> Vector:
    """FLU ↔ FRD, and this world ↔ its local NED: y and z change sign (its own inverse)."""
    return np.array((v[0], -v[1], -v[2]))


def camera_mount(pitch_up: float, roll: float = 0.0, yaw: float = 0.0) -> Vector:
    """Matrix R_bc (3, 3) of a camera that looks ahead, tilted up by ``pitch_up`` radians."""
    R_tilt = quat_to_matrix(quat_from_euler(roll, -pitch_up, yaw))
    mount: Vector = R_tilt @ R_BODY_OPTICAL
    return mount
