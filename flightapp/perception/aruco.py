"""ArUco markers in images, found by compiled code of our own.

`quads` finds what may be markers, `edges` fits their sides to sub-pixel accuracy and `decoding` reads them. OpenCV's
detector, for comparison and as a fallback, is `opencv`. OpenCV's threads are a setting of the whole process, which is
the application's to make.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.decoding import marker_codes
from flightapp.perception.grey import check_image, grey_image
from flightapp.perception.quads import REGION, WHOLE
from flightapp.perception.reading import CODE, CORNERS, NOISE, WORST, Codes, read_markers
from flightapp.perception.regions import Box, merge_regions
from flightapp.perception.threshold import means_of
from flightapp.track import Track

SMALLEST_IMAGE = 12
"""px, side of an image in which nothing can be found."""

LIMITS = np.array((0.94, 0.22, 0.28, 0.1))
"""What a reading keeps to that is believed: see `reading.Limits`."""

DONE_SHARE = 1.0 / 64.0
"""A region of which a marker fills this part has shown what was expected there."""

_ORDER, _NONE = np.arange(4), np.empty((0, 4, 2))


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
        height, width = frame.image.shape[:2]
        boxes = [(0, 0, width, height)] if regions is None else merge_regions(regions, width, height)
        if not boxes:
            return ()
        x0, y0 = min(box[0] for box in boxes), min(box[1] for box in boxes)
        x1, y1 = max(box[2] for box in boxes), max(box[3] for box in boxes)
        if min(x1 - x0, y1 - y0) < SMALLEST_IMAGE:
            return ()
        part = grey_image(frame.image[y0:y1, x0:x1])
        offsets = WHOLE if regions is None else REGION
        means, origin = means_of(part), np.array((x0, y0))
        found = read_markers(part, means, _moved(boxes, x0, y0), 2, offsets[1], LIMITS, self._codes, _NONE)
        quads = np.ascontiguousarray(found[:, CORNERS:]).reshape(-1, 4, 2)
        if regions is not None:
            boxes = merge_regions(_open_regions(regions, quads + origin), width, height)
        if boxes:
            inner = _moved(boxes, x0, y0)
            more = read_markers(part, means, inner, 1, offsets[0], LIMITS, self._codes, quads)
            found = np.concatenate((found, more))
        return self._known_markers(found, origin)

    def _known_markers(self, readings: Vector, origin: Vector) -> tuple[MarkerDetection, ...]:
        """The track's markers of ``readings`` (m, 14), made with ``origin`` (2,) as 0, 0; the best of each, by id."""
        best: dict[int, MarkerDetection] = {}
        for row in readings:
            marker_id, turns = divmod(int(row[CODE]), 4)
            quality = 1.0 - float(row[WORST])
            if marker_id in self._known and (marker_id not in best or quality > best[marker_id].quality):
                corners = row[CORNERS:].reshape(4, 2)[(_ORDER + 4 - turns) & 3] + origin
                best[marker_id] = MarkerDetection(marker_id, corners, quality, float(row[NOISE]))
        return tuple(best[marker_id] for marker_id in sorted(best))


def _moved(boxes: list[Box], x0: int, y0: int) -> NDArray[np.int64]:
    return np.array([(box[0] - x0, box[1] - y0, box[2] - x0, box[3] - y0) for box in boxes])


def _open_regions(regions: Sequence[Vector], quads: Vector) -> list[Vector]:
    """Those of ``regions`` (4,) that none of the markers ``quads`` (m, 4, 2) fills, each of which fills but one."""
    left = list(regions)
    for quad in quads:
        low, high = quad.min(axis=0), quad.max(axis=0)
        middle, area = 0.5 * (low + high), float((high - low).prod())
        nearest, least = -1, np.inf
        for n, (x0, y0, x1, y1) in enumerate(left):
            off = abs(middle[0] - 0.5 * (x0 + x1)) + abs(middle[1] - 0.5 * (y0 + y1))
            inside = x0 <= middle[0] <= x1 and y0 <= middle[1] <= y1
            if inside and off < least and area >= DONE_SHARE * (x1 - x0) * (y1 - y0):
                nearest, least = n, off
        if nearest >= 0:
            del left[nearest]
    return left
