"""Many rotations at once, as rows of Hamilton unit quaternions (n, 4), scalar first."""

import numpy as np

from flightapp.frames import Vector


def multiply(a: Vector, b: Vector) -> Vector:
    """(n, 4) products ``a`` ⊗ ``b``; one of them may be a single quaternion (4,)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b), -1, 0)
    product: Vector = np.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        axis=-1,
    )
    return product


def conjugate(q: Vector) -> Vector:
    """(n, 4) inverses of unit quaternions."""
    inverse: Vector = q * np.array((1.0, -1.0, -1.0, -1.0))
    return inverse


def rotate(q: Vector, v: Vector) -> Vector:
    """(n, 3) vectors ``v`` (n, 3), each turned by its ``q``; one of them may be single."""
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(u, v)
    turned: Vector = v + w * t + np.cross(u, t)
    return turned


def angle(q: Vector) -> Vector:
    """(n,) rad, 0 to π: by how much each ``q`` (n, 4) turns."""
    turn: Vector = 2.0 * np.arctan2(np.linalg.norm(q[:, 1:], axis=1), np.abs(q[:, 0]))
    return turn


def unit(q: Vector) -> Vector:
    """``q`` (n, 4) of length one; raises ValueError where one is zero or not finite."""
    length = np.linalg.norm(q, axis=1, keepdims=True)
    if not np.all(np.isfinite(length) & (length > 1e-9)):
        raise ValueError("an orientation is no quaternion: zero, or not finite")
    scaled: Vector = q / length
    return scaled


def slerp(a: Vector, b: Vector, part: Vector) -> Vector:
    """(n, 4) between ``a`` (part 0) and ``b`` (part 1), the short way; ``part`` is (n,)."""
    step = multiply(conjugate(a), b)
    step = np.where(step[:, :1] < 0.0, -step, step)
    length = np.linalg.norm(step[:, 1:], axis=1)
    half = np.arctan2(length, step[:, 0]) * part
    axis = step[:, 1:] / np.where(length > 0.0, length, 1.0)[:, None]
    return multiply(a, np.column_stack((np.cos(half), np.sin(half)[:, None] * axis)))


def from_yaw(yaw: Vector) -> Vector:
    """(n, 4) turns by ``yaw`` (n,) rad about z."""
    zero = np.zeros_like(yaw)
    return np.stack((np.cos(0.5 * yaw), zero, zero, np.sin(0.5 * yaw)), axis=-1)
