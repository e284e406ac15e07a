"""How often a detector sees markers where there are none."""

from collections.abc import Sequence

import cv2
import numpy as np

from flightapp.evaluation.detection_images import PER_MODULE, Blur, Conditions, Image, draw_picture, marker_texture
from flightapp.interfaces import Detector
from flightapp.messages import Frame
from flightapp.perception.camera import CameraModel

DECOYS = 6
"""In every second picture; the others are background alone."""
OTHERS = (cv2.aruco.DICT_5X5_1000, cv2.aruco.DICT_6X6_1000, cv2.aruco.DICT_7X7_1000, cv2.aruco.DICT_ARUCO_ORIGINAL)


def decoy_texture(ids: range, generator: np.random.Generator) -> Image:
    """Something like a 4X4 marker of ``ids``, but none.

    Markers of the larger dictionary of the same cells and of other dictionaries, mirrored and inverted markers, black
    squares and chessboards.
    """
    kind = int(generator.integers(8))
    if kind < 3:
        return marker_texture(cv2.aruco.DICT_4X4_1000, int(generator.integers(ids.stop, 1000)))
    if kind == 3:
        return marker_texture(int(generator.choice(OTHERS)), int(generator.integers(1000)))
    if kind == 4:
        marker = marker_texture(cv2.aruco.DICT_4X4_50, int(generator.choice(ids)))
        mirrored = np.ascontiguousarray(marker[:, ::-1])
        # Some markers are their own mirror images.
        same = any(np.array_equal(np.rot90(mirrored, turn), marker) for turn in range(4))
        return decoy_texture(ids, generator) if same else mirrored
    if kind == 5:
        return np.asarray(255 - marker_texture(cv2.aruco.DICT_4X4_50, int(generator.choice(ids))), np.uint8)
    cells = np.zeros((6, 6), np.uint8)
    if kind == 6:
        rows, columns = np.indices(cells.shape)
        cells[:] = 255 * ((rows + columns) % 2)
    return np.kron(cells, np.ones((PER_MODULE, PER_MODULE), np.uint8))


def false_ids(
    detector: Detector, camera: CameraModel, ids: range, seeds: Sequence[int], tracking: bool
) -> list[tuple[int, int, float]]:
    """(seed, id, quality) of each marker of the 4X4_50 dictionary seen in pictures without any, one for each seed.

    ``tracking`` has the detector search boxes about the decoys, and the middle of the pictures that have none.
    """
    seen = []
    for seed in seeds:
        generator = np.random.default_rng(seed)
        textures = {n: decoy_texture(ids, generator) for n in range(DECOYS * (seed % 2))}
        conditions = Conditions(
            size=generator.uniform(12.0, 80.0),
            blur=generator.uniform(0.0, 6.0),
            blur_kind=Blur.MOTION if generator.random() < 0.5 else Blur.DEFOCUS,
            noise=generator.uniform(1.0, 8.0),
            brightness=generator.uniform(0.3, 1.0),
            rim=generator.uniform(0.4, 1.5),
            clutter=generator.uniform(0.0, 40.0),
            jpeg=int(generator.choice((0, 40, 80))),
        )
        picture = draw_picture(camera, textures, conditions, generator)
        boxes = [np.concatenate((c.min(axis=0) - 20.0, c.max(axis=0) + 20.0)) for c in picture.corners.values()]
        middle = [np.array((camera.width, camera.height, 3.0 * camera.width, 3.0 * camera.height)) / 4.0]
        found = detector.detect(Frame(0.0, 0, picture.image), (boxes or middle) if tracking else None)
        seen += [(seed, marker.marker_id, marker.quality) for marker in found]
    return seen
