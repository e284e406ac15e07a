"""OpenCV's own marker detector with its defaults: the reference, and the fallback.

S. Garrido-Jurado et al., "Automatic generation and detection of highly reliable fiducial markers under occlusion"
(2014), with the corners refined by the gradients around them (cornerSubPix).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.boxes import merge_regions
from flightapp.perception.grey import check_image, grey_image
from flightapp.track import Track

SMALLEST_IMAGE = 16
"""px, side of an image in which nothing can be found."""


class OpencvDetector:
    """Finds the track's markers in grey or colour images.

    It corrects errors of the code but doesn't tell how many, so the quality of all its readings is the same.
    """

    def __init__(self, config: Config, track: Track) -> None:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{track.gate.dictionary}"))
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self._parameters, self._least_perimeter = parameters, parameters.minMarkerPerimeterRate
        self._known = frozenset(marker for gate in track.passage for marker in gate.markers)
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def detect(self, frame: Frame, regions: Sequence[Vector] | None) -> tuple[MarkerDetection, ...]:
        """The track's markers in ``frame``, each at most once, by id; as `aruco.ArucoDetector.detect`."""
        if frame.image is None:
            return tuple(marker for marker in frame.markers if marker.marker_id in self._known)
        check_image(frame.image)
        height, width = frame.image.shape[:2]
        best: dict[int, Vector] = {}
        for x0, y0, x1, y1 in [(0, 0, width, height)] if regions is None else merge_regions(regions, width, height):
            image = grey_image(frame.image[y0:y1, x0:x1])
            if min(image.shape) < SMALLEST_IMAGE:
                continue
            # OpenCV takes the least perimeter as a share of the image's longer side; a region's is the whole image's.
            self._parameters.minMarkerPerimeterRate = self._least_perimeter * max(height, width) / max(image.shape)
            self._detector.setDetectorParameters(self._parameters)
            quads, ids, _ = self._detector.detectMarkers(image)
            for number, quad in zip([] if ids is None else ids.ravel(), quads, strict=True):
                marker_id = int(number)
                corners = quad.reshape(4, 2).astype(float) + np.array((x0, y0))
                if marker_id in self._known and (marker_id not in best or _larger(corners, best[marker_id])):
                    best[marker_id] = corners
        return tuple(MarkerDetection(marker_id, best[marker_id]) for marker_id in sorted(best))


def _larger(a: Vector, b: Vector) -> bool:
    return bool(np.ptp(a, axis=0).sum() > np.ptp(b, axis=0).sum())
