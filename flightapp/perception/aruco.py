"""ArUco markers in images, found by compiled code of our own.

`quads` finds what may be markers, `edges` fits their sides to sub-pixel accuracy and `decoding` reads them. OpenCV's
detector, for comparison and as a fallback, is `opencv`. OpenCV's threads are a setting of the whole process, which is
the application's to make.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.boxes import stacked
from flightapp.perception.decoding import marker_codes
from flightapp.perception.grey import check_image, grey_image
from flightapp.perception.quads import REGION, WHOLE
from flightapp.perception.reading import CODE, CORNERS, NOISE, WORST, Codes, read_markers
from flightapp.track import Track

SMALLEST_IMAGE = 12
"""px, side of an image in which nothing can be found."""

LIMITS = np.array((0.94, 0.22, 0.28, 0.1))
"""What a reading keeps to that is believed: see `reading.Limits`."""

DONE_SHARE = 1.0 / 64.0
"""A region of which a marker fills this part has shown what was expected there."""


class ArucoDetector:
    """Finds the track's markers in grey or colour images.

    Constructing it compiles what it needs, so that nothing is compiled in flight.
    """

    def __init__(self, config: Config, track: Track) -> None:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{track.gate.dictionary}"))
        self._known = frozenset(marker for gate in track.passage for marker in gate.markers)
        self._codes = Codes.of(marker_codes(dictionary))
        self.detect(Frame(0.0, 0, np.zeros((SMALLEST_IMAGE, SMALLEST_IMAGE), np.uint8)), None)

    def detect(self, frame: Frame, regions: Sequence[Vector] | None) -> tuple[MarkerDetection, ...]:
        """The track's markers in ``frame``, each at most once, by id.

        ``regions`` are (4,) boxes x0, y0, x1, y1 in pixels where the map expects one marker each, None for the
        whole image; they may overlap and reach out of the image. A region in which a large marker has been found
        isn't searched for small ones.
        The image may be (h, w), (h, w, 1), BGR or BGRA; ValueError if it is not of bytes. A frame without an image
        has been searched by its camera, whose markers are passed on.
        """
        if frame.image is None:
            return tuple(marker for marker in frame.markers if marker.marker_id in self._known)
        check_image(frame.image)
        image = grey_image(frame.image)
        height, width = image.shape
        if min(height, width) < SMALLEST_IMAGE:
            return ()
        if regions is None:
            readings = read_markers(image, stacked([(0, 0, width, height)]), WHOLE, np.inf, LIMITS, self._codes)
        else:
            readings = read_markers(image, stacked(regions), REGION, DONE_SHARE, LIMITS, self._codes)
        return self._known_markers(readings)

    def _known_markers(self, readings: Vector) -> tuple[MarkerDetection, ...]:
        """The track's markers of ``readings`` (m, 14); the best of each, by id."""
        best: dict[int, MarkerDetection] = {}
        for row, values in zip(readings, readings.tolist(), strict=True):
            marker_id, quality = int(values[CODE]) // 4, 1.0 - values[WORST]
            if marker_id in self._known and (marker_id not in best or quality > best[marker_id].quality):
                corners = row[CORNERS:].reshape(4, 2)
                best[marker_id] = MarkerDetection(marker_id, corners, quality, values[NOISE])
        return tuple(best[marker_id] for marker_id in sorted(best))
