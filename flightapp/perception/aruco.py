"""ArUco markers in images.

OpenCV finds the quads (S. Garrido-Jurado et al., "Automatic generation and detection of highly reliable
fiducial markers under occlusion", 2014); their sides are then fitted to sub-pixel accuracy by `edges` and
their codes read by `decoding`, which recognises small and blurred markers that a cell by cell reading misses.
OpenCV's threads are a setting of the whole process, which is the application's to make.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.decoding import code_templates, correlate, read_cells
from flightapp.perception.edges import Image, refine_corners
from flightapp.perception.regions import merge_regions
from flightapp.track import Track

SMALLEST_PERIMETER = 40.0
"""px, below which cells are too small to be read."""

SMALLEST_IMAGE = 16
"""px, side of an image in which nothing can be found."""

LEAST_CORRELATION = 0.8
"""Of a quad's cells with a code. Clutter reaches 0.75, and so do other codes of a dictionary of 50."""


class ArucoDetector:
    """Finds the track's markers in grey or colour images.

    Constructing it compiles what it needs, so that nothing is compiled in flight.
    """

    def __init__(self, config: Config, track: Track) -> None:
        code = getattr(cv2.aruco, f"DICT_{track.gate.dictionary}")
        dictionary = cv2.aruco.getPredefinedDictionary(code)
        self._known = frozenset(marker for gate in track.gates for marker in gate.markers)
        self._modules = dictionary.markerSize + 2
        self._templates = code_templates(_codes(dictionary))
        self._parameters = _parameters()
        self._finder = cv2.aruco.ArucoDetector(dictionary, self._parameters)
        self._read(np.zeros((SMALLEST_IMAGE, SMALLEST_IMAGE), np.uint8), np.zeros((0, 4, 2)))

    def detect(self, frame: Frame, regions: Sequence[Vector] | None) -> tuple[MarkerDetection, ...]:
        """The track's markers in ``frame``, each at most once, by id.

        ``regions`` are (4,) boxes x0, y0, x1, y1 in pixels, None for the whole image; they may overlap and reach
        out of the image. The image may be (h, w), (h, w, 1), BGR or BGRA; ValueError if it is not of bytes.
        A frame without an image has been searched by its camera, whose markers are passed on.
        """
        image = frame.image
        if image is None:
            return tuple(marker for marker in frame.markers if marker.marker_id in self._known)
        if image.dtype != np.uint8 or (image.shape[2:] or (1,)) not in {(1,), (3,), (4,)} or image.ndim < 2:
            raise ValueError(f"an image must be bytes, grey or colour; this is {image.dtype} of shape {image.shape}")
        height, width = image.shape[:2]
        whole = np.array([0.0, 0.0, width, height])
        best: dict[int, tuple[float, Vector]] = {}
        for x0, y0, x1, y1 in merge_regions([whole] if regions is None else regions, width, height):
            offset = np.array([x0, y0])
            for marker_id, score, corners in self._search(_grey(image[y0:y1, x0:x1])):
                if marker_id not in best or score > best[marker_id][0]:
                    best[marker_id] = (score, corners + offset)
        return tuple(MarkerDetection(marker_id, best[marker_id][1]) for marker_id in sorted(best))

    def _search(self, image: Image) -> list[tuple[int, float, Vector]]:
        """Id, correlation and corners (4, 2) of each quad in ``image`` that shows one of the track's markers."""
        if min(image.shape) < SMALLEST_IMAGE:
            return []
        self._parameters.minMarkerPerimeterRate = SMALLEST_PERIMETER / max(image.shape)
        self._finder.setDetectorParameters(self._parameters)
        read, _, unread = self._finder.detectMarkers(image)
        quads = np.array([*read, *unread], float).reshape(-1, 4, 2)
        return self._read(image, quads) if len(quads) else []

    def _read(self, image: Image, quads: Vector) -> list[tuple[int, float, Vector]]:
        refined = refine_corners(image, quads, self._modules)
        scores = correlate(read_cells(image, refined, self._modules), self._templates)
        found = []
        for corners, score in zip(refined, scores, strict=True):
            marker_id, turns = divmod(int(score.argmax()), 4)
            if marker_id in self._known and score.max() > LEAST_CORRELATION:
                found.append((marker_id, float(score.max()), np.roll(corners, turns, axis=0)))
        return found


def _grey(image: NDArray[np.uint8]) -> Image:
    """A contiguous, writable grey picture, which is what the kernels are compiled for."""
    if image.ndim == 3 and image.shape[2] > 1:
        code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), code), np.uint8)
    return np.require(image.reshape(image.shape[:2]), requirements=["C", "W"])


def _codes(dictionary: Any) -> NDArray[np.uint8]:
    """(k, n, n) cells of all markers of ``dictionary``, 1 for white."""
    side = dictionary.markerSize + 2
    pictures = [dictionary.generateImageMarker(marker, side) for marker in range(len(dictionary.bytesList))]
    return np.stack([picture[1:-1, 1:-1] > 127 for picture in pictures]).astype(np.uint8)


def _parameters() -> Any:
    """Settings with which OpenCV finds as many quads of 15 to 70 px a side as by default, in less time."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = 9
    parameters.minDistanceToBorder = 1
    # Of quads inside each other OpenCV would keep one, and not always the marker: here the code decides.
    parameters.minMarkerDistanceRate = 0.05
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return parameters
