"""What every detector keeps to, whatever the picture."""

from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path

import cv2
import numpy as np
import pytest
from marker_scenes import Scene, draw
from perception_cases import PINHOLE, config, track

from flightapp.config import Config, Detection
from flightapp.interfaces import Detector
from flightapp.messages import Frame, MarkerDetection
from flightapp.modules import find
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.gate_pose import GatePoseSolver
from flightapp.perception.opencv import OpencvDetector

TRACK = track(gates=2)
SMALL = (240, 320)
IDS = (0, 1, 2, 3, 4, 5)
OURS = {"aruco": ArucoDetector, "opencv": OpencvDetector}
KINDS = OURS | {entry.name: entry.load() for entry in entry_points(group="flightapp.detectors")}


@lru_cache(maxsize=8)
def detector(name: str) -> Detector:
    return KINDS[name](config(), TRACK)


@lru_cache(maxsize=1)
def scene() -> Scene:
    return draw(20300, 30.0, 0.0, IDS, SMALL)


def frame(image: np.ndarray | None, markers: tuple[MarkerDetection, ...] = ()) -> Frame:
    return Frame(0.0, 0, image, markers)


def ids(found: tuple[MarkerDetection, ...]) -> list[int]:
    return [marker.marker_id for marker in found]


def poster(marker: np.ndarray, shape: tuple[int, int] = SMALL, side: int = 60) -> np.ndarray:
    """``marker`` on white paper in the middle of a grey image."""
    image = np.full(shape, 120, np.uint8)
    top, left = (shape[0] - side) // 2, (shape[1] - side) // 2
    rim = side // 5
    image[top - rim : top + side + rim, left - rim : left + side + rim] = 230
    image[top : top + side, left : left + side] = cv2.resize(marker, (side, side), interpolation=cv2.INTER_NEAREST)
    return image


def generated(marker_id: int, dictionary: int = cv2.aruco.DICT_4X4_50) -> np.ndarray:
    return cv2.aruco.getPredefinedDictionary(dictionary).generateImageMarker(marker_id, 120)


every = pytest.mark.parametrize("name", KINDS)


@every
def test_markers_are_found_wherever_they_are_sought(name: str) -> None:
    picture = scene()
    whole = np.array([-50.0, -50.0, 1000.0, 1000.0])
    for regions in (None, [whole], [whole, whole]):
        found = detector(name).detect(frame(picture.image), regions)
        assert ids(found) == list(IDS)
        for marker in found:
            assert marker.corners.shape == (4, 2)
            assert np.abs(marker.corners - picture.corners[marker.marker_id]).max() < 1.5
            assert 0.0 < marker.quality <= 1.0


@every
def test_regions_bound_the_search(name: str) -> None:
    picture = scene()
    boxes = [np.r_[picture.corners[n].min(axis=0) - 16.0, picture.corners[n].max(axis=0) + 16.0] for n in IDS]
    assert ids(detector(name).detect(frame(picture.image), [boxes[4], boxes[1]])) == [1, 4]
    assert detector(name).detect(frame(picture.image), []) == ()
    assert detector(name).detect(frame(picture.image), [np.full(4, np.nan)]) == ()


@every
def test_images_of_any_layout_give_the_same(name: str) -> None:
    grey = scene().image
    expected = detector(name).detect(frame(grey), None)
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
        cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA),
        np.repeat(grey[:, :, None], 6, axis=2)[:, :, ::2],
    ):
        before = image.copy()
        found = detector(name).detect(frame(image), None)
        assert ids(found) == list(IDS)
        assert all(np.array_equal(a.corners, b.corners) for a, b in zip(found, expected, strict=True))
        assert np.array_equal(image, before)


