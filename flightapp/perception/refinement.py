"""Least-squares refinement of a pose: Levenberg–Marquardt on the reprojection error.

Works on rays, whatever the lens. The error of a corner is measured in the plane across the ray through which
it was seen, and scaled to pixels by the lens's derivative there; for errors of a few pixels that equals the
reprojection error, at any angle from the optical axis.
"""

import numpy as np

from flightapp.frames import Vector, quat_from_rotvec, quat_to_matrix
from flightapp.jit import kernel
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
    steps = STEP * np.eye(3)
    moved = np.concatenate((rays[:, None] + steps, rays[:, None] - steps), axis=1)
    pixels = camera.project(moved.reshape(-1, 3)).reshape(-1, 2, 3, 2)
    slope = (pixels[:, 0] - pixels[:, 1]).transpose(0, 2, 1) / (2.0 * STEP)
    along = np.einsum("nij,nj->ni", slope, rays)
    return np.ascontiguousarray(slope - along[:, :, None] * rays[:, None, :])


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
            return np.inf
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
                for n in range(6):
                    H[m, n] += row[m] * row[n]
    return squares


@kernel
def refine_pose(
    R_start: Vector, p_start: Vector, points: Vector, rays: Vector, weights: Vector
) -> tuple[Vector, Vector, Vector, float]:
    """Pose (R_cg, p_cg) near the start that best explains ``rays`` (n, 3) to ``points`` (n, 3) of the gate.

    Returns also JᵀJ (6, 6), per square pixel, for position in camera axes and rotation vector in gate axes,
    and the sum of squared errors in px², inf where the start is impossible (K. Madsen et al., "Methods for
    Non-Linear Least Squares Problems", 2004).
    """
    R, p = R_start.copy(), p_start.copy()
    H, H_new, b, b_new, step = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(6)
    squares = _linearise(R, p, points, rays, weights, H, b)
    damping = 1e-4
    for _ in range(ITERATIONS):
        if not np.isfinite(squares):
            break
        damped = H.copy()
        for m in range(6):
            damped[m, m] += damping * H[m, m] + 1e-12
        step[:] = np.linalg.solve(damped, b)
        p_new = p + step[:3]
        R_new = R @ quat_to_matrix(quat_from_rotvec(step[3:]))
        squares_new = _linearise(R_new, p_new, points, rays, weights, H_new, b_new)
        if squares_new <= squares:
            R, p, squares = R_new, p_new, squares_new
            H[:], b[:] = H_new, b_new
            damping *= 0.1
        else:
            damping *= 10.0
        size = np.abs(step[:3]).max() / (1e-9 + np.abs(p).max()) + np.abs(step[3:]).max()
        if size < CONVERGED or damping > 1e8:
            break
    return R, p, H, squares
