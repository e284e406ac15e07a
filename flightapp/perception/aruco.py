"""ArUco markers in images, found by compiled code of our own.

`quads` finds what may be markers, `edges` fits their sides to sub-pixel accuracy and `decoding` reads them. OpenCV's
detector, for comparison and as a fallback, is `opencv`. OpenCV's threads are a setting of the whole process, which is
the application's to make.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.decoding import bordered_codes, code_templates
from flightapp.perception.edges import Image
from flightapp.perception.grey import check_image, grey_image
from flightapp.perception.quads import REGION, WHOLE
from flightapp.perception.reading import CODE, CORNERS, FIT, LEAD, WORST, read_markers
from flightapp.perception.regions import Box, merge_regions
from flightapp.track import Track

SMALLEST_IMAGE = 12
"""px, side of an image in which nothing can be found."""

SURE = np.array((0.95, 0.22, 0.08))
"""Least fit, most of the contrast unexplained in a cell, and least lead (see `recognise`) of a reading that is
believed anywhere. Markers of other dictionaries whose codes differ by one bit reach a fit of 0.93."""

EXPECTED = np.array((0.94, 0.22, 0.07))
"""The same where the map expects markers."""


_ORDER = np.arange(4)


class ArucoDetector:
    """Finds the track's markers in grey or colour images.

    Constructing it compiles what it needs, so that nothing is compiled in flight.
    """

    def __init__(self, config: Config, track: Track) -> None:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{track.gate.dictionary}"))
        self._known = frozenset(marker for gate in track.passage for marker in gate.markers)
        self._codes = bordered_codes(_codes(dictionary))
        self._templates = code_templates(self._codes)
        self._search(np.zeros((SMALLEST_IMAGE, SMALLEST_IMAGE), np.uint8), [(0, 0, 1, 1)], WHOLE, SURE)

    def detect(self, frame: Frame, regions: Sequence[Vector] | None) -> tuple[MarkerDetection, ...]:
        """The track's markers in ``frame``, each at most once, by id.

        ``regions`` are (4,) boxes x0, y0, x1, y1 in pixels where the map expects markers, None for the whole image;
        they may overlap and reach out of the image. Readings that are not beyond doubt are believed in them alone.
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
        inner = [(box[0] - x0, box[1] - y0, box[2] - x0, box[3] - y0) for box in boxes]
        search, limits = (WHOLE, SURE) if regions is None else (REGION, EXPECTED)
        found = self._search(part, inner, search, limits)
        origin = np.array((x0, y0))
        return tuple(MarkerDetection(n, found[n].corners + origin, found[n].quality) for n in sorted(found))

    def _search(
        self, image: Image, boxes: list[Box], search: NDArray[np.int64], limits: Vector
    ) -> dict[int, MarkerDetection]:
        """The track's markers in ``boxes`` of ``image`` whose readings keep to ``limits``, by id."""
        readings = read_markers(image, np.array(boxes), search, self._templates, self._codes)
        fit, worst, lead = readings[:, FIT], readings[:, WORST], readings[:, LEAD]
        best: dict[int, MarkerDetection] = {}
        for row in readings[(fit >= limits[0]) & (worst <= limits[1]) & (lead >= limits[2])]:
            marker_id, turns = divmod(int(row[CODE]), 4)
            quality = 1.0 - float(row[WORST])
            if marker_id in self._known and (marker_id not in best or quality > best[marker_id].quality):
                corners = row[CORNERS:].reshape(4, 2)[(_ORDER + 4 - turns) & 3]
                best[marker_id] = MarkerDetection(marker_id, corners, quality)
        return best


def _codes(dictionary: Any) -> NDArray[np.uint8]:
    """(k, n, n) cells of all markers of ``dictionary``, 1 for white."""
    side = dictionary.markerSize + 2
    pictures = [dictionary.generateImageMarker(marker, side) for marker in range(len(dictionary.bytesList))]
    return np.stack([picture[1:-1, 1:-1] > 127 for picture in pictures]).astype(np.uint8)
