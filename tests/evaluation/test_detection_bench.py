"""Detectors side by side: the pictures, the judging and the table."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rich.console import Console

from flightapp.config import Config
from flightapp.evaluation.detection_bench import bench_cameras, bench_track, detection_table, judge, predicted_regions
from flightapp.evaluation.detection_images import Blur, Conditions, draw_picture, marker_texture
from flightapp.evaluation.false_ids import false_ids
from flightapp.messages import Frame
from flightapp.perception.aruco import ArucoDetector

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
    detector, camera = ArucoDetector(Config(), bench_track((1, 2, 3, 4))), bench_cameras()["pinhole"]
    for tracking in (False, True):
        assert false_ids(detector, camera, range(50), range(20610, 20622), tracking) == []


def test_dark_shapes_without_straight_sides_are_no_markers() -> None:
    """Within the inverted marker 12 lies a dark shape with a bright cell, all of it as in marker 17."""
    detector, camera = ArucoDetector(Config(), bench_track((16, 17, 18, 19))), bench_cameras()["pinhole"]
    inverted = np.asarray(255 - marker_texture(cv2.aruco.DICT_4X4_50, 12), np.uint8)
    for seed in range(20200, 20206):
        textures = dict.fromkeys(range(6), inverted)
        picture = draw_picture(camera, textures, Conditions(size=60.0, blur=1.0), np.random.default_rng(seed))
        assert detector.detect(Frame(0.0, 0, picture.image), None) == ()
