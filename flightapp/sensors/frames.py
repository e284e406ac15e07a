"""Whether a camera lives: one that has frozen delivers its last image again and again, with new stamps.

What such an image shows would be taken for seen from where the vehicle is now. A living camera's images have noise: no
two of them are the same. Images that show nothing, black or white all over, may be, and nothing is lost with them.
"""

import numpy as np

from flightapp.messages import Frame

ROWS = 16
"""Every so many rows are compared."""
FROZEN_AFTER = 0.2
"""s of the same image, after which it is worth telling."""


class FrameIntake:
    """Takes a camera's frames in the order of their arrival; pure."""

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._told = False
        self.repeated = 0
        """Frames that showed the one before once more."""
        self.notice = ""
        """What there is to tell of the newest frame, in words; empty where there is nothing."""

    def take(self, frame: Frame) -> bool:
        """Whether ``frame`` is another one than the last, and to be used."""
        self.notice = ""
        last = self._last
        if last is None or not _same(frame, last):
            if self._told:
                self.notice = "the camera delivers new images again"
            self._last, self._told = frame, False
            return True
        self.repeated += 1
        if not self._told and frame.stamp - last.stamp > FROZEN_AFTER:
            self._told = True
            self.notice = "the camera delivers the same image again and again: it is not used"
        return False


def _same(a: Frame, b: Frame) -> bool:
    if a.image is not None and b.image is not None:
        return np.array_equal(a.image[::ROWS], b.image[::ROWS])
    if a.image is not None or b.image is not None or not a.markers or len(a.markers) != len(b.markers):
        return False
    return all(
        one.marker_id == other.marker_id and np.array_equal(one.corners, other.corners)
        for one, other in zip(a.markers, b.markers, strict=True)
    )
