"""The tracker's recent poses, to be asked for the pose at the exposure of an image."""

import math
from collections import deque

import numpy as np

from flightapp.frames import (
    Vector,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    quat_normalize,
    quat_to_rotvec,
)
from flightapp.jit import assign, kernel
from flightapp.messages import PoseSample

_FIELDS = 13


@kernel
def _between(a: Vector, b: Vector, dt: float, fraction: float, out: Vector) -> None:
    """Pose at ``fraction`` of the way from ``a`` to ``b`` (13,), ``dt`` seconds apart, into ``out`` (13,).

    Rows are position, velocity, angular velocity, orientation. The position is the cubic with the
    velocities of both ends, the orientation turns at a constant rate.
    """
    s = fraction
    s2 = s * s
    s3 = s2 * s
    for i in range(3):
        out[i] = (
            (2.0 * s3 - 3.0 * s2 + 1.0) * a[i]
            + (3.0 * s2 - 2.0 * s3) * b[i]
            + dt * ((s3 - 2.0 * s2 + s) * a[3 + i] + (s3 - s2) * b[3 + i])
        )
    for i in range(3, 9):
        out[i] = a[i] + s * (b[i] - a[i])
    turn = quat_to_rotvec(quat_multiply(quat_conjugate(a[9:13]), b[9:13]))
    assign(out[9:13], quat_normalize(quat_multiply(a[9:13], quat_from_rotvec(s * turn))))


@kernel
def _beyond(a: Vector, dt: float, out: Vector) -> None:
    """Pose ``dt`` seconds after ``a`` (13,) with its velocities held, into ``out`` (13,)."""
    assign(out, a)
    for i in range(3):
        out[i] = a[i] + dt * a[3 + i]
    assign(out[9:13], quat_normalize(quat_multiply(a[9:13], quat_from_rotvec(dt * a[6:9]))))


def _packed(sample: PoseSample) -> list[float]:
    position, velocity = sample.position.tolist(), sample.velocity.tolist()
    row: list[float] = position + velocity + sample.angular_velocity.tolist() + sample.orientation.tolist()
    return row


class PoseHistory:
    """Poses of the last ``span`` seconds, in order of their stamps.

    Between samples the pose is interpolated; past the newest it is extrapolated with its velocities for at
    most ``reach`` seconds. Gaps of more than ``max_gap`` seconds are not bridged.
    """

    def __init__(self, span: float = 1.0, reach: float = 0.02, max_gap: float = 0.1) -> None:
        self._span = span
        self._reach = reach
        self._max_gap = max_gap
        self._rows: deque[tuple[float, int, list[float]]] = deque()

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, sample: PoseSample) -> bool:
        """Take ``sample`` over; False where it is not finite or not newer than the newest."""
        row, rows, stamp = _packed(sample), self._rows, sample.stamp
        if not (math.isfinite(stamp) and all(map(math.isfinite, row))):
            return False
        if rows and stamp <= rows[-1][0]:
            return False
        rows.append((stamp, sample.confidence, row))
        while rows[0][0] < stamp - self._span:
            rows.popleft()
        return True

    def at(self, stamp: float) -> PoseSample | None:
        """The pose at ``stamp``; None where the history doesn't reach."""
        if not self._rows or not self._rows[0][0] <= stamp <= self._rows[-1][0] + self._reach:
            return None
        out = np.empty(_FIELDS)
        later_stamp, later_confidence, later = self._rows[-1]
        if stamp >= later_stamp:
            _beyond(np.array(later), stamp - later_stamp, out)
            return _unpacked(stamp, out, later_confidence)
        for earlier_stamp, confidence, earlier in reversed(self._rows):
            if earlier_stamp <= stamp:
                break
            later_stamp, later_confidence, later = earlier_stamp, confidence, earlier
        dt = later_stamp - earlier_stamp
        if dt > self._max_gap:
            return None
        _between(np.array(earlier), np.array(later), dt, (stamp - earlier_stamp) / dt, out)
        return _unpacked(stamp, out, min(confidence, later_confidence))


def _unpacked(stamp: float, row: Vector, confidence: int) -> PoseSample:
    return PoseSample(stamp, row[0:3], row[9:13], row[3:6], row[6:9], confidence)
