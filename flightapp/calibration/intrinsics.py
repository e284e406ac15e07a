"""Intrinsics of a camera from views of a board: bundle adjustment of lens and poses with the flight's own lens model.

Gauss–Newton with Levenberg's damping; each view's pose is eliminated by the Schur complement, so that a step costs the
same for each view (B. Triggs et al., "Bundle adjustment: a modern synthesis", 1999). Residuals beyond a few times
their spread count less (P. Huber, 1964). The covariance of the intrinsics is that of the linearised problem, with the
variance that the residuals have.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from flightapp.calibration.board import View
from flightapp.calibration.lens_guess import guess, in_camera, pose_of
from flightapp.frames import Vector
from flightapp.perception.camera import CameraModel, Lens

HUBER = 3.0
"""Times the residuals' spread, beyond which they count less."""
ROUNDS = 60
"""Steps at most."""
DONE = 1e-9
"""Share of the cost by which a step must reduce it, so that another follows."""
LENS = 8
STEP = 1e-6
OUTLIER = 5.0
"""A view is left out whose RMS is further above the median than so many robust standard deviations,"""
TWICE = 2.0
"""and is more than so many times the median."""
REJECTIONS = 5
"""Rounds of leaving views out."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """What was found."""

    model: CameraModel
    deviation: Vector
    """(8,) standard deviations of fx, fy, cx, cy (px) and the four coefficients."""
    views: tuple[View, ...]
    """Those that were used."""
    poses: Vector
    """(m, 6) rotation vector and translation (m), board to camera, of each of them."""
    errors: Vector
    """(m,) px, RMS reprojection of each of them."""
    rejected: tuple[tuple[str, float], ...]
    """Names of the views that did not fit, and their RMS in px."""

    @property
    def rms(self) -> float:
        """px, of the distance between seen and reprojected corners, over all views used."""
        sizes = np.array([len(view.ids) for view in self.views], float)
        return float(np.sqrt(np.sum(sizes * self.errors**2) / np.sum(sizes)))


def calibrate(lens: Lens, width: int, height: int, corners: Vector, views: Sequence[View]) -> Calibration | None:
    """The camera of ``lens`` that took ``views`` of a board with ``corners`` (n, 3) m; None where none fits them."""
    model = guess(lens, width, height, corners, views)
    used, poses = _posed(model, corners, views)
    rejected: list[tuple[str, float]] = []
    for attempt in range(REJECTIONS):
        if len(used) < 3:
            return None
        problem = _Problem(model, corners, used, poses)
        if not problem.solve():
            return None
        if attempt == 0 and len(used) < len(views):  # the first guess had no pose for some
            more, found = _posed(problem.model, corners, [view for view in views if view not in used])
            problem = _Problem(problem.model, corners, [*used, *more], np.concatenate((problem.poses, found)))
            used = [*used, *more]
            if not problem.solve():
                return None
        errors = problem.view_errors()
        middle = float(np.median(errors))
        spread = 1.4826 * float(np.median(np.abs(errors - middle)))
        bad = errors > max(middle + OUTLIER * spread, TWICE * middle)
        if not bad.any():
            deviation = problem.deviation()
            return Calibration(problem.model, deviation, tuple(used), problem.poses, errors, tuple(rejected))
        rejected += [(used[i].name, float(errors[i])) for i in np.flatnonzero(bad)]
        used = [view for view, wrong in zip(used, bad, strict=True) if not wrong]
        model, poses = problem.model, problem.poses[~bad]
    return None


def _posed(model: CameraModel, corners: Vector, views: Sequence[View]) -> tuple[list[View], Vector]:
    """Those of ``views`` that have a pose with ``model``, and their poses (m, 6)."""
    found = [(view, pose_of(model, corners[view.ids], view.pixels)) for view in views]
    used = [(view, pose) for view, pose in found if pose is not None]
    return [view for view, _ in used], np.array([pose for _, pose in used]).reshape(-1, 6)


class _Problem:
    """Lens and poses, and how they move."""

    def __init__(self, model: CameraModel, corners: Vector, views: Sequence[View], poses: Vector) -> None:
        self.model, self.poses = model, poses
        self._corners = [corners[view.ids] for view in views]
        self._pixels = np.concatenate([view.pixels for view in views])
        self._ends = np.cumsum([0, *(len(view.ids) for view in views)])
        self._count = len(views)

    def solve(self) -> bool:
        """Move to the least cost; False where that cannot be computed."""
        damping, free = 1e-3, 0
        residual = self._residual(self.model, self.poses)
        for step in range(ROUNDS):
            scale = self._scale(residual)
            cost = self._cost(residual, scale)
            if not np.isfinite(cost):
                return False
            # first the poses and the focal length, then everything: a lens far off would bend what it cannot explain
            free = 2 if step < 4 else LENS
            blocks = self._blocks(residual, scale)
            while damping < 1e8:
                model, poses = self._moved(blocks, damping, free)
                trial = self._residual(model, poses)
                trial_cost = self._cost(trial, scale)
                if np.isfinite(trial_cost) and trial_cost < cost:
                    break
                damping *= 10.0
            else:
                return True
            self.model, self.poses, residual = model, poses, trial
            damping = max(0.2 * damping, 1e-9)
            if free == LENS and cost - trial_cost < DONE * cost:
                return True
        return True

    def view_errors(self) -> Vector:
        """(m,) px, RMS reprojection of each view."""
        squares = np.sum(self._residual(self.model, self.poses) ** 2, axis=1)
        means = np.add.reduceat(squares, self._ends[:-1]) / np.diff(self._ends)
        errors: Vector = np.sqrt(means)
        return errors

    def deviation(self) -> Vector:
        """(8,) standard deviations of the lens's parameters; infinite where the views leave one open."""
        residual = self._residual(self.model, self.poses)
        scale = self._scale(residual)
        lens, mixed, pose, _, _ = self._blocks(residual, scale)
        schur = lens - np.einsum("mij,mjk,mlk->il", mixed, np.linalg.pinv(pose), mixed)
        values, vectors = np.linalg.eigh(schur / np.outer(norm := np.sqrt(np.diag(lens)), norm))
        inverse = np.where(values > 1e-12, 1.0 / np.maximum(values, 1e-12), np.inf)
        with np.errstate(invalid="ignore"):
            variance = np.nansum(vectors**2 * inverse, axis=1) / norm**2
        left = max(residual.size - LENS - 6 * self._count, 1)
        weight = self._weights(residual, scale)
        sigma = float(np.sum(weight[:, None] * residual**2)) / left
        deviation: Vector = np.sqrt(sigma * variance)
        return deviation

    def _in_camera(self, poses: Vector) -> Vector:
        return np.concatenate([in_camera(pose, points) for pose, points in zip(poses, self._corners, strict=True)])

    def _residual(self, model: CameraModel, poses: Vector) -> Vector:
        residual: Vector = model.project(self._in_camera(poses)) - self._pixels
        return residual

    @staticmethod
    def _scale(residual: Vector) -> float:
        """px, of the residuals' length, robustly: the median length is 1.177 times their standard deviation."""
        return max(float(np.median(np.linalg.norm(residual, axis=1))) / 1.177, 1e-4)

    @staticmethod
    def _weights(residual: Vector, scale: float) -> Vector:
        length = np.linalg.norm(residual, axis=1)
        weights: Vector = np.minimum(1.0, HUBER * scale / np.maximum(length, 1e-12))
        return weights

    def _cost(self, residual: Vector, scale: float) -> float:
        length, bound = np.linalg.norm(residual, axis=1), HUBER * scale
        return float(np.sum(np.where(length <= bound, 0.5 * length**2, bound * (length - 0.5 * bound))))

    def _blocks(self, residual: Vector, scale: float) -> tuple[Vector, Vector, Vector, Vector, Vector]:
        """Normal equations: lens (8, 8), mixed (m, 8, 6), poses (m, 6, 6), and both gradients (8,), (m, 6)."""
        points = self._in_camera(self.poses)
        by_lens, by_point = _slopes(self.model, points)
        origin = np.repeat(self.poses[:, 3:], np.diff(self._ends), axis=0)
        arm = points - origin
        # a turn w moves a point by w × arm
        by_pose = np.empty((len(points), 2, 6))
        by_pose[:, :, :3] = np.cross(arm[:, None, :], by_point)
        by_pose[:, :, 3:] = by_point
        weight = self._weights(residual, scale)[:, None, None]
        weighted_pose, begins = weight * by_pose, self._ends[:-1]
        lens = np.einsum("nki,nkj->ij", weight * by_lens, by_lens)
        mixed = np.add.reduceat(np.einsum("nki,nkj->nij", by_lens, weighted_pose), begins)
        pose = np.add.reduceat(np.einsum("nki,nkj->nij", by_pose, weighted_pose), begins)
        lens_gradient = np.einsum("nki,nk->i", weight * by_lens, residual)
        pose_gradient = np.add.reduceat(np.einsum("nki,nk->ni", weighted_pose, residual), begins)
        return lens, mixed, pose, lens_gradient, pose_gradient

    def _moved(
        self, blocks: tuple[Vector, Vector, Vector, Vector, Vector], damping: float, free: int
    ) -> tuple[CameraModel, Vector]:
        """One damped step, with the first ``free`` parameters of the lens."""
        lens, mixed, pose, lens_gradient, pose_gradient = blocks
        lens, mixed, lens_gradient = lens[:free, :free], mixed[:, :free], lens_gradient[:free]
        lens = lens + damping * np.diag(np.diag(lens) + 1e-12)
        pose = pose + damping * np.einsum("mii->mi", pose)[:, :, None] * np.eye(6) + 1e-12 * np.eye(6)
        inverse = np.linalg.inv(pose)
        fold = np.einsum("mij,mjk->mik", mixed, inverse)
        schur = lens - np.einsum("mij,mkj->ik", fold, mixed)
        right = -lens_gradient + np.einsum("mij,mj->i", fold, pose_gradient)
        step = np.linalg.lstsq(schur, right, rcond=None)[0]
        turns = np.einsum("mij,mj->mi", inverse, -pose_gradient - np.einsum("mij,i->mj", mixed, step))
        values = np.concatenate((self.model.focal, self.model.distortion))
        values[:free] += step
        model = replace(self.model, focal=values[:4], distortion=values[4:])
        poses = self.poses.copy()
        poses[:, 3:] += turns[:, 3:]
        for i, turn in enumerate(turns[:, :3]):
            R = cv2.Rodrigues(turn)[0] @ cv2.Rodrigues(self.poses[i, :3])[0]
            poses[i, :3] = cv2.Rodrigues(R)[0].ravel()
        return model, poses


def _slopes(model: CameraModel, points: Vector) -> tuple[Vector, Vector]:
    """Of the pixels of ``points`` (n, 3): by the lens's parameters (n, 2, 8) and by the points (n, 2, 3)."""
    by_lens = np.zeros((len(points), 2, LENS))
    values = np.concatenate((model.focal, model.distortion))
    for i in range(LENS):
        step = STEP * max(abs(values[i]), 1.0)
        high, low = values.copy(), values.copy()
        high[i] += step
        low[i] -= step
        up = replace(model, focal=high[:4], distortion=high[4:]).project(points)
        by_lens[:, :, i] = (up - replace(model, focal=low[:4], distortion=low[4:]).project(points)) / (2.0 * step)
    by_point = np.empty((len(points), 2, 3))
    for i in range(3):
        shift = np.zeros(3)
        shift[i] = STEP
        by_point[:, :, i] = (model.project(points + shift) - model.project(points - shift)) / (2.0 * STEP)
    return by_lens, by_point
