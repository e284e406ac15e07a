"""Moving an estimated path onto its reference, before errors are taken.

A tracker's frame begins anywhere; what of that is forgiven must be said with every error. `sim3` and `se3` are the
least-squares similarity and rigid motion of S. Umeyama, "Least-squares estimation of transformation parameters between
two point patterns", IEEE PAMI 13 (1991), eqs. (40)-(43). `yaw` turns about the vertical only, which is what remains
unknown where gravity is felt: Z. Zhang and D. Scaramuzza, "A tutorial on quantitative trajectory evaluation for
visual(-inertial) odometry", IROS 2018, III-B. `first` puts the first pose onto the first.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from flightapp.evaluation.paths import TimedPath
from flightapp.evaluation.rotations import conjugate, multiply, rotate
from flightapp.frames import Vector, quat_from_matrix, quat_from_yaw


class Align(StrEnum):
    """Which motion is forgiven."""

    NONE = "none"
    FIRST = "first"
    YAW = "yaw"
    SE3 = "se3"
    SIM3 = "sim3"


class AlignmentError(ValueError):
    """The poses do not tell the motion."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """p ↦ scale · R(rotation) p + translation."""

    rotation: Vector
    """(4,) unit quaternion."""
    translation: Vector
    """(3,) m."""
    scale: float = 1.0

    def apply(self, path: TimedPath) -> TimedPath:
        """``path`` moved."""
        position = self.scale * rotate(self.rotation, path.position) + self.translation
        q = None if path.orientation is None else multiply(self.rotation, path.orientation)
        return replace(path, position=position, orientation=q)


def align(reference: TimedPath, estimate: TimedPath, how: Align) -> Alignment:
    """The motion that ``how`` forgives, from ``estimate`` to ``reference``, which belong together row by row.

    Raises `AlignmentError` where the poses do not tell it.
    """
    if reference.stamp.size == 0:
        raise AlignmentError("no poses belong together")
    return _MAKERS[how](reference, estimate)


def umeyama(reference: Vector, estimate: Vector, scaled: bool) -> Alignment:
    """The least-squares motion from points ``estimate`` (n, 3) to ``reference`` (n, 3), with its scale if ``scaled``.

    Raises `AlignmentError` for points on a line: any turn about it fits as well.
    """
    middle_r, middle_e = reference.mean(axis=0), estimate.mean(axis=0)
    r, e = reference - middle_r, estimate - middle_e
    U, d, Vt = np.linalg.svd(r.T @ e / len(r))
    if d[1] <= max(d[0] * 1e-12, np.finfo(float).eps):
        raise AlignmentError("the path is a straight line or a point, which does not tell how it is turned about it")
    signs = np.array((1.0, 1.0, math.copysign(1.0, np.linalg.det(U) * np.linalg.det(Vt))))
    R = (U * signs) @ Vt
    scale = float((d * signs).sum() / np.mean(np.sum(e * e, axis=1))) if scaled else 1.0
    return Alignment(quat_from_matrix(R), middle_r - scale * (R @ middle_e), scale)


def _none(reference: TimedPath, estimate: TimedPath) -> Alignment:
    return Alignment(np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3))


def _first(reference: TimedPath, estimate: TimedPath) -> Alignment:
    if reference.orientation is None or estimate.orientation is None:
        raise AlignmentError("first poses are aligned by their orientations, and one of the paths has none")
    turn = multiply(reference.orientation[0], conjugate(estimate.orientation[0]))
    return Alignment(turn, reference.position[0] - rotate(turn, estimate.position[0]))


def _yaw(reference: TimedPath, estimate: TimedPath) -> Alignment:
    middle_r, middle_e = reference.position.mean(axis=0), estimate.position.mean(axis=0)
    r, e = reference.position - middle_r, estimate.position - middle_e
    across = float(np.sum(e[:, 0] * r[:, 1] - e[:, 1] * r[:, 0]))
    along = float(np.sum(e[:, 0] * r[:, 0] + e[:, 1] * r[:, 1]))
    if math.hypot(across, along) <= np.finfo(float).eps * len(r):
        raise AlignmentError("the path goes straight up or nowhere, which does not tell its heading")
    turn = quat_from_yaw(math.atan2(across, along))
    return Alignment(turn, middle_r - rotate(turn, middle_e))


_MAKERS: Mapping[Align, Callable[[TimedPath, TimedPath], Alignment]] = {
    Align.NONE: _none,
    Align.FIRST: _first,
    Align.YAW: _yaw,
    Align.SE3: lambda reference, estimate: umeyama(reference.position, estimate.position, False),
    Align.SIM3: lambda reference, estimate: umeyama(reference.position, estimate.position, True),
}
