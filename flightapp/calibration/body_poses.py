"""Where the body was, between a tracker's samples."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from flightapp.frames import Vector

SMOOTHING = 0.08
"""s, over which poses are smoothed: no body turns to and fro so quickly."""
GAP = 0.06
"""s between poses that are not bridged."""


@dataclass(frozen=True, slots=True)
class BodyPoses:
    """Where the body was; times ascend, and the frame stays the same."""

    stamp: Vector
    """(n,) s."""
    position: Vector
    """(n, 3) m."""
    orientation: Vector
    """(n, 4) body to the tracker's frame, scalar first."""

    def at(self, stamps: Vector) -> tuple[Vector, Rotation]:
        """Positions (m, 3) and orientations between the samples."""
        after = np.clip(np.searchsorted(self.stamp, stamps), 1, len(self.stamp) - 1)
        before = after - 1
        share = ((stamps - self.stamp[before]) / (self.stamp[after] - self.stamp[before]))[:, None]
        position = self.position[before] + share * (self.position[after] - self.position[before])
        a, b = self.orientation[before], self.orientation[after]
        b = np.where(np.sum(a * b, axis=1, keepdims=True) < 0.0, -b, b)
        mixed = a + share * (b - a)
        return position, Rotation.from_quat(mixed, scalar_first=True)

    def smoothed(self) -> "BodyPoses":
        """Without the noise from sample to sample, whose slopes would be taken for the body's velocity.

        Local parabolas over `SMOOTHING` s (A. Savitzky and M. Golay, 1964), between gaps.
        """
        q = self.orientation.copy()
        flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
        q[1:] *= flips[:, None]
        values = np.concatenate((self.position, q), axis=1)
        edges = [0, *(np.flatnonzero(np.diff(self.stamp) > GAP) + 1).tolist(), len(self.stamp)]
        for begin, end in itertools.pairwise(edges):
            period = float(np.median(np.diff(self.stamp[begin:end]))) if end - begin > 3 else SMOOTHING
            window = 2 * round(0.5 * SMOOTHING / period) + 1
            if 3 < window <= end - begin:
                values[begin:end] = savgol_filter(values[begin:end], window, 2, axis=0)
        return BodyPoses(self.stamp, values[:, :3], values[:, 3:])

    def know(self, stamps: Vector, margin: float) -> NDArray[np.bool_]:
        """Whether there are samples close to each of ``stamps`` (m,), and to ``margin`` s before and after."""
        known = np.ones(len(stamps), bool)
        for moved in (stamps - margin, stamps, stamps + margin):
            after = np.clip(np.searchsorted(self.stamp, moved), 1, len(self.stamp) - 1)
            known &= (moved >= self.stamp[0]) & (moved <= self.stamp[-1])
            known &= self.stamp[after] - self.stamp[after - 1] <= GAP
        return known
