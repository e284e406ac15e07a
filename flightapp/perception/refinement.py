"""Least-squares refinement of a pose: Levenberg–Marquardt on the reprojection error.

Works on rays, whatever the lens. The error of a corner is measured in the plane across the ray through which
it was seen, and scaled to pixels by the lens's derivative there; for errors of a few pixels that equals the
reprojection error, at any angle from the optical axis.
"""

import math

import numpy as np

from flightapp.frames import Vector, quat_from_rotvec, quat_to_matrix
from flightapp.jit import assign, kernel
from flightapp.linear import factor, substitute
from flightapp.perception.camera import CameraModel

STEP = 1e-5
"""Half of the central difference that gives the lens's derivative, as a fraction of the unit ray."""

ITERATIONS = 25
CONVERGED = 1e-9
"""Step, in units of the distance and in radians, at which the refinement ends."""


def corner_weights(camera: CameraModel, rays: Vector) -> Vector:
    """(n, 2, 3) matrices that turn a displacement of a unit ray (n, 3) into one of its pixel.

    They have no part along the ray itself.
    """
    return _weights(rays, camera.project(_neighbours(rays)))


@kernel
def _neighbours(rays: Vector) -> Vector:
    """(6 n, 3): each ray moved by ±`STEP` along each axis, first up and then down."""
    moved = np.empty((6 * rays.shape[0], 3))
    for i in range(rays.shape[0]):
        for m in range(6):
            for k in range(3):
                moved[6 * i + m, k] = rays[i, k]
            moved[6 * i + m, m % 3] += STEP if m < 3 else -STEP
    return moved


@kernel
def _weights(rays: Vector, pixels: Vector) -> Vector:
    """`corner_weights` from the ``pixels`` (6 n, 2) of the rays' neighbours."""
    weights = np.empty((rays.shape[0], 2, 3))
    for i in range(rays.shape[0]):
        for j in range(2):
            along = 0.0
            for k in range(3):
                slope = (pixels[6 * i + k, j] - pixels[6 * i + 3 + k, j]) / (2.0 * STEP)
                weights[i, j, k] = slope
                along += slope * rays[i, k]
            for k in range(3):
                weights[i, j, k] -= along * rays[i, k]
    return weights


@kernel
def _linearise(R: Vector, p: Vector, points: Vector, rays: Vector, weights: Vector, H: Vector, b: Vector) -> float:
    """Fill the normal equations ``H`` (6, 6), ``b`` (6,) at a pose; the sum of squares, inf if it is impossible."""
    H[:] = 0.0
    b[:] = 0.0
    squares = 0.0
    row = np.empty(6)
    for i in range(points.shape[0]):
        g, ray = points[i], rays[i]
        x = R[0, 0] * g[0] + R[0, 1] * g[1] + R[0, 2] * g[2] + p[0]
        y = R[1, 0] * g[0] + R[1, 1] * g[1] + R[1, 2] * g[2] + p[1]
        z = R[2, 0] * g[0] + R[2, 1] * g[1] + R[2, 2] * g[2] + p[2]
        depth = ray[0] * x + ray[1] * y + ray[2] * z
        if not depth > 1e-6:
            return math.inf
        for j in range(2):
            w = weights[i, j]
            error = (w[0] * x + w[1] * y + w[2] * z) / depth
            for k in range(3):
                row[k] = (w[k] - error * ray[k]) / depth
            # Turning the gate by δ about its own axes moves the corner by R (δ × g).
            c0 = row[0] * R[0, 0] + row[1] * R[1, 0] + row[2] * R[2, 0]
            c1 = row[0] * R[0, 1] + row[1] * R[1, 1] + row[2] * R[2, 1]
            c2 = row[0] * R[0, 2] + row[1] * R[1, 2] + row[2] * R[2, 2]
            row[3] = g[1] * c2 - g[2] * c1
            row[4] = g[2] * c0 - g[0] * c2
            row[5] = g[0] * c1 - g[1] * c0
            squares += error * error
            for m in range(6):
                b[m] -= row[m] * error
                for n in range(m + 1):
                    H[m, n] += row[m] * row[n]
    for m in range(6):
        for n in range(m):
            H[n, m] = H[m, n]
    return squares


@kernel
def _moved(R: Vector, p: Vector, step: Vector, R_new: Vector, p_new: Vector) -> float:
    """Put the pose moved by ``step`` (6,) into ``R_new`` and ``p_new``; how far that is, for `CONVERGED`."""
    turn = quat_to_matrix(quat_from_rotvec(step[3:6]))
    way = reach = angle = 0.0
    for i in range(3):
        way, reach, angle = max(way, abs(step[i])), max(reach, abs(p[i])), max(angle, abs(step[3 + i]))
        p_new[i] = p[i] + step[i]
        for j in range(3):
            R_new[i, j] = R[i, 0] * turn[0, j] + R[i, 1] * turn[1, j] + R[i, 2] * turn[2, j]
    return way / (1e-9 + reach) + angle


@kernel
def refine_pose(R: Vector, p: Vector, points: Vector, rays: Vector, weights: Vector, H: Vector) -> float:
    """Move the pose ``R`` (3, 3) R_cg, ``p`` (3,) to where it best explains ``rays`` (n, 3) to ``points`` (n, 3).

    ``H`` (6, 6) becomes JᵀJ, per square pixel, for position in camera axes and rotation vector in gate axes.
    Returns the sum of squared errors in px², inf where the start is impossible (K. Madsen et al., "Methods for
    Non-Linear Least Squares Problems", 2004).
    """
    R_new, p_new, H_new, damped = np.empty((3, 3)), np.empty(3), np.empty((6, 6)), np.empty((6, 6))
    b, b_new, step = np.empty(6), np.empty(6), np.empty(6)
    squares = _linearise(R, p, points, rays, weights, H, b)
    damping = 1e-4
    for _ in range(ITERATIONS):
        if not math.isfinite(squares):
            break
        assign(damped.reshape(36), H.reshape(36))
        for m in range(6):
            damped[m, m] += damping * H[m, m] + 1e-12
        assign(step, b)
        size = math.inf
        squares_new = math.inf
        if factor(damped):
            substitute(damped, step)
            size = _moved(R, p, step, R_new, p_new)
            squares_new = _linearise(R_new, p_new, points, rays, weights, H_new, b_new)
        if squares_new <= squares:
            assign(R.reshape(9), R_new.reshape(9))
            assign(H.reshape(36), H_new.reshape(36))
            assign(p, p_new)
            assign(b, b_new)
            squares = squares_new
            damping *= 0.1
        else:
            damping *= 10.0
        if size < CONVERGED or damping > 1e8:
            break
    return squares
