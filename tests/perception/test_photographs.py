"""Our detector beside OpenCV's, on pictures as cameras take them."""

from functools import cache

import cv2
import numpy as np
import pytest
from perception_cases import PINHOLE, track
from photographs import EFFECTS, GOOD, photograph

from flightapp.config import Config
from flightapp.evaluation.detection_bench import Score, bench_track, judge
from flightapp.interfaces import Detector
from flightapp.messages import Frame
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.opencv import OpencvDetector

SEEDS = range(20800, 20803)
DICTIONARIES = {
    "4X4_1000": (0, 57, 423, 999),
    "5X5_100": (0, 1, 50, 99),
    "6X6_250": (23, 40, 98, 203),
    "7X7_1000": (5, 77, 640, 999),
    "ARUCO_ORIGINAL": (1, 77, 500, 1000),
    "ARUCO_MIP_36h12": (0, 9, 100, 249),
    "APRILTAG_16h5": (0, 1, 15, 29),
    "APRILTAG_25h9": (0, 7, 20, 34),
    "APRILTAG_36h11": (0, 100, 300, 586),
}


@cache
def detector(kind: type[Detector]) -> Detector:
    return kind(Config(), bench_track())  # type: ignore[call-arg]


@cache
def score(kind: type[Detector], name: str) -> Score:
    total, effect = Score(), EFFECTS[name]
    for seed in SEEDS:
        picture = photograph(effect, PINHOLE, seed, (0, 1, 2, 3))
        total.add(judge(detector(kind), picture, effect.conditions.size, None, repeats=1))
    return total


WEAK = {"covered in part": "a marker over whose border another's paper lies is given up sooner"}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.xfail(strict=True, reason=WEAK[n])) if n in WEAK else n for n in EFFECTS]
)
def test_hardly_a_marker_is_missed_that_opencv_finds(name: str) -> None:
    ours, theirs = score(ArucoDetector, name), score(OpencvDetector, name)
    assert ours.false == 0
    assert ours.found >= theirs.found - 1


def test_more_markers_are_found_than_by_opencv_and_more_accurately() -> None:
    ours, theirs = Score(), Score()
    for name in EFFECTS:
        ours.add(score(ArucoDetector, name))
        theirs.add(score(OpencvDetector, name))
    assert ours.found > theirs.found
    assert np.mean(ours.squares) < 0.5 * np.mean(theirs.squares)


@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_markers_of_every_kind_are_read(dictionary: str) -> None:
    ids = DICTIONARIES[dictionary]
    picture = photograph(GOOD, PINHOLE, 20810, ids, getattr(cv2.aruco, f"DICT_{dictionary}"))
    found = ArucoDetector(Config(), bench_track(ids, dictionary)).detect(Frame(0.0, 0, picture.image), None)
    assert [marker.marker_id for marker in found] == list(ids)
    for marker in found:
        assert np.abs(marker.corners - picture.corners[marker.marker_id]).max() < 0.3


@pytest.mark.parametrize("size", [60.0, 400.0, 1500.0])
def test_large_pictures_are_searched_for_markers_small_and_large(size: float) -> None:
    """Of 12 megapixels, as telephones take them."""
    image = np.full((3000, 4000), 150, np.uint8)
    side, at = round(size), (700, 900)
    marker = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50).generateImageMarker(2, side)
    rim = side // 6
    image[at[1] - rim : at[1] + side + rim, at[0] - rim : at[0] + side + rim] = 230
    image[at[1] : at[1] + side, at[0] : at[0] + side] = marker
    noisy = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(20811).normal(0.0, 4.0, image.shape)
    (found,) = ArucoDetector(Config(), track()).detect(Frame(0.0, 0, np.clip(noisy, 0, 255).astype(np.uint8)), None)
    corners = np.array(((0, 0), (side, 0), (side, side), (0, side))) + at - 0.5
    assert found.marker_id == 2
    assert np.abs(found.corners - corners).max() < 0.3
