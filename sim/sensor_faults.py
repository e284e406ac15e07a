"""What becomes of a tracker's samples and a camera's images where sim.faults breaks them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from flightapp.frames import Vector, quat_from_yaw, quat_multiply, quat_rotate
from flightapp.messages import Frame, PoseSample
from sim.faults import Fault
from sim.render import PoseAt

ASIDE = (0.5, 3.0)
"""m to any side, and up to a quarter of it up or down, of the place from which a wrong image seems to be taken."""
TURNED = 0.2
"""rad to any side, by which it seems to be turned."""


class PoseFaults:
    """What becomes of a tracker's samples."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = tuple(fault for fault in faults if fault.name.startswith("pose_"))
        self._places: dict[Fault, Vector] = {}
        self._last: PoseSample | None = None

    def apply(self, sample: PoseSample) -> PoseSample | None:
        """What the tracker tells instead of ``sample``; None for nothing."""
        acting = [fault for fault in self._faults if fault.acts(sample.stamp)]
        for fault in acting:
            if fault.name == "pose_relocalised":
                sample = self._relocalised(fault, sample)
            elif fault.name == "pose_jump":
                sample = replace(sample, position=sample.position + np.array((fault.amount[0], 0.0, 0.0)))
            elif fault.name == "pose_slipping":
                sample = replace(sample, velocity=sample.velocity + np.array((fault.amount[0], 0.0, 0.0)))
            elif fault.name == "pose_frozen" and self._last is not None:
                sample = replace(self._last, stamp=sample.stamp)
        self._last = sample
        return None if any(fault.name == "pose_silent" for fault in acting) else sample

    def _relocalised(self, fault: Fault, sample: PoseSample) -> PoseSample:
        centre = self._places.setdefault(fault, sample.position)
        way, turn = fault.amount
        q = quat_from_yaw(math.radians(turn))
        push = sample.acceleration
        return replace(
            sample,
            position=centre + quat_rotate(q, sample.position - centre) + np.array((way, 0.0, 0.0)),
            orientation=quat_multiply(q, sample.orientation),
            velocity=quat_rotate(q, sample.velocity),
            acceleration=None if push is None else quat_rotate(q, push),
        )


class CameraFaults:
    """What becomes of a camera's images; ``seed`` decides which are wrong, and how."""

    def __init__(self, faults: Sequence[Fault], seed: int) -> None:
        self._faults = tuple(fault for fault in faults if fault.name in CAMERA)
        self._random = np.random.default_rng(seed)
        self._last: Frame | None = None
        self.focal = 1.0 + sum(fault.amount[0] for fault in faults if fault.name == "calibration_wrong")
        """Focal length that is believed, over the true one."""

    def lateness(self, stamp: float) -> float:
        """s by which an image of ``stamp`` comes later."""
        return max((fault.amount[0] for fault in self._acting(stamp, "camera_late")), default=0.0)

    def expose(self, stamp: float, pose_at: PoseAt, take: Callable[[PoseAt], Frame]) -> Frame | None:
        """The image of ``stamp``, which ``take`` takes from where the camera is; None where there is none."""
        if self._acting(stamp, "camera_silent"):
            return None
        for slow in self._acting(stamp, "camera_slow"):
            if self._last is not None and stamp - self._last.stamp < 1.0 / slow.amount[0] - 1e-6:
                return None
        for wrong in self._acting(stamp, "sightings_wrong"):
            if self._random.random() < wrong.amount[0]:
                pose_at = self._elsewhere(pose_at)
        frame = take(pose_at)
        if self._last is not None and self._acting(stamp, "camera_frozen"):
            frame = replace(self._last, stamp=stamp, sequence=frame.sequence)
        elif self._acting(stamp, "camera_black"):
            image = None if frame.image is None else np.zeros_like(frame.image)
            frame = replace(frame, image=image, markers=())
        self._last = frame
        return frame

    def _acting(self, stamp: float, name: str) -> list[Fault]:
        return [fault for fault in self._faults if fault.name == name and fault.acts(stamp)]

    def _elsewhere(self, pose_at: PoseAt) -> PoseAt:
        way, bearing = self._random.uniform(*ASIDE), self._random.uniform(-math.pi, math.pi)
        up, turn = self._random.uniform(-0.25, 0.25) * way, self._random.uniform(-TURNED, TURNED)
        aside = np.array((way * math.cos(bearing), way * math.sin(bearing), up))
        q = quat_from_yaw(turn)

        def elsewhere(stamp: float) -> tuple[Vector, Vector]:
            position, orientation = pose_at(stamp)
            return position + aside, quat_multiply(q, orientation)

        return elsewhere


CAMERA = {"camera_silent", "camera_frozen", "camera_black", "camera_slow", "camera_late", "sightings_wrong"}
"""Faults of which `CameraFaults` asks when an image is taken."""