@every
@pytest.mark.parametrize("content", ["noise", "black", "white", "squares"])
def test_images_of_any_size_are_no_trouble(name: str, content: str) -> None:
    rng = np.random.default_rng(20301)
    for shape in [(0, 0), (0, 7), (1, 1), (1, 640), (2, 3), (3, 2), (11, 13), (12, 12), (17, 33), (301, 2), (479, 641)]:
        rows, columns = np.indices(shape)
        image = {
            "noise": rng.integers(0, 255, shape),
            "black": np.zeros(shape),
            "white": np.full(shape, 255),
            "squares": 255 * ((rows // 9 + columns // 9) % 2),
        }[content].astype(np.uint8)
        for regions in (None, [np.array([-3.0, -3.0, 5000.0, 5000.0])], [np.array([0.2, 0.2, 0.9, 0.9])]):
            assert detector(name).detect(frame(image), regions) == ()


@every
@pytest.mark.parametrize("image", [np.zeros((48, 64)), np.zeros((48, 64, 2), np.uint8), np.zeros(64, np.uint8)])
def test_what_is_no_image_is_refused(name: str, image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="must be bytes"):
        detector(name).detect(frame(image), None)


@every
def test_a_frame_without_an_image_passes_on_the_cameras_own_markers(name: str) -> None:
    quad = np.array([[1.0, 1.0], [9.0, 1.0], [9.0, 9.0], [1.0, 9.0]])
    known, unknown = MarkerDetection(3, quad), MarkerDetection(8, quad)
    assert detector(name).detect(frame(None, (known, unknown)), [np.zeros(4)]) == (known,)
    assert detector(name).detect(frame(None), None) == ()


@every
def test_a_marker_that_is_there_twice_is_given_once(name: str) -> None:
    image = np.hstack((poster(generated(2)), poster(generated(2))))
    found = detector(name).detect(frame(image), None)
    assert ids(found) == [2]


@every
def test_the_tracks_markers_alone_are_given(name: str) -> None:
    assert ids(detector(name).detect(frame(poster(generated(5))), None)) == [5]
    for marker_id in (8, 9, 30, 49):
        assert detector(name).detect(frame(poster(generated(marker_id))), None) == ()


@every
def test_what_looks_like_a_marker_is_none(name: str) -> None:
    decoys = [np.zeros((60, 60), np.uint8), np.full((60, 60), 90, np.uint8)]
    decoys += [generated(n, cv2.aruco.DICT_6X6_250) for n in range(8)]
    decoys += [generated(n, cv2.aruco.DICT_5X5_100) for n in range(8)]
    decoys += [np.ascontiguousarray(generated(n)[:, ::-1]) for n in IDS]
    decoys += [255 - generated(n) for n in IDS]
    for decoy in decoys:
        for side in (24, 61):
            assert detector(name).detect(frame(poster(decoy, side=side)), None) == ()


PLUGIN = """
import numpy as np
from flightapp.messages import MarkerDetection

class Learned:
    \"\"\"Stands for a network: takes the brightest pixel for the middle of marker 3.\"\"\"

    def __init__(self, config, track):
        self.known = {marker for gate in track.passage for marker in gate.markers}

    def detect(self, frame, regions):
        y, x = np.unravel_index(frame.image.argmax(), frame.image.shape)
        square = np.array([[-12.0, -12.0], [12.0, -12.0], [12.0, 12.0], [-12.0, 12.0]])
        return (MarkerDetection(3, np.array([x, y]) + square, 0.7),) if 3 in self.known else ()
"""


def test_a_detector_of_another_package_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installed, it has a module and an entry point; `detection.detector` is then its name."""
    (tmp_path / "learned_gates.py").write_text(PLUGIN)
    installed = tmp_path / "learned_gates-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: learned-gates\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[flightapp.detectors]\nlearned = learned_gates:Learned\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    chosen = Config(detection=Detection(detector="learned"))
    plugin: Detector = find("detectors", chosen.detection.detector)(chosen, TRACK)
    image = np.zeros(SMALL, np.uint8)
    image[120, 160] = 255
    (marker,) = plugin.detect(frame(image), None)
    (sighting,) = GatePoseSolver(chosen, TRACK, PINHOLE).solve(0.0, [marker])
    assert (marker.marker_id, sighting.gate_id, sighting.markers) == (3, 10, 1)
