"""Finding markers in drawn pictures, whole and by regions."""

from functools import lru_cache
from importlib.metadata import entry_points

import cv2
import numpy as np
import pytest
from marker_scenes import Scene, draw
from perception_cases import config, track

from flightapp.interfaces import Detector
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


def test_images_of_any_layout_are_read() -> None:
    grey = scene(30, 0).image
    expected = aruco().detect(frame(grey), None)
    assert len(expected) == len(IDS)
    frozen = grey.copy()
    frozen.flags.writeable = False
    strided = np.zeros((2 * SMALL[0], 2 * SMALL[1]), np.uint8)
    strided[::2, ::2] = grey
    for image in (
        frozen,
        strided[::2, ::2],
        np.asfortranarray(grey),
        grey[:, :, None],
        cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR),
        cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA)[:, :, :],
        np.repeat(grey[:, :, None], 6, axis=2)[:, :, ::2],
    ):
        before = image.copy()
        found = aruco().detect(frame(image), None)
        assert [marker.marker_id for marker in found] == list(IDS)
        assert all(np.array_equal(a.corners, b.corners) for a, b in zip(found, expected, strict=True))
        assert np.array_equal(image, before)


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (3, 640), (17, 33), (479, 641)])
def test_odd_sizes_are_no_trouble(shape: tuple[int, int]) -> None:
    noise = np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8)
    assert aruco().detect(frame(noise), None) == ()


@pytest.mark.parametrize("image", [np.zeros((48, 64)), np.zeros((48, 64, 2), np.uint8), np.zeros(64, np.uint8)])
def test_what_is_no_image_is_refused(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="must be bytes"):
        aruco().detect(frame(image), None)


def test_clutter_and_foreign_markers_are_not_mistaken() -> None:
    for seed in range(3):
        foreign = draw(seed, 25.0, 2.0, ids=tuple(range(20 + 6 * seed, 26 + 6 * seed)), shape=SMALL, clutter=40.0)
        assert aruco().detect(frame(foreign.image), None) == ()


def test_other_dictionaries_are_read() -> None:
    picture = draw(5, 45.0, 1.0, IDS, SMALL, dictionary=cv2.aruco.DICT_6X6_250, bits=6)
    found = ArucoDetector(config(), track(gates=2, dictionary="6X6_250")).detect(frame(picture.image), None)
    assert [marker.marker_id for marker in found] == list(IDS)
    assert corner_rms(found, picture) < 0.2


def test_a_frame_without_an_image_passes_on_the_cameras_own_markers() -> None:
    quad = np.array([[1.0, 1.0], [9.0, 1.0], [9.0, 9.0], [1.0, 9.0]])
    known, unknown = MarkerDetection(3, quad), MarkerDetection(8, quad)
    elsewhere = [np.array([100.0, 100.0, 120.0, 120.0])]
    assert aruco().detect(frame(None, (known, unknown)), elsewhere) == (known,)


@pytest.mark.parametrize("entry", entry_points(group="flightapp.detectors"), ids=lambda entry: entry.name)
def test_every_detector_keeps_the_contract(entry: object) -> None:
    detector: Detector = entry.load()(config(), TRACK)
    picture = scene(30, 0)
    markers = tuple(MarkerDetection(n, picture.corners[n % 6]) for n in (*IDS, 49))
    whole = np.array([-50.0, -50.0, 1000.0, 1000.0])
    for regions in (None, [whole], [whole, whole]):
        found = detector.detect(frame(picture.image, markers), regions)
        assert [marker.marker_id for marker in found] == list(IDS)
        assert corner_rms(found, picture) < 0.2
        assert all(marker.corners.shape == (4, 2) for marker in found)
    assert detector.detect(frame(None), None) == ()
    assert detector.detect(frame(np.zeros(SMALL, np.uint8)), []) == ()
