"""The two poses from which a plane may be seen.

T. Collins and A. Bartoli, "Infinitesimal Plane-Based Pose Estimation" (IJCV 2014): the homography from the
plane to the image, and its derivative in the middle of the points, leave two rotations. The image is that of a
virtual pinhole camera that looks at the points, so that it works at any angle from the optical axis.
"""

import math

import numpy as np

from flightapp.frames import Vector, quat_from_matrix, quat_to_matrix
from flightapp.jit import kernel
from flightapp.linear import factor, substitute

LEAST_COSINE = 0.05
"""Rays further than 87° from the middle of the points cannot be seen by the virtual camera."""

TINY = 1e-12


@kernel
def look_at(x: float, y: float, z: float) -> Vector:
    """The smallest rotation (3, 3) that turns the optical axis into the direction (x, y, z)."""
    n = max(math.sqrt(x * x + y * y + z * z), TINY)
    x, y, z = x / n, y / n, z / n
    s = 1.0 / max(1.0 + z, 1e-9)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - s * x * x, -s * x * y, x
    R[1, 0], R[1, 1], R[1, 2] = -s * x * y, 1.0 - s * y * y, y
    R[2, 0], R[2, 1], R[2, 2] = -x, -y, z
    return R


@kernel
def _multiply(A: Vector, B: Vector, out: Vector) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def _homography(plane: Vector, image: Vector, h: Vector) -> bool:
    """Least squares of the homography ``h`` (8,), row by row with h₃₃ = 1, from ``plane`` to ``image`` (n, 2)."""
    size = scale = 0.0
    for i in range(plane.shape[0]):
        for k in range(2):
            size = max(size, abs(plane[i, k]))
            scale = max(scale, abs(image[i, k]))
    if not (size > TINY and scale > TINY):
        return False
    A, row = np.zeros((8, 8)), np.zeros(8)
    h[:] = 0.0
    for i in range(plane.shape[0]):
        for k in range(2):
            u, v, w = plane[i, 0] / size, plane[i, 1] / size, image[i, k] / scale
            row[:] = 0.0
            row[3 * k], row[3 * k + 1], row[3 * k + 2] = u, v, 1.0
            row[6], row[7] = -w * u * scale, -w * v * scale
            for m in range(8):
                h[m] += row[m] * w
                for n in range(m + 1):
                    A[m, n] += row[m] * row[n]
    if not factor(A):
        return False
    substitute(A, h)
    for k in range(2):
        h[3 * k] *= scale / size
        h[3 * k + 1] *= scale / size
        h[3 * k + 2] *= scale
        h[6 + k] *= scale / size
    return True


@kernel
def _tilts(h: Vector, R_v: Vector) -> tuple[bool, float, float, float, float, float, float]:
    """The part of the rotation that the derivative of ``h`` at the origin leaves, seen along ``R_v``'s axis.

    The upper left four elements, then the two below them up to their common sign.
    """
    p, q = h[2], h[5]
    b00, b01 = R_v[0, 0] - p * R_v[2, 0], R_v[0, 1] - p * R_v[2, 1]
    b10, b11 = R_v[1, 0] - q * R_v[2, 0], R_v[1, 1] - q * R_v[2, 1]
    determinant = b00 * b11 - b01 * b10
    j00, j01, j10, j11 = h[0] - h[6] * p, h[1] - h[7] * p, h[3] - h[6] * q, h[4] - h[7] * q
    a00, a01 = (b11 * j00 - b01 * j10) / determinant, (b11 * j01 - b01 * j11) / determinant
    a10, a11 = (b00 * j10 - b10 * j00) / determinant, (b00 * j11 - b10 * j01) / determinant
    # the inverse of the depth is the larger singular value
    rows, columns, mixed = a00 * a00 + a01 * a01, a10 * a10 + a11 * a11, a00 * a10 + a01 * a11
    gamma = math.sqrt(0.5 * (rows + columns + math.sqrt((rows - columns) ** 2 + 4.0 * mixed * mixed)))
    if not (gamma > TINY and math.isfinite(gamma)):
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r00, r01, r10, r11 = a00 / gamma, a01 / gamma, a10 / gamma, a11 / gamma
    s0 = math.sqrt(max(1.0 - r00 * r00 - r10 * r10, 0.0))
    s1 = math.sqrt(max(1.0 - r01 * r01 - r11 * r11, 0.0))
    if r00 * r01 + r10 * r11 > 0.0:
        s1 = -s1
    return True, r00, r01, r10, r11, s0, s1


