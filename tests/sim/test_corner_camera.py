import numpy as np
import pytest
from camera_cases import FISHEYE, PINHOLE, make_track, moving, one_gate, projected
from pytest_benchmark.fixture import BenchmarkFixture

from flightapp.config import Config
from flightapp.frames import Vector, quat_from_euler
from flightapp.messages import Frame, MarkerDetection
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.camera import CameraModel
from flightapp.track import Box, Cylinder, Gate
from sim.corner_camera import CornerCamera
from sim.render import PoseAt, Renderer
from sim.scene import Scene

TRACK = one_gate()
SCENE = Scene.from_track(TRACK)
HEAD_ON = moving((1.5, 0.0, 1.5))


def ids(markers: tuple[MarkerDetection, ...]) -> list[int]:
    return [marker.marker_id for marker in markers]


def test_corners_are_those_of_the_camera_model() -> None:
    camera = CornerCamera(SCENE, PINHOLE, 0.004, 1)
    truth = projected(SCENE, PINHOLE, HEAD_ON)
    errors = []
    for _ in range(200):
        markers = camera.detect(0.0, HEAD_ON)
        assert ids(markers) == [0, 1, 2, 3]
        errors.append([marker.corners - truth[marker.marker_id] for marker in markers])
    assert np.abs(np.mean(errors, axis=0)).max() < 0.02
    assert 0.02 < np.std(errors) < 0.06


@pytest.mark.parametrize(
    "pose_at",
    [
        moving((6.5, 0.0, 1.5), quat_from_euler(0.0, 0.17, np.pi)),
        moving((1.5, 0.0, 1.5), quat_from_euler(0.0, 0.17, np.pi)),
        moving((-20.0, 0.0, 1.5)),
        moving((3.6, 0.0, 1.5)),
    ],
    ids=["from behind", "looking away", "too far", "out of the image"],
)
@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def test_what_cannot_be_seen_is_not_found(camera: CameraModel, pose_at: PoseAt) -> None:
    corners = CornerCamera(SCENE, camera, 0.004, 1)
    seen = {marker for _ in range(20) for marker in ids(corners.detect(0.0, pose_at))}
    assert not seen or (camera is FISHEYE and pose_at(0.0)[0][0] == 3.6)


def test_a_marker_that_reaches_underground_is_not_found() -> None:
    low = Scene.from_track(one_gate((4.0, 0.0, 1.0)))
    assert ids(CornerCamera(low, PINHOLE, 0.004, 1).detect(0.0, moving((1.5, 0.0, 1.2)))) == [0, 1]


def test_gates_and_obstacles_hide_markers() -> None:
    far = Gate(id=0, position=(6.0, 0.0, 1.5), yaw_deg=0.0, markers=(0, 1, 2, 3))
    near = Gate(id=1, position=(2.0, 0.8, 1.5), yaw_deg=0.0, markers=(4, 5, 6, 7))
    box = Box(name="box", centre=(5.0, 0.8, 0.7), size=(0.4, 0.5, 0.6))
    pillar = Cylinder(name="pillar", base=(4.0, 0.7, 0.0), radius=0.25, height=3.0)
    low = Cylinder(name="low", base=(5.0, 0.8, 0.0), radius=0.4, height=1.0)
    pose_at = moving((0.0, 0.0, 1.5))
    for track, expected in (
        (make_track(far), {0, 1, 2, 3}),
        (make_track(near, far), {0, 3}),
        (make_track(far, obstacles=(box,)), {0, 1, 2}),
        (make_track(far, obstacles=(pillar,)), {1, 2}),
        (make_track(far, obstacles=(low,)), {0, 1, 2}),
    ):
        camera = CornerCamera(Scene.from_track(track), PINHOLE, 0.004, 1)
        seen = {marker for _ in range(10) for marker in ids(camera.detect(0.0, pose_at))}
        assert seen & {0, 1, 2, 3} == expected


def test_same_seed_same_corners() -> None:
    first, second = (CornerCamera(SCENE, FISHEYE, 0.004, 9) for _ in range(2))
    for stamp in (0.0, 0.03):
        one, other = first.detect(stamp, HEAD_ON), second.detect(stamp, HEAD_ON)
        assert ids(one) == ids(other)
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a.corners, b.corners)


def jittered(distance: float, oblique: float, rates: tuple[float, float, float], count: int) -> list[PoseAt]:
    rng = np.random.default_rng(11)
    poses = []
    for _ in range(count):
        d, angle = distance * rng.uniform(0.97, 1.03), oblique + rng.uniform(-0.1, 0.1)
        attitude = quat_from_euler(rng.uniform(-0.5, 0.5), 0.17 + rng.uniform(-0.03, 0.03), -angle)
        height = 1.5 + rng.uniform(-0.5, 0.5)
        poses.append(moving((4.0 - d * np.cos(angle), d * np.sin(angle), height), attitude, rates=rates))
    return poses


@pytest.mark.parametrize(
    ("camera", "distance", "oblique", "rates", "rate_bound"),
    [
        (PINHOLE, 3.0, 0.0, (0.0, 0.0, 0.0), 0.02),
        (PINHOLE, 7.5, 0.0, (0.0, 0.0, 1.5), 0.1),
        (PINHOLE, 9.5, 0.0, (0.0, 0.0, 0.0), 0.15),
        (PINHOLE, 4.0, 1.0, (0.0, 0.0, 0.0), 0.2),
        (PINHOLE, 5.0, 0.0, (0.0, 0.0, 3.8), 0.1),
        (FISHEYE, 2.0, 0.5, (0.0, 0.0, 0.0), 0.05),
    ],
    ids=["near", "far", "at the limit", "oblique", "blurred", "fisheye"],
)
def test_agrees_with_rendered_images_and_the_detector(
    camera: CameraModel,
    distance: float,
    oblique: float,
    rates: tuple[float, float, float],
    rate_bound: float,
) -> None:
    count = 24
    renderer, corners = Renderer(SCENE, camera, 0.004, 2), CornerCamera(SCENE, camera, 0.004, 2)
    detector = ArucoDetector(Config(), TRACK)
    hits = [0, 0]
    errors: list[list[Vector]] = [[], []]
    for pose_at in jittered(distance, oblique, rates, count):
        truth = projected(SCENE, camera, pose_at)
        rendered = detector.detect(Frame(0.0, 0, renderer.render(0.0, pose_at)), None)
        for way, markers in enumerate((rendered, corners.detect(0.0, pose_at))):
            hits[way] += len(markers)
            errors[way] += [marker.corners - truth[marker.marker_id] for marker in markers]
    rate = np.array(hits) / (4.0 * count)
    rms = [np.sqrt(np.mean(np.square(item))) for item in errors]
    assert abs(rate[0] - rate[1]) <= rate_bound, f"found by detector and model: {rate}"
    assert 0.5 < rms[1] / rms[0] < 2.0, f"corner RMS of detector and model: {rms} px"


def test_benchmark_corner_camera(benchmark: BenchmarkFixture) -> None:
    camera = CornerCamera(SCENE, PINHOLE, 0.004, 1)
    assert ids(benchmark(camera.detect, 0.0, HEAD_ON)) == [0, 1, 2, 3]
