"""Where a camera sits in the body, from a target that stands still while the body's poses are known.

The first guess is the hand–eye problem A X = X B: rotations by F. Park and B. Martin, "Robot sensor calibration:
solving AX = XB on the Euclidean group" (1994), positions by linear least squares. Then the reprojection error is
minimised over the mount, the target's pose and the lateness of the camera's stamps together. What is wrong in one
image, as with the tracker's pose there, is common to all of its corners: the covariance is that of M-estimators with
the images as clusters (K.-Y. Liang and S. Zeger, 1986).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from flightapp.calibration.body_poses import BodyPoses
from flightapp.calibration.lens_guess import pose_of
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.perception.camera import CameraModel

SIGHTS_MIN, SIGHTS_MAX = 10, 250
TURNED_MIN = math.radians(5.0)
"""Between two images, from which they tell of the mount's rotation."""
PAIRS = 400
SPREAD_MIN = math.radians(7.0)
"""Standard deviation of the body's turning about the axis about which it turned second most, that is needed."""
LATE = 0.02
"""s, standard deviation of the stamps' lateness before anything is known of it."""
HUBER = 3.0
"""px, from which a corner's distance counts less."""
ROTATION_MAX, POSITION_MAX = math.radians(0.3), 0.01
"""Greatest standard deviations of a result that is to be relied on."""
ERROR_MAX = 5.0
"""px RMS, beyond which poses and images do not belong together."""
DELAY = 12


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """The target in one image."""

    stamp: float
    points: Vector
    """(n, 3) m, in the target's frame."""
    pixels: Vector
    """(n, 2)."""


@dataclass(frozen=True, slots=True)
class MountFound:
    """What was found."""

    R_bc: Vector
    """(3, 3) camera to body."""
    p_bc: Vector
    """(3,) m."""
    rotation_deviation: Vector
    """(3,) rad, about the body's axes."""
    position_deviation: Vector
    """(3,) m."""
    late: float
    """s by which the camera's stamps are later than the tracker's for the same moment."""
    late_deviation: float
    rms: float
    """px."""
    sights: int
    shortfalls: tuple[str, ...]
    """Why it is not to be relied on; empty where it is."""


def find_mount(camera: CameraModel, sights: Sequence[Sight], poses: BodyPoses) -> MountFound:
    """The mount of ``camera``, whose own one is a first guess, from ``sights`` of a target at known body ``poses``.

    Raises `BadInputError` where nothing can be told.
    """
    stamps = np.array([sight.stamp for sight in sights])
    known = poses.know(stamps, 2.0 * LATE) if len(sights) and len(poses.stamp) > 1 else np.zeros(len(sights), bool)
    used = [sight for sight, is_known in zip(sights, known, strict=True) if is_known]
    if len(used) > SIGHTS_MAX:
        used = [used[i] for i in np.linspace(0, len(used) - 1, SIGHTS_MAX).astype(int)]
    seen = [(sight, pose_of(camera, sight.points, sight.pixels)) for sight in used]
    posed = [(sight, pose) for sight, pose in seen if pose is not None]
    if len(posed) < SIGHTS_MIN:
        raise BadInputError(
            f"it was seen in {len(sights)} images, and in {len(posed)} of them while there were poses; at least"
            f" {SIGHTS_MIN} are needed: are images and poses by the same clock?"
        )
    used, poses = [sight for sight, _ in posed], poses.smoothed()
    target = np.array([pose for _, pose in posed])
    turned = _turned(used, poses)
    problem = _Problem(camera, used, poses)
    starts = [problem.start(camera.R_bc, camera.p_bc, target)]
    if turned > SPREAD_MIN:
        starts.append(problem.start(*_hand_eye(used, target, poses), target))
    best = min((problem.solve(start) for start in starts), key=lambda solved: float(solved.cost))
    return problem.result(best, turned)


def _turned(sights: Sequence[Sight], poses: BodyPoses) -> float:
    """rad, how much the body turned about the axis about which it turned second most."""
    _, R = poses.at(np.array([sight.stamp for sight in sights]))
    vectors = (R.mean().inv() * R).as_rotvec()
    spread: Vector = np.linalg.svd(vectors - vectors.mean(axis=0), compute_uv=False) / math.sqrt(len(sights))
    return float(spread[1])


