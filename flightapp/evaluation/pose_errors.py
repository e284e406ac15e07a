"""Absolute and relative pose errors, as the field takes them.

APE: where the estimate is, against where it should be (in J. Sturm et al., "A benchmark for the evaluation of RGB-D
SLAM systems", IROS 2012, the absolute trajectory error). RPE: how far its motion over a step is off (there, eq. 1),
which does not care where it began. Translations are lengths in metres, rotations the angle between the orientations in
radians. All paths belong together row by row (`paths`), and are aligned before (`alignment`).
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flightapp.evaluation.paths import TimedPath
from flightapp.evaluation.rotations import angle, conjugate, multiply, rotate
from flightapp.frames import Vector

SLACK = 1e-9
"""Share of a step by which it may be shorter, so that rounding of the stamps does not cost a pose."""


class Unit(StrEnum):
    """What a relative error's step is measured in."""

    FRAMES = "frames"
    SECONDS = "s"
    METRES = "m"


@dataclass(frozen=True, slots=True)
class Statistics:
    """Of n errors."""

    rmse: float
    mean: float
    median: float
    std: float
    """Over n, not n - 1."""
    min: float
    max: float
    count: int


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """What is wrong with an estimate."""

    translation: Statistics
    """m."""
    rotation: Statistics | None
    """rad; None where one of the paths has no orientations."""


def statistics(errors: Vector) -> Statistics | None:
    """Of ``errors`` (n,); None of none."""
    if errors.size == 0:
        return None
    rmse = float(np.sqrt(np.mean(errors * errors)))
    middle = (float(np.mean(errors)), float(np.median(errors)), float(np.std(errors)))
    return Statistics(rmse, *middle, float(errors.min()), float(errors.max()), int(errors.size))


def absolute_errors(reference: TimedPath, estimate: TimedPath) -> PoseErrors | None:
    """The APE; None of no poses."""
    translation = np.linalg.norm(estimate.position - reference.position, axis=1)
    rotation = None
    if reference.orientation is not None and estimate.orientation is not None:
        rotation = angle(multiply(conjugate(reference.orientation), estimate.orientation))
    return _errors(translation, rotation)


def relative_errors(reference: TimedPath, estimate: TimedPath, delta: float, unit: Unit) -> PoseErrors | None:
    """The RPE over steps of ``delta`` in ``unit``, one after the other; None where there is not one.

    Metres are counted along the reference. A step ends with the first pose that is ``delta`` or more away. Raises
    ValueError where a path has no orientations, in whose axes the steps are told, and for a step that is none.
    """
    a, b = reference.orientation, estimate.orientation
    if a is None or b is None:
        raise ValueError("relative errors take orientations, and one of the paths has none")
    i, j = steps(reference, delta, unit)
    moved_a = rotate(conjugate(a[i]), reference.position[j] - reference.position[i])
    moved_b = rotate(conjugate(b[i]), estimate.position[j] - estimate.position[i])
    turned_a, turned_b = multiply(conjugate(a[i]), a[j]), multiply(conjugate(b[i]), b[j])
    return _errors(np.linalg.norm(moved_b - moved_a, axis=1), angle(multiply(conjugate(turned_a), turned_b)))


def steps(path: TimedPath, delta: float, unit: Unit) -> tuple[Vector, Vector]:
    """Indices (k,) of the first and last poses of steps of ``delta`` in ``unit`` along ``path``."""
    if not 0.0 < delta < np.inf or (unit is Unit.FRAMES and delta != int(delta)):
        raise ValueError(f"a step of {delta:g} {unit} is none")
    if path.stamp.size == 0:
        return np.zeros(0, int), np.zeros(0, int)
    if unit is Unit.FRAMES:
        progress = np.arange(path.stamp.size, dtype=float)
    elif unit is Unit.SECONDS:
        progress = path.stamp
    else:
        progress = np.concatenate(((0.0,), np.cumsum(np.linalg.norm(np.diff(path.position, axis=0), axis=1))))
    ends = [0]
    while (end := int(np.searchsorted(progress, progress[ends[-1]] + delta * (1.0 - SLACK)))) < progress.size:
        ends.append(end)
    return np.array(ends[:-1], int), np.array(ends[1:], int)


def _errors(translation: Vector, rotation: Vector | None) -> PoseErrors | None:
    found = statistics(translation)
    if found is None:
        return None
    return PoseErrors(found, None if rotation is None else statistics(rotation))
