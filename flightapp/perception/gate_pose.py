"""The pose of a gate from all of its visible markers together.

Two candidate poses come from T. Collins and A. Bartoli, "Infinitesimal Plane-Based Pose Estimation" (IJCV
2014), in a virtual pinhole camera that looks at the markers, so that it works at any angle from the optical
axis; `refinement` then minimises the reprojection error of each. A plane seen nearly face on, or small, leaves
both poses likely: the less likely one is handed on as the alternative unless a likelihood ratio rules it out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector, quat_from_matrix
from flightapp.messages import GateSighting, MarkerDetection
from flightapp.perception.camera import CameraModel
from flightapp.perception.refinement import corner_weights, refine_pose
from flightapp.track import Track

R_GATE_PLANE: Vector = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Axes of the marker plane as IPPE wants them (right, up, towards the viewer), in the gate frame."""

LEAST_COSINE = 0.05
"""Rays further than 87° from the middle of the markers cannot be seen by the virtual camera."""

LIKELIHOOD_RATIO = 9.0
"""The alternative is dropped when its squared error, over the noise's variance, is larger by this (3 sigma)."""

SAME_POSE = 1e-2
"""rad and fraction of the distance: candidates this close have met in one minimum."""

SUSPECT = 3.0
"""RMS reprojection over the corner noise from which one of several markers is suspected to be wrong."""

IMPROVEMENT = 0.5
"""Leaving a marker out must reduce the RMS reprojection to this fraction to be believed."""


@dataclass(frozen=True, slots=True)
class _Corners:
    """Corners of one gate: where they are on it, and where they are seen."""

    points: Vector
    """(n, 3) m, gate frame."""
    rays: Vector
    """(n, 3) unit, camera frame."""
    weights: Vector
    """(n, 2, 3) pixels per unit of the plane across the ray."""

    def without(self, marker: int) -> "_Corners":
        """All corners but those of the ``marker``-th one."""
        keep = np.arange(len(self.points)) // 4 != marker
        return _Corners(self.points[keep], self.rays[keep], self.weights[keep])


@dataclass(frozen=True, slots=True)
class _Fit:
    """One pose that explains the corners."""

    R_cg: Vector
    p_cg: Vector
    information: Vector
    """(6, 6) JᵀJ: position in camera axes, rotation vector in gate axes; per square pixel."""
    squares: float
    """Sum of squared reprojection errors, px²."""
    corners: int

    @property
    def reprojection(self) -> float:
        """RMS distance between seen and reprojected corners, pixels."""
        return math.sqrt(self.squares / self.corners)