def _hand_eye(sights: Sequence[Sight], target: Vector, poses: BodyPoses) -> tuple[Vector, Vector]:
    """R_bc (3, 3) and p_bc (3,) from pairs of images; ``target`` (m, 6) are the target's poses in the camera."""
    p, R = poses.at(np.array([sight.stamp for sight in sights]))
    R_ct, p_ct = Rotation.from_rotvec(target[:, :3]), target[:, 3:]
    draw = np.random.default_rng(0)
    i, j = draw.integers(0, len(sights), (2, 20 * PAIRS))
    A, B = R[i].inv() * R[j], R_ct[i] * R_ct[j].inv()
    far = np.flatnonzero(A.magnitude() > TURNED_MIN)[:PAIRS]
    if len(far) < SIGHTS_MIN:
        raise BadInputError("the body hardly turned: turn it about two axes or more while the target is seen")
    i, j, A, B = i[far], j[far], A[far], B[far]
    alike = np.abs(A.magnitude() - B.magnitude()) < 0.3 * A.magnitude()  # not so where a pose is the wrong one of two
    i, j, A, B = i[alike], j[alike], A[alike], B[alike]
    if len(i) < SIGHTS_MIN:
        raise BadInputError("images and poses do not show the same motion: are they by the same clock?")
    R_bc, _ = Rotation.align_vectors(A.as_rotvec(), B.as_rotvec())
    moved_body = R[i].inv().apply(p[j] - p[i])
    moved_camera = R_bc.apply(p_ct[i] - B.apply(p_ct[j]))
    left = (A.as_matrix() - np.eye(3)).reshape(-1, 3)
    p_bc = np.linalg.lstsq(left, (moved_camera - moved_body).ravel(), rcond=None)[0]
    return R_bc.as_matrix(), p_bc


