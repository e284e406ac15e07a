"""Paths in time, and which pose of one belongs to which of another."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flightapp.evaluation.flight import Motions, Setpoints
from flightapp.evaluation.rotations import slerp
from flightapp.frames import Vector

Rows = NDArray[np.intp] | NDArray[np.bool_]
MAX_DIFFERENCE = 0.01
"""s between stamps that still belong together, unless told otherwise."""
MAX_GAP = 0.5
"""s between neighbours, between which is still interpolated, unless told otherwise."""


@dataclass(frozen=True, slots=True)
class TimedPath:
    """Poses over time, from whatever was recorded; world frame, x forward, y left, z up."""

    name: str
    stamp: Vector
    """(n,) s, ascending."""
    position: Vector
    """(n, 3) m."""
    orientation: Vector | None = None
    """(n, 4) q_wb, unit; None where only places are known."""

    def at(self, rows: Rows) -> "TimedPath":
        """The poses of ``rows``, indices or a mask."""
        q = None if self.orientation is None else self.orientation[rows]
        return replace(self, stamp=self.stamp[rows], position=self.position[rows], orientation=q)

    def shifted(self, seconds: float) -> "TimedPath":
        """The same with ``seconds`` more on each stamp."""
        return replace(self, stamp=self.stamp + seconds)


def path_of(name: str, motion: Motions | Setpoints) -> TimedPath:
    """The poses of a recorded stream, as far as they are finite; of setpoints the places alone."""
    q = motion.orientation if isinstance(motion, Motions) else np.zeros((0, 4))
    whole = np.isfinite(motion.position).all(axis=1)
    if q.shape[0] != motion.stamp.size:
        return TimedPath(name, motion.stamp[whole], motion.position[whole])
    length = np.linalg.norm(q, axis=1)
    whole &= np.isfinite(length) & (length > 0.5)
    return TimedPath(name, motion.stamp[whole], motion.position[whole], q[whole] / length[whole, None])


Pair = tuple[TimedPath, TimedPath]
"""Reference and estimate, of as many poses each, that belong together row by row."""


def associate(reference: TimedPath, estimate: TimedPath, max_difference: float = MAX_DIFFERENCE) -> Pair:
    """Each pose of the path with fewer poses with the nearest in time of the other, where one is near enough.

    As the TUM benchmark's tools and evo do it; a pose of the longer one may be taken twice. Of two that are equally
    near, the earlier counts.
    """
    if reference.stamp.size < estimate.stamp.size:
        few, many = _nearest(reference.stamp, estimate.stamp, max_difference)
        return reference.at(few), estimate.at(many)
    few, many = _nearest(estimate.stamp, reference.stamp, max_difference)
    return reference.at(many), estimate.at(few)


def _nearest(stamps: Vector, others: Vector, max_difference: float) -> tuple[Rows, Rows]:
    if stamps.size == 0 or others.size == 0:
        return np.zeros(0, int), np.zeros(0, int)
    after = np.minimum(np.searchsorted(others, stamps, side="right"), others.size - 1)
    before = np.maximum(after - 1, 0)
    later = np.abs(others[after] - stamps) < np.abs(stamps - others[before])
    nearest = np.where(later, after, before)
    near = np.flatnonzero(np.abs(others[nearest] - stamps) <= max_difference)
    return near, nearest[near]


def interpolate(reference: TimedPath, estimate: TimedPath, max_gap: float = MAX_GAP) -> Pair:
    """The poses of ``reference``, and ``estimate`` read at their stamps: straight lines and slerp between its poses.

    Nothing is extrapolated, nor read in a gap of ``estimate`` longer than ``max_gap`` (s).
    """
    at, stamps = reference.stamp, estimate.stamp
    if stamps.size < 2:
        return reference.at(np.zeros(0, int)), estimate.at(np.zeros(0, int))
    after = np.clip(np.searchsorted(stamps, at, side="right"), 1, stamps.size - 1)
    gap = stamps[after] - stamps[after - 1]
    kept = np.flatnonzero((at >= stamps[0]) & (at <= stamps[-1]) & (gap <= max_gap) & (gap > 0.0))
    at, after, gap = at[kept], after[kept], gap[kept]
    part = (at - stamps[after - 1]) / gap
    p, q = estimate.position, estimate.orientation
    position = p[after - 1] + part[:, None] * (p[after] - p[after - 1])
    turned = None if q is None else slerp(q[after - 1], q[after], part)
    return reference.at(kept), replace(estimate, stamp=at, position=position, orientation=turned)
