"""What perception costs."""

from typing import Any

import cv2
import numpy as np
import pytest
from marker_scenes import Scene, draw
from perception_cases import PINHOLE, config, gate_pixels, track

from flightapp.frames import quat_from_euler
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.gate_pose import GatePoseSolver

TRACK = track()


@pytest.fixture(scope="module")
def picture() -> Scene:
    return draw(8, 35.0, 2.0, (0, 1, 2, 3))


@pytest.fixture(autouse=True)
def one_thread() -> Any:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def test_opencv_full_frame(benchmark: Any, picture: Scene) -> None:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    assert len(benchmark(detector.detectMarkers, picture.image)[0]) == 4


def test_full_frame(benchmark: Any, picture: Scene) -> None:
    detector = ArucoDetector(config(), TRACK)
    assert len(benchmark(detector.detect, Frame(0.0, 0, picture.image), None)) == 4


@pytest.mark.parametrize("count", [1, 4])
def test_regions(benchmark: Any, picture: Scene, count: int) -> None:
    detector = ArucoDetector(config(), TRACK)
    corners = [picture.corners[n] for n in range(count)]
    boxes = [np.concatenate((quad.min(axis=0) - 20.0, quad.max(axis=0) + 20.0)) for quad in corners]
    assert len(benchmark(detector.detect, Frame(0.0, 0, picture.image), boxes)) == count


@pytest.mark.parametrize("count", [1, 4])
def test_pose(benchmark: Any, count: int) -> None:
    solver = GatePoseSolver(config(), TRACK, PINHOLE)
    pixels = gate_pixels(PINHOLE, TRACK.gate, np.array([4.0, 0.3, 0.5]), quat_from_euler(0.1, 0.0, 0.4))
    noisy = pixels + 0.3 * np.random.default_rng(1).standard_normal(pixels.shape)
    markers = [MarkerDetection(n, quad) for n, quad in enumerate(noisy[:count])]
    assert len(benchmark(solver.solve, 0.0, markers)) == 1