class _Problem:
    """Mount, target and lateness (13,): changes of a start, turns as rotation vectors."""

    def __init__(self, camera: CameraModel, sights: Sequence[Sight], poses: BodyPoses) -> None:
        self._camera, self._poses = camera, poses
        self._stamps = np.array([sight.stamp for sight in sights])
        self._of = np.repeat(np.arange(len(sights)), [len(sight.points) for sight in sights])
        self._points = np.concatenate([sight.points for sight in sights])
        self._pixels = np.concatenate([sight.pixels for sight in sights])
        self._count = len(sights)

    def start(self, R_bc: Vector, p_bc: Vector, target: Vector) -> Vector:
        """(13,) with the mount ``R_bc``, ``p_bc``, and the target where most images see it with that."""
        p, R = self._poses.at(self._stamps)
        mount = Rotation.from_matrix(R_bc)
        R_wt = R * mount * Rotation.from_rotvec(target[:, :3])
        p_wt = p + R.apply(p_bc + mount.apply(target[:, 3:]))
        chosen = np.linspace(0, self._count - 1, min(self._count, 40)).astype(int)
        angles = np.array([(R_wt[int(k)].inv() * R_wt).magnitude() for k in chosen])
        middle = R_wt[int(chosen[np.argmin(np.median(angles, axis=1))])]
        return np.concatenate((mount.as_rotvec(), p_bc, middle.as_rotvec(), np.median(p_wt, axis=0), (0.0,)))

    def residual(self, x: Vector) -> Vector:
        """(2 n + 1,) px, and the lateness by its own spread."""
        p, R = self._poses.at(self._stamps - x[DELAY])
        points = Rotation.from_rotvec(x[6:9]).apply(self._points) + x[9:12]
        in_body = R[self._of].inv().apply(points - p[self._of])
        in_camera = Rotation.from_rotvec(x[:3]).inv().apply(in_body - x[3:6])
        off = np.nan_to_num(self._camera.project(in_camera) - self._pixels, nan=1e3)
        return np.append(np.clip(off, -1e3, 1e3).ravel(), x[DELAY] / LATE)

    def solve(self, start: Vector) -> "Solved":
        """The least cost from ``start`` on."""
        bounds = np.full(13, np.inf)
        bounds[DELAY] = 2.0 * LATE
        found = least_squares(
            self.residual, start, bounds=(-bounds, bounds), loss="huber", f_scale=HUBER, x_scale="jac", max_nfev=60
        )
        return Solved(found.x, float(found.cost))

    def result(self, solved: "Solved", turned: float) -> MountFound:
        """``solved`` in words of the body, with its standard deviations and a verdict."""
        x, residual = solved.x, self.residual(solved.x)
        deviation = self._deviation(residual, x)
        rms = float(np.sqrt(2.0 * np.mean(residual[:-1] ** 2)))
        found = MountFound(
            Rotation.from_rotvec(x[:3]).as_matrix(), x[3:6], deviation[:3], deviation[3:6],
            float(x[DELAY]), float(deviation[DELAY]), rms, self._count, (),
        )  # fmt: skip
        return replace(found, shortfalls=_shortfalls(found, turned))

    def _deviation(self, residual: Vector, x: Vector) -> Vector:
        """(13,) standard deviations; those of the mount's rotation about the body's axes."""
        weight = np.minimum(1.0, HUBER / np.maximum(np.abs(residual), 1e-9))
        plain = self._jacobian(x)
        hessian = (weight[:, None] * plain).T @ plain
        score = (weight * residual)[:, None] * plain
        groups = np.append(np.repeat(self._of, 2), self._count)
        sums = np.zeros((self._count + 1, 13))
        np.add.at(sums, groups, score)
        sums[-1] = plain[-1]  # what was believed before has a variance of 1
        inverse = np.linalg.pinv(hessian, rcond=1e-12)
        covariance = inverse @ (sums.T @ sums) @ inverse * (self._count / max(self._count - 13, 1))
        # a small change d of the rotation vector turns the camera by J d about the body's axes
        turn = np.eye(13)
        turn[:3, :3] = _left_jacobian(x[:3])
        deviation: Vector = np.sqrt(np.maximum(np.diag(turn @ covariance @ turn.T), 0.0))
        return deviation

    def _jacobian(self, x: Vector) -> Vector:
        columns = []
        for i in range(13):
            step = np.zeros(13)
            step[i] = 1e-6
            columns.append((self.residual(x + step) - self.residual(x - step)) / 2e-6)
        return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True)
class Solved:
    """Where the minimisation ended."""

    x: Vector
    cost: float


def _left_jacobian(r: Vector) -> Vector:
    """(3, 3): exp(r + d) is about exp(J d) exp(r)."""
    angle = float(np.linalg.norm(r))
    cross = np.array(((0.0, -r[2], r[1]), (r[2], 0.0, -r[0]), (-r[1], r[0], 0.0)))
    if angle < 1e-6:
        return np.eye(3) + 0.5 * cross
    first, second = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    jacobian: Vector = np.eye(3) + first * cross + second * cross @ cross
    return jacobian


def _shortfalls(found: MountFound, turned: float) -> tuple[str, ...]:
    wanted = []
    if turned < SPREAD_MIN:
        wanted.append(
            f"the body turned by {math.degrees(turned):.1f}° (standard deviation) about the axis that it turned about"
            f" second most, and {math.degrees(SPREAD_MIN):.0f}° are needed: turn it about two axes or more"
        )
    if not found.rotation_deviation.max() < ROTATION_MAX:
        wanted.append(
            f"the rotation is known to {math.degrees(found.rotation_deviation.max()):.2f}° only (at most"
            f" {math.degrees(ROTATION_MAX):.1f}°)"
        )
    if not found.position_deviation.max() < POSITION_MAX:
        wanted.append(
            f"the position is known to {1e3 * found.position_deviation.max():.0f} mm only (at most"
            f" {1e3 * POSITION_MAX:.0f} mm): turn more, near the target"
        )
    if found.rms > ERROR_MAX:
        wanted.append(
            f"corners lie {found.rms:.1f} px (RMS) off: the target moved, or its size, the lens or the clocks are not"
            " as they were said to be"
        )
    return tuple(wanted)