class GatePoseSolver:
    """Turns markers into the poses of the gates that carry them.

    Constructing it compiles what it needs, so that nothing is compiled in flight.
    """

    def __init__(self, config: Config, track: Track, camera: CameraModel) -> None:
        self._limits = config.detection
        self._camera = camera
        self._shape = track.gate.marker_corners()
        self._half_size = 0.5 * track.gate.marker_size
        self._gates = tuple((gate.id, gate.markers) for gate in track.gates)
        centre = np.array([[0.5 * camera.width, 0.5 * camera.height]])
        ray = camera.bearings(centre)
        refine_pose(np.eye(3), 3.0 * ray[0], np.zeros((1, 3)), ray, corner_weights(camera, ray))

    def solve(self, stamp: float, markers: Sequence[MarkerDetection]) -> tuple[GateSighting, ...]:
        """Sightings, in the track's order, of the gates that ``markers`` of the exposure at ``stamp`` show.

        Gates are refused that fit worse than ``detection.max_reprojection``, that are further away than
        ``detection.max_distance`` or that show their markers from behind. Markers with corners that are not
        finite, or that no gate carries, are ignored; of two with one id the first counts.
        """
        seen: dict[int, Vector] = {}
        for marker in markers:
            if marker.marker_id not in seen and np.isfinite(marker.corners).all():
                seen[marker.marker_id] = marker.corners
        sightings = (self._gate(stamp, gate_id, ids, seen) for gate_id, ids in self._gates)
        return tuple(sighting for sighting in sightings if sighting is not None)

    def _gate(self, stamp: float, gate_id: int, ids: tuple[int, ...], seen: dict[int, Vector]) -> GateSighting | None:
        slots = [slot for slot, marker_id in enumerate(ids) if marker_id in seen]
        if not slots:
            return None
        rays = self._camera.bearings(np.concatenate([seen[ids[slot]] for slot in slots]))
        weights = corner_weights(self._camera, rays)
        if not np.isfinite(weights).all():
            return None
        corners = _Corners(self._shape[slots].reshape(-1, 3), rays, weights)
        fits = self._without_outlier(corners)
        if not fits or not self._credible(fits[0]):
            return None
        return self._sighting(stamp, gate_id, fits)

    def _without_outlier(self, corners: _Corners) -> list[_Fit]:
        """Fits to all markers, or to all but the one that spoils them; the best first.

        Three markers or more are needed to tell which of them is wrong.
        """
        fits = self._fit(corners)
        count = len(corners.points) // 4
        if count < 3 or (fits and fits[0].reprojection <= SUSPECT * self._limits.corner_noise):
            return fits
        trials = (self._fit(corners.without(marker)) for marker in range(count))
        best = min((trial for trial in trials if trial), key=lambda trial: trial[0].reprojection, default=[])
        if best and (not fits or best[0].reprojection < IMPROVEMENT * fits[0].reprojection):
            return best
        return fits

    def _fit(self, corners: _Corners) -> list[_Fit]:
        """Poses from which the markers' face can be seen, refined, the best first."""
        fits: list[_Fit] = []
        for R_start, p_start in self._candidates(corners):
            try:
                R, p, information, squares = refine_pose(
                    R_start, p_start, corners.points, corners.rays, corners.weights
                )
            except np.linalg.LinAlgError:
                continue
            on_approach_side = R[:, 0] @ p > 0.0
            if math.isfinite(squares) and on_approach_side:
                fits.append(_Fit(R, p, information, squares, len(corners.points)))
        return sorted(fits, key=lambda fit: fit.squares)

    def _candidates(self, corners: _Corners) -> list[tuple[Vector, Vector]]:
        """Both IPPE poses (R_cg, p_cg) of the marker plane."""
        R_cv = _look_at(corners.rays.mean(axis=0))
        rays = corners.rays @ R_cv
        if not (rays[:, 2] > LEAST_COSINE).all():
            return []
        plane = corners.points @ R_GATE_PLANE
        single = len(plane) == 4
        offset = plane.mean(axis=0) if single else np.zeros(3)
        method = cv2.SOLVEPNP_IPPE_SQUARE if single else cv2.SOLVEPNP_IPPE
        image = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
        try:
            _, rotations, positions, _ = cv2.solvePnPGeneric(plane - offset, image, np.eye(3), None, flags=method)
        except cv2.error:
            return []
        poses = []
        for rotation, position in zip(rotations, positions, strict=True):
            R_vp = cv2.Rodrigues(rotation)[0]
            poses.append((R_cv @ R_vp @ R_GATE_PLANE.T, R_cv @ (position[:, 0] - R_vp @ offset)))
        return poses

    def _credible(self, fit: _Fit) -> bool:
        near = float(np.linalg.norm(fit.p_cg)) <= self._limits.max_distance
        return near and fit.reprojection <= self._limits.max_reprojection

    def _sighting(self, stamp: float, gate_id: int, fits: list[_Fit]) -> GateSighting | None:
        best = fits[0]
        axes = np.eye(6)
        axes[:3, :3] = self._camera.R_bc
        try:
            covariance = self._limits.corner_noise**2 * axes @ np.linalg.inv(best.information) @ axes.T
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(covariance).all() or not (np.diag(covariance) > 0.0).all():
            return None
        position, orientation = self._in_body(best)
        other = self._alternative(fits)
        return GateSighting(
            stamp=stamp,
            gate_id=gate_id,
            position=position,
            orientation=orientation,
            covariance=0.5 * (covariance + covariance.T),
            alternative=None if other is None else self._in_body(other),
            markers=best.corners // 4,
            reprojection=best.reprojection,
        )

    def _alternative(self, fits: list[_Fit]) -> _Fit | None:
        """The second fit, if it is another pose and nearly as likely as the first."""
        if len(fits) < 2:
            return None
        best, other = fits[0], fits[1]
        excess = (other.squares - best.squares) / self._limits.corner_noise**2
        turned = math.acos(min(max(0.5 * (float(np.trace(best.R_cg.T @ other.R_cg)) - 1.0), -1.0), 1.0))
        moved = float(np.linalg.norm(other.p_cg - best.p_cg) / np.linalg.norm(best.p_cg))
        another = turned > SAME_POSE or moved > SAME_POSE
        return other if another and excess < LIKELIHOOD_RATIO and self._credible(other) else None

    def _in_body(self, fit: _Fit) -> tuple[Vector, Vector]:
        position = self._camera.R_bc @ fit.p_cg + self._camera.p_bc
        return position, quat_from_matrix(self._camera.R_bc @ fit.R_cg)


def _look_at(direction: Vector) -> Vector:
    """The smallest rotation (3, 3) that turns the optical axis into ``direction`` (3,)."""
    x, y, z = direction / max(float(np.linalg.norm(direction)), 1e-12)
    s = 1.0 / max(1.0 + z, 1e-9)
    return np.array([[1.0 - s * x * x, -s * x * y, x], [-s * x * y, 1.0 - s * y * y, y], [-x, -y, z]])
