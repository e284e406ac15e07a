"""Finding markers in drawn pictures, whole and by regions."""

import math
from functools import lru_cache

import cv2
import numpy as np
import pytest
from marker_scenes import Scene, draw
from perception_cases import config, track

from flightapp.evaluation.detection_bench import bench_cameras
from flightapp.evaluation.detection_images import Blur, Conditions, draw_picture, marker_texture
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.aruco import ArucoDetector

TRACK = track(gates=2)
SMALL = (240, 320)
IDS = (0, 1, 2, 3, 4, 5)


@lru_cache(maxsize=16)
def scene(size: float, blur: float = 0.0, **options: int) -> Scene:
    return draw(round(10 * size + blur), size, blur, IDS, SMALL, **options)


@lru_cache(maxsize=1)
def aruco() -> ArucoDetector:
    return ArucoDetector(config(), TRACK)


def frame(image: np.ndarray | None, markers: tuple[MarkerDetection, ...] = ()) -> Frame:
    return Frame(0.0, 0, image, markers)


def corner_rms(found: tuple[MarkerDetection, ...], truth: Scene) -> float:
    squares = [((marker.corners - truth.corners[marker.marker_id]) ** 2).sum(axis=1) for marker in found]
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize(("size", "blur", "accuracy"), [(15, 0, 0.15), (15, 2, 0.3), (30, 4, 0.3), (50, 6, 0.3)])
def test_markers_are_found_where_they_are(size: float, blur: float, accuracy: float) -> None:
    picture = scene(size, blur)
    found = aruco().detect(frame(picture.image), None)
    assert [marker.marker_id for marker in found] == list(IDS)
    assert corner_rms(found, picture) < accuracy


def test_edge_fits_are_several_times_as_accurate_as_opencv() -> None:
    picture = scene(20, 2)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    plain = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    corners, ids, _ = plain.detectMarkers(picture.image)
    theirs = tuple(MarkerDetection(int(n), quad.reshape(4, 2)) for n, quad in zip(ids.ravel(), corners, strict=True))
    ours = aruco().detect(frame(picture.image), None)
    assert corner_rms(ours, picture) < 0.4 * corner_rms(theirs, picture)


def test_only_regions_are_searched_and_nothing_is_lost_there() -> None:
    picture = scene(30, 0)
    boxes = [
        np.concatenate((picture.corners[n].min(axis=0) - 15.0, picture.corners[n].max(axis=0) + 15.0)) for n in IDS
    ]
    found = aruco().detect(frame(picture.image), [boxes[4], boxes[1], boxes[4] + 3.0])
    assert [marker.marker_id for marker in found] == [1, 4]
    assert corner_rms(found, picture) < 0.15
    assert aruco().detect(frame(picture.image), []) == ()


def test_every_turn_of_a_marker_gives_its_own_corners() -> None:
    picture = scene(30, 0)
    height, width = SMALL
    for quarters in range(4):
        turned = aruco().detect(frame(np.rot90(picture.image, quarters)), None)
        assert [marker.marker_id for marker in turned] == list(IDS)
        for marker in turned:
            corners, size = picture.corners[marker.marker_id], np.array([width, height])
            for _ in range(quarters):
                corners = np.column_stack((corners[:, 1], size[0] - 1.0 - corners[:, 0]))
                size = size[::-1]
            assert np.abs(marker.corners - corners).max() < 0.5


def test_clutter_and_foreign_markers_are_not_mistaken() -> None:
    for seed in range(3):
        foreign = draw(seed, 25.0, 2.0, ids=tuple(range(20 + 6 * seed, 26 + 6 * seed)), shape=SMALL, clutter=40.0)
        assert aruco().detect(frame(foreign.image), None) == ()


def test_other_dictionaries_are_read() -> None:
    picture = draw(5, 45.0, 1.0, IDS, SMALL, dictionary=cv2.aruco.DICT_6X6_250, bits=6)
    found = ArucoDetector(config(), track(gates=2, dictionary="6X6_250")).detect(frame(picture.image), None)
    assert [marker.marker_id for marker in found] == list(IDS)
    assert corner_rms(found, picture) < 0.2


