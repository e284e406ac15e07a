"""A first guess of a lens from views of a board: the focal length with which the board fits best, and its poses."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from flightapp.calibration.board import View
from flightapp.frames import Vector
from flightapp.perception.camera import CameraModel, Lens

FIELDS = {Lens.PINHOLE: (30.0, 45.0, 60.0, 75.0, 90.0, 110.0), Lens.FISHEYE: (60.0, 90.0, 120.0, 150.0, 180.0, 210.0)}
"""°, horizontal fields of view that are tried."""
FINER = (0.85, 0.92, 1.08, 1.17)
"""Times the best of their focal lengths, tried next."""
WIDEST = math.cos(math.radians(78.0))
"""Of a ray to the axis: further out, a plane in front of the camera tells little of a first pose."""
TRIED = 12
"""Views that are enough to choose."""
NO_MOUNT = np.eye(3), np.zeros(3)


def ideal(lens: Lens, width: int, height: int, focal: float) -> CameraModel:
    """A camera without distortion, whose axis meets the middle of the image."""
    centre = 0.5 * (width - 1), 0.5 * (height - 1)
    return CameraModel(lens, width, height, np.array((focal, focal, *centre)), np.zeros(4), *NO_MOUNT)


def pose_of(model: CameraModel, points: Vector, pixels: Vector) -> Vector | None:
    """The pose (6,), rotation vector and translation board to camera, of a plane z = 0; None where there is none.

    ``points`` (n, 3) m are seen at ``pixels`` (n, 2). T. Collins and A. Bartoli, "Infinitesimal plane-based pose
    estimation" (2014), then Levenberg–Marquardt, both OpenCV's, on the plane at depth 1.
    """
    rays = model.bearings(pixels)
    seen = rays[:, 2] > WIDEST
    if np.count_nonzero(seen) < 6:
        return None
    flat = np.ascontiguousarray(rays[seen, :2] / rays[seen, 2:])
    known = np.ascontiguousarray(points[seen])
    if np.linalg.matrix_rank(known[:, :2] - known[0, :2], tol=1e-6) < 2:
        return None
    try:
        found, turns, shifts, _ = cv2.solvePnPGeneric(known, flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    except cv2.error:
        return None
    if not found:
        return None
    turn, shift = cv2.solvePnPRefineLM(known, flat, np.eye(3), None, turns[0].copy(), shifts[0].copy())
    pose: Vector = np.concatenate((turn.ravel(), shift.ravel())).astype(float)
    in_front = np.isfinite(pose).all() and (in_camera(pose, known)[:, 2] > 0.0).all()
    return pose if in_front else None


def in_camera(pose: Vector, points: Vector) -> Vector:
    """``points`` (n, 3) of the board in the camera's frame, by its ``pose`` (6,)."""
    R = cv2.Rodrigues(pose[:3])[0]
    moved: Vector = points @ R.T + pose[3:]
    return moved


def guess(lens: Lens, width: int, height: int, corners: Vector, views: Sequence[View]) -> CameraModel:
    """The undistorted camera of ``lens`` that fits ``views`` of the board's ``corners`` (n, 3) best."""
    chosen = views if len(views) <= TRIED else [views[i] for i in np.linspace(0, len(views) - 1, TRIED).astype(int)]
    candidates = [ideal(lens, width, height, _focal(lens, width, field)) for field in FIELDS[lens]]
    errors = [_misfit(model, corners, chosen) for model in candidates]
    best = int(np.argmin(errors))
    model = candidates[best]
    finer = [replace(model, focal=model.focal * (s, s, 1.0, 1.0)) for s in FINER]
    return min((model, *finer), key=lambda tried: _misfit(tried, corners, chosen))


def _focal(lens: Lens, width: int, field: float) -> float:
    half = math.radians(0.5 * field)
    return 0.5 * width / (half if lens is Lens.FISHEYE else math.tan(half))


def _misfit(model: CameraModel, corners: Vector, views: Sequence[View]) -> float:
    """Median over ``views`` of the RMS reprojection, px; a view without a pose counts as infinitely bad."""
    errors = []
    for view in views:
        pose = pose_of(model, corners[view.ids], view.pixels)
        if pose is None:
            errors.append(1e6)
            continue
        off = model.project(in_camera(pose, corners[view.ids])) - view.pixels
        errors.append(float(np.sqrt(np.nanmean(off**2))))
    return float(np.median(errors))
