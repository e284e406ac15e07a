"""Detectors side by side: the pictures, the judging and the table."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rich.console import Console

from flightapp.config import Config
from flightapp.evaluation.decoys import SHAPE, decoy_texture
from flightapp.evaluation.detection_bench import bench_cameras, bench_track, detection_table, judge, predicted_regions
from flightapp.evaluation.detection_images import Blur, Conditions, draw_picture, marker_texture
from flightapp.evaluation.false_ids import false_ids, false_ids_line, knows_all_ids
from flightapp.frames import Vector
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.decoding import marker_codes

TEXTURES = {n: marker_texture(cv2.aruco.DICT_4X4_50, n) for n in range(4)}


@pytest.mark.parametrize("lens", bench_cameras())
@pytest.mark.parametrize("kind", list(Blur))
def test_pictures_show_markers_where_they_say(lens: str, kind: Blur) -> None:
    """By OpenCV's detector, which knows nothing of how they are drawn."""
    rng = np.random.default_rng(20600)
    picture = draw_picture(
        bench_cameras()[lens], TEXTURES, Conditions(size=40.0, blur=1.0, blur_kind=kind, jpeg=90, tilt=0.3), rng
    )
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(picture.image)
    assert sorted(ids.ravel().tolist()) == list(TEXTURES)
    for n, quad in zip(ids.ravel().tolist(), corners, strict=True):
        assert np.abs(quad.reshape(4, 2) - picture.corners[n]).max() < 1.0


def test_detectors_are_judged_by_the_truth() -> None:
    config, rng = Config(), np.random.default_rng(20601)
    detector = ArucoDetector(config, bench_track())
    picture = draw_picture(bench_cameras()["pinhole"], TEXTURES, Conditions(size=40.0), rng)
    score = judge(detector, picture, 40.0, predicted_regions(picture, 20.0, rng), repeats=1)
    assert (score.markers, score.found, score.false, len(score.squares)) == (4, 4, 0, 16)
    assert 0.0 < score.as_row()["corner_rms"] < 0.4
    shifted = {n: corners + 6.0 for n, corners in picture.corners.items()}
    elsewhere = judge(detector, replace(picture, corners=shifted), 40.0, None, repeats=1)
    assert (elsewhere.found, elsewhere.false) == (0, 4)
    score.add(elsewhere)
    assert score.as_row()["found"] == 0.5
    row = {"camera": "pinhole", "size": None, "blur": None, "detectors": {"aruco_full": score.as_row()}}
    console = Console(width=200, record=True)
    console.print(detection_table({"rows": [row]}))
    assert "50%" in console.export_text()


def test_decoys_are_no_markers() -> None:
    assert false_ids(ArucoDetector(Config(), knows_all_ids()), range(20610, 20710)) == []


def test_decoys_that_were_once_misread_are_not() -> None:
    """A sharp one that fitted badly, three that resembled id 17, and two blurred ones."""
    misread = (10064571, 10080282, 10081197, 12015816, 11010419, 12010382)
    assert false_ids(ArucoDetector(Config(), knows_all_ids()), misread) == []


def test_false_ids_are_counted_in_both_ways_of_searching() -> None:
    """A detector that takes the middle of whatever it is given for a marker is found out."""

    class Credulous:
        def detect(self, frame: Frame, regions: Sequence[Vector] | None) -> tuple[MarkerDetection, ...]:
            assert frame.image is not None
            assert frame.image.shape == SHAPE
            return tuple(MarkerDetection(7, np.zeros((4, 2)), 0.5) for _ in regions or [None])

    seen = false_ids(Credulous(), range(20720, 20730))
    assert sum(not one.tracking for one in seen) == 10
    assert sum(one.tracking for one in seen) >= 10
    assert {one.seed for one in seen} == set(range(20720, 20730))
    told = false_ids_line({"pictures": 10, "first_seed": 20720, "last_seed": 20729, "false": []})
    assert told == "0 false ids in 10 pictures, each searched twice (seeds 20720 to 20729)"


@pytest.mark.parametrize("seed", range(20730, 20733))
def test_decoys_differ_from_every_marker(seed: int) -> None:
    """Whatever has cells of black and white; what is grey in between is like none anyway."""
    rng = np.random.default_rng(seed)
    codes = marker_codes(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    known = np.pad(codes, ((0, 0), (1, 1), (1, 1)))
    for _ in range(100):
        texture = decoy_texture(rng)
        cells = cv2.resize(texture, (6, 6), interpolation=cv2.INTER_AREA) / 255.0
        if np.minimum(cells, 1.0 - cells).max() < 0.25:
            turns = [np.abs(np.rot90(known, turn, axes=(1, 2)) - cells).max(axis=(1, 2)) for turn in range(4)]
            assert np.min(turns) > 0.7


def test_dark_shapes_without_straight_sides_are_no_markers() -> None:
    """Within the inverted marker 12 lies a dark shape with a bright cell, all of it as in marker 17."""
    detector, camera = ArucoDetector(Config(), bench_track((16, 17, 18, 19))), bench_cameras()["pinhole"]
    inverted = np.asarray(255 - marker_texture(cv2.aruco.DICT_4X4_50, 12), np.uint8)
    for seed in range(20200, 20206):
        textures = dict.fromkeys(range(6), inverted)
        picture = draw_picture(camera, textures, Conditions(size=60.0, blur=1.0), np.random.default_rng(seed))
        assert detector.detect(Frame(0.0, 0, picture.image), None) == ()
