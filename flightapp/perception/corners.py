"""The detector for cameras that find the markers themselves."""

from collections.abc import Collection, Sequence

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import Frame, MarkerDetection
from flightapp.track import Track


def track_markers(track: Track) -> tuple[int, ...]:
    """Ids of all markers on the gates of ``track``, in order of passage."""
    return tuple(marker for gate in track.gates for marker in gate.markers)


def found_by_camera(frame: Frame, known: Collection[int]) -> tuple[MarkerDetection, ...]:
    """What the camera itself found in ``frame``, but for markers that aren't ``known``."""
    return tuple(marker for marker in frame.markers if marker.marker_id in known)


class CornerDetector:
    """Passes on what the camera found, restricted to the track's markers."""

    def __init__(self, config: Config, track: Track) -> None:
        self._known = frozenset(track_markers(track))

    def detect(self, frame: Frame, regions: Sequence[Vector] | None) -> tuple[MarkerDetection, ...]:
        """The track's markers among ``frame.markers``; the camera has searched everywhere already."""
        return found_by_camera(frame, self._known)