@kernel
def _translation(R: Vector, plane: Vector, image: Vector, t: Vector) -> bool:
    """Least squares of the translation ``t`` (3,) for a rotation ``R``."""
    n = plane.shape[0]
    sx = sy = squares = bx = by = mixed = 0.0
    for i in range(n):
        u, v, x, y = plane[i, 0], plane[i, 1], image[i, 0], image[i, 1]
        depth = R[2, 0] * u + R[2, 1] * v
        across = x * depth - R[0, 0] * u - R[0, 1] * v
        down = y * depth - R[1, 0] * u - R[1, 1] * v
        sx, sy, squares = sx + x, sy + y, squares + x * x + y * y
        bx, by, mixed = bx + across, by + down, mixed + x * across + y * down
    spread = squares - (sx * sx + sy * sy) / n
    if not spread > 0.0:
        return False
    t[2] = ((sx * bx + sy * by) / n - mixed) / spread
    t[0] = (bx + t[2] * sx) / n
    t[1] = (by + t[2] * sy) / n
    return True


@kernel
def gate_candidates(points: Vector, rays: Vector, R: Vector, p: Vector) -> int:
    """Both poses of a gate, ``R`` (2, 3, 3) R_cg and ``p`` (2, 3), that ``rays`` (n, 3) to ``points`` (n, 3) leave.

    The points lie in the gate's plane, x = 0, four or more of them and not all on one line. Returns 2, or 0
    where the rays cannot be those of a plane.
    """
    n = points.shape[0]
    ray = np.zeros(3)
    middle_y = middle_z = 0.0
    for i in range(n):
        middle_y += points[i, 1] / n
        middle_z += points[i, 2] / n
        for k in range(3):
            ray[k] += rays[i, k]
    R_cv = look_at(ray[0], ray[1], ray[2])
    plane, image, h = np.empty((n, 2)), np.empty((n, 2)), np.empty(8)
    for i in range(n):
        # on the approach side the gate's left is on the left: right, up and towards the viewer are -y, z and -x
        plane[i, 0], plane[i, 1] = middle_y - points[i, 1], points[i, 2] - middle_z
        depth = rays[i, 0] * R_cv[0, 2] + rays[i, 1] * R_cv[1, 2] + rays[i, 2] * R_cv[2, 2]
        if not depth > LEAST_COSINE:
            return 0
        for k in range(2):
            image[i, k] = (rays[i, 0] * R_cv[0, k] + rays[i, 1] * R_cv[1, k] + rays[i, 2] * R_cv[2, k]) / depth
    if not _homography(plane, image, h):
        return 0
    R_v = look_at(h[2], h[5], 1.0)
    found, r00, r01, r10, r11, s0, s1 = _tilts(h, R_v)
    if not found:
        return 0
    T, R_vp, R_vg, t = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for m in range(2):
        sign = 1.0 - 2.0 * m
        T[0, 0], T[1, 0], T[2, 0] = r00, r10, sign * s0
        T[0, 1], T[1, 1], T[2, 1] = r01, r11, sign * s1
        T[0, 2] = r10 * T[2, 1] - T[2, 0] * r11
        T[1, 2] = T[2, 0] * r01 - r00 * T[2, 1]
        T[2, 2] = r00 * r11 - r10 * r01
        _multiply(R_v, T, R_vp)
        R_vp = quat_to_matrix(quat_from_matrix(R_vp))
        if not _translation(R_vp, plane, image, t):
            return 0
        for i in range(3):
            t[i] += R_vp[i, 0] * middle_y - R_vp[i, 1] * middle_z
            R_vg[i, 0], R_vg[i, 1], R_vg[i, 2] = -R_vp[i, 2], -R_vp[i, 0], R_vp[i, 1]
        _multiply(R_cv, R_vg, R[m])
        for i in range(3):
            p[m, i] = R_cv[i, 0] * t[0] + R_cv[i, 1] * t[1] + R_cv[i, 2] * t[2]
    return 2