def test_codes_that_differ_by_a_bit_or_two_are_not_mistaken() -> None:
    """Markers of the larger dictionary of the same kind are as near to ours as any can be."""
    large = cv2.aruco.DICT_4X4_1000
    ours = [cv2.aruco.getPredefinedDictionary(large).generateImageMarker(n, 6) for n in range(50)]
    nearest = sorted(
        range(50, 1000),
        key=lambda n: min(
            int((np.rot90(cv2.aruco.getPredefinedDictionary(large).generateImageMarker(n, 6), r) != code).sum())
            for r in range(4)
            for code in ours[: len(IDS)]
        ),
    )
    for blur in (0.0, 2.0):
        decoys = draw(20400, 30.0, blur, tuple(nearest[:12]), dictionary=large)
        assert aruco().detect(frame(decoys.image), None) == ()


def test_doubtful_readings_are_believed_where_markers_are_expected_alone() -> None:
    """The larger blur smears cells of 2.5 px over each other."""
    expected, anywhere = 0, 0
    for seed in range(20410, 20420):
        picture = draw(seed, 15.0, 4.5, IDS, SMALL)
        boxes = [np.r_[quad.min(axis=0) - 20.0, quad.max(axis=0) + 20.0] for quad in picture.corners.values()]
        known = aruco().detect(frame(picture.image), boxes)
        sure = aruco().detect(frame(picture.image), None)
        assert all(marker.quality >= 0.78 for marker in sure)
        expected, anywhere = expected + len(known), anywhere + len(sure)
    assert expected > anywhere > 0


@pytest.mark.parametrize(("size", "blur"), [(18.0, 0.0), (30.0, 1.0), (30.0, 4.0), (50.0, 6.0)])
def test_corners_are_off_by_about_what_is_told_of_them(size: float, blur: float) -> None:
    textures = {n: marker_texture(cv2.aruco.DICT_4X4_50, n) for n in IDS}
    off2, told2 = [], []
    for seed in range(20430, 20442):
        rng = np.random.default_rng(seed)
        conditions = Conditions(size=size, blur=blur, blur_kind=list(Blur)[seed % 2], brightness=rng.uniform(0.3, 1.0))
        picture = draw_picture(bench_cameras()["pinhole"], textures, conditions, rng)
        markers = aruco().detect(frame(picture.image), None)
        off2 += [np.mean((marker.corners - picture.corners[marker.marker_id]) ** 2) for marker in markers]
        told2 += [marker.noise**2 for marker in markers]
    assert len(off2) > 60
    assert 0.6 < math.sqrt(np.mean(off2) / np.mean(told2)) < 1.5


@pytest.mark.parametrize("margin", [1, 3])
def test_markers_at_the_images_border_are_found(margin: int) -> None:
    picture = scene(30, 0)
    for marker_id, quad in picture.corners.items():
        x0, y0 = np.floor(quad.min(axis=0)).astype(int) - margin
        x1, y1 = np.ceil(quad.max(axis=0)).astype(int) + margin + 1
        found = aruco().detect(frame(picture.image[y0:y1, x0:x1]), None)
        assert [marker.marker_id for marker in found] == [marker_id]
        assert np.abs(found[0].corners + np.array([x0, y0]) - quad).max() < 1.0


def test_a_small_marker_beside_a_large_one_is_found_in_its_own_box() -> None:
    """Small ones are sought only where none has been found yet; here the large one lies in both boxes."""
    image = np.full((200, 300), 120, np.uint8)
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    places = {1: (60, 70, 80), 2: (160, 90, 14)}
    boxes = []
    for marker_id, (x, y, side) in places.items():
        rim = max(side // 6, 3)
        image[y - rim : y + side + rim, x - rim : x + side + rim] = 230
        image[y : y + side, x : x + side] = markers.generateImageMarker(marker_id, side)
        boxes.append(np.array((x - 30.0, y - 30.0, x + side + 30.0, y + side + 30.0)))
    picture = frame(cv2.GaussianBlur(image, (0, 0), 0.6))
    boxes[1] = np.array((50.0, 60.0, 204.0, 160.0))
    assert [marker.marker_id for marker in aruco().detect(picture, boxes)] == [1, 2]
    assert [marker.marker_id for marker in aruco().detect(picture, boxes[:1])] == [1]
