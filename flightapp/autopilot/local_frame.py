"""Where the autopilot's local frame lies in the tracker's, and how often one of them has jumped.

The origin of PX4's local frame is put where the vehicle stands. Without a global position PX4's takeoff climbs over the
origin of that frame, from wherever it begins, and to the takeoff height above it (navigator_main.cpp and takeoff.cpp
of v1.16: an unset target reads as latitude, longitude and altitude 0).
"""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import PoseSample

MOVED = 0.1
"""m from the origin, less than which a takeoff may begin beside it."""
SETTLING = 1.0
"""s that PX4's estimator and its checks may take to follow a reset of external vision on the ground."""


class LocalFrame:
    """Tells poses from its origin, which is the first one's place until it is moved.

    ``jump`` (m) beyond what the tracker's speed explains counts as a reset.
    """

    def __init__(self, jump: float) -> None:
        self._jump = jump
        self._last: PoseSample | None = None
        self.origin: Vector = np.zeros(3)
        """(3,) m, in the tracker's frame."""
        self.resets = 0
        """Jumps of the tracker and moves of the origin so far; PX4 is told by the reset counter and follows at once."""

    def take(self, sample: PoseSample) -> Vector:
        """Where ``sample`` is from the origin, (3,) m along the axes of the tracker's frame."""
        last, self._last = self._last, sample
        if last is None:
            self.origin = sample.position
        elif self._jumped(last, sample):
            self.resets += 1
        return sample.position - self.origin

    def move(self) -> bool:
        """Put the origin where the last pose was; whether that moved it, which takes `SETTLING` to be followed."""
        if self._last is None or math.dist(self.origin, self._last.position) < MOVED:
            return False
        self.origin = self._last.position
        self.resets += 1
        return True

    def _jumped(self, before: PoseSample, after: PoseSample) -> bool:
        elapsed = max(after.stamp - before.stamp, 0.0)
        speed = max(math.hypot(*before.velocity), math.hypot(*after.velocity))
        return math.dist(before.position, after.position) > 1.5 * speed * elapsed + self._jump
