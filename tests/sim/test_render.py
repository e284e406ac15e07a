import math

import cv2
import numpy as np
import pytest
from camera_cases import FISHEYE, LEVEL, PINHOLE, make_track, moving, one_gate, projected
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pytest_benchmark.fixture import BenchmarkFixture

from flightapp.config import Config
from flightapp.frames import quat_from_euler
from flightapp.messages import Frame
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.camera import CameraModel
from flightapp.track import Cylinder, Gate, Start, Track
from sim.panel import Board, Panel, leg_mean
from sim.render import READ_NOISE, SHOT_NOISE, Renderer, camera_poses
from sim.scene import Scene

EMPTY_TRACK = Track(name="empty", start=Start(position=(0.0, 0.0, 1.0)), waypoints=((1.0, 0.0, 1.0),))


def found(image: NDArray[np.uint8], track: Track) -> dict[int, NDArray[np.float64]]:
    markers = ArucoDetector(Config(), track).detect(Frame(0.0, 0, image), None)
    return {marker.marker_id: marker.corners for marker in markers}


def found_by_opencv(image: NDArray[np.uint8]) -> dict[int, NDArray[np.float32]]:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 3
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    corners, ids, _ = detector.detectMarkers(image)
    return {int(i): c.reshape(4, 2) for i, c in zip(np.ravel(ids), corners, strict=True)}


@pytest.mark.parametrize(("camera", "bound"), [(PINHOLE, 0.1), (FISHEYE, 0.3)], ids=["pinhole", "fisheye"])
def test_corners_are_found_where_the_camera_model_projects_them(camera: CameraModel, bound: float) -> None:
    # The detector fits straight lines; what the fisheye bends of a side of 27 px makes its wider bound.
    track = one_gate()
    scene = Scene.from_track(track)
    renderer = Renderer(scene, camera, 0.004, 1)
    errors = []
    for i in range(6):
        pose_at = moving((0.9 + 0.05 * i, 0.3 - 0.1 * i, 1.4), quat_from_euler(0.15, 0.1, -0.1))
        truth, markers = projected(scene, camera, pose_at), found(renderer.render(0.0, pose_at), track)
        assert sorted(markers) == [0, 1, 2, 3]
        errors += [markers[marker] - truth[marker] for marker in range(4)]
    assert np.linalg.norm(errors, axis=-1).mean() < bound
    assert np.abs(np.mean(errors, axis=(0, 1))).max() < 0.03


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def test_opencv_alone_finds_the_same_corners(camera: CameraModel) -> None:
    # cornerSubPix itself is 0.2 to 0.3 px off at a corner that is dark on one side only, inwards at all four.
    scene = Scene.from_track(one_gate())
    renderer = Renderer(scene, camera, 0.004, 1)
    errors = []
    for i in range(6):
        pose_at = moving((1.5, 0.3 - 0.1 * i, 1.4), quat_from_euler(0.05 * i, 0.1, -0.1))
        truth, markers = projected(scene, camera, pose_at), found_by_opencv(renderer.render(0.0, pose_at))
        errors += [markers[marker] - truth[marker] for marker in markers]
    assert len(errors) >= 20
    assert np.abs(np.median(errors, axis=(0, 1))).max() < 0.1


def test_markers_of_15_px_are_readable() -> None:
    track = one_gate((7.0, 0.0, 1.5))
    renderer = Renderer(Scene.from_track(track), PINHOLE, 0.004, 1)
    hits = sum(len(found(renderer.render(0.0, moving((0.6, 0.003 * i, 1.5))), track)) for i in range(10))
    assert hits >= 38


def edge_width(exposure: float, yaw_rate: float) -> float:
    """px between 10 and 90 % of the gate's left edge, averaged over rows."""
    renderer = Renderer(Scene.from_track(one_gate()), PINHOLE, exposure, 3)
    pose_at = moving((1.0, 0.0, 1.5), rates=(0.0, 0.0, yaw_rate))
    profile = np.mean([renderer.render(0.0, pose_at)[215:225] for _ in range(8)], axis=(0, 1))[180:240]
    outside, inside = profile[:8].mean(), profile[-12:].mean()
    level = (profile - outside) / (inside - outside)
    low, high = (np.interp(share, np.maximum.accumulate(level), np.arange(60)) for share in (0.1, 0.9))
    return float(high - low)


def test_blur_grows_with_exposure_as_the_motion_says() -> None:
    still = edge_width(0.004, 0.0)
    assert 1.0 < still < 2.6
    for exposure in (0.012, 0.024):
        x = (202.5 - PINHOLE.focal[2]) / PINHOLE.focal[0]
        path = 2.0 * exposure * PINHOLE.focal[0] * (1.0 + x * x)
        assert edge_width(exposure, 2.0) == pytest.approx(0.8 * path, abs=1.2)


def test_a_gate_in_front_hides_a_marker() -> None:
    far = Gate(id=0, position=(6.0, 0.0, 1.5), yaw_deg=0.0, markers=(0, 1, 2, 3))
    near = Gate(id=1, position=(2.0, 0.8, 1.5), yaw_deg=0.0, markers=(4, 5, 6, 7))
    alone, both = make_track(far), make_track(near, far)
    pose_at = moving((0.0, 0.0, 1.5))
    seen = [
        set(found(Renderer(Scene.from_track(track), PINHOLE, 0.004, 1).render(0.0, pose_at), both))
        for track in (alone, both)
    ]
    assert seen[0] == {0, 1, 2, 3}
    assert seen[1] & seen[0] == {0, 3}


def test_pillars_hide_what_is_behind_them_and_nothing_else() -> None:
    far = Gate(id=0, position=(6.0, 0.0, 1.5), yaw_deg=0.0, markers=(0, 1, 2, 3))
    pillar = Cylinder(name="pillar", base=(4.0, 0.7, 0.0), radius=0.25, height=3.0)
    bare, track = make_track(far), make_track(far, obstacles=(pillar,))
    for y, expected in ((0.0, {1, 2}), (-2.0, {0, 1, 2, 3})):
        pose_at = moving((0.0, y, 1.5))
        image, free = (Renderer(Scene.from_track(t), PINHOLE, 0.004, 1).render(0.0, pose_at) for t in (track, bare))
        assert set(found(image, track)) == expected
        changed = np.abs(image.astype(int) - free).max(axis=0) > 40
        bearing, half = math.atan2(y - 0.7, 4.0), math.asin(0.25 / math.hypot(4.0, y - 0.7))
        left, right = (319.5 + 320.0 * math.tan(bearing + side * half) for side in (-1.0, 1.0))
        assert np.flatnonzero(changed).min() == pytest.approx(left, abs=8.0)
        assert np.flatnonzero(changed).max() == pytest.approx(right, abs=8.0)


def test_the_back_shows_no_markers() -> None:
    pose_at = moving((6.5, 0.0, 1.5), quat_from_euler(0.0, np.radians(10.0), np.pi))
    track = one_gate()
    image = Renderer(Scene.from_track(track), PINHOLE, 0.004, 1).render(0.0, pose_at)
    assert not found(image, track)
    assert 40 < image[125:135, 310:330].mean() < 90


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def test_what_is_behind_the_camera_is_not_seen(camera: CameraModel) -> None:
    pose_at = moving((8.0, 0.0, 1.5), velocity=(5.0, 0.0, 0.0))
    with_gate = Renderer(Scene.from_track(one_gate((4.0, 0.0, 1.5))), camera, 0.004, 1).render(0.0, pose_at)
    ground = Renderer(Scene.from_track(one_gate((-400.0, 0.0, 1.5))), camera, 0.004, 1).render(0.0, pose_at)
    np.testing.assert_array_equal(with_gate, ground)


def test_the_fisheye_sees_beyond_90_degrees() -> None:
    scene = Scene.from_track(one_gate((0.28, 1.0, 1.5), 90.0))
    pose_at = moving((0.0, 0.0, 1.5))
    R_wc, centres = camera_poses(FISHEYE, pose_at, np.zeros(1))
    shown = scene.quads.origin[0] + np.array([-0.35, 0.0, 0.9])
    ray = (shown - centres[0]) @ R_wc[0]
    u, v = FISHEYE.project(ray[None])[0]
    image = Renderer(scene, FISHEYE, 0.004, 1).render(0.0, pose_at)
    sky = Renderer(Scene.from_track(EMPTY_TRACK), FISHEYE, 0.004, 1).render(0.0, pose_at)
    patch = np.s_[round(v) - 3 : round(v) + 4, round(u) - 3 : round(u) + 4]
    assert ray[2] < 0.0
    assert FISHEYE.contains(np.array([[u, v]]), 4.0).all()
    assert image[patch].mean() < sky[patch].mean() - 40


def test_same_seed_same_bytes() -> None:
    scene = Scene.from_track(one_gate())
    pose_at = moving((0.0, 0.2, 1.5), velocity=(5.0, 1.0, 0.0), rates=(0.5, 1.0, 2.0))
    first, second, other = (Renderer(scene, PINHOLE, 0.004, seed) for seed in (5, 5, 6))
    for stamp in (0.0, 0.033):
        image = first.render(stamp, pose_at)
        np.testing.assert_array_equal(image, second.render(stamp, pose_at))
        assert (image != other.render(stamp, pose_at)).mean() > 0.5


def test_noise_is_shot_and_read_noise() -> None:
    renderer = Renderer(Scene.from_track(EMPTY_TRACK), PINHOLE, 0.004, 2)
    stack = np.array([renderer.render(0.0, moving((0.0, 0.0, 1.5))) for _ in range(40)], float)
    for patch in (np.s_[:, 150:220, 220:420], np.s_[:, 430:, 220:420]):
        expected = np.sqrt(READ_NOISE**2 + SHOT_NOISE * stack[patch].mean() + 1.0 / 12.0)
        assert stack[patch].std(axis=0, ddof=1).mean() == pytest.approx(expected, rel=0.03)


@settings(max_examples=60, deadline=None)
@given(
    s=st.floats(-1.3, 1.3),
    t=st.floats(-1.3, 1.3),
    ds=st.floats(-0.2, 0.2),
    ws=st.floats(0.01, 0.3),
    wt=st.floats(0.01, 0.3),
)
def test_area_means_agree_with_dense_sampling(s: float, t: float, ds: float, ws: float, wt: float) -> None:
    black = np.zeros((1, 7, 7))
    cells = np.random.default_rng(4).random((6, 6)) < 0.5
    black[0, 1:, 1:] = cells.cumsum(0).cumsum(1)
    panel = Panel(-1.1, 1.1, -0.9, 1.1, -0.7, 0.7, -0.7, 0.7, 90.0)
    board = Board(0.9, 0.9, 0.3, 0.2, 30.0, 200.0)
    n = 1 + int(abs(ds) / ws / 0.8)
    grid = (np.arange(400) + 0.5) / 400 - 0.5
    covers, lights = [], []
    for i in range(n):
        x, y = np.meshgrid(s + (i + 0.5) / n * ds + ws * grid, t + wt * grid)
        on = (np.abs(x) < 1.1) & (y > -0.9) & (y < 1.1) & ~((np.abs(x) < 0.7) & (np.abs(y) < 0.7))
        level = np.where((np.abs(x - 0.9) < 0.2) & (np.abs(y - 0.9) < 0.2), 200.0, 90.0)
        column, row = np.floor((x - 0.75) / 0.05).astype(int), np.floor((y - 0.75) / 0.05).astype(int)
        inside = (column >= 0) & (column < 6) & (row >= 0) & (row < 6)
        level[inside] = np.where(cells[row[inside], column[inside]], 30.0, 200.0)
        covers.append(on.mean())
        lights.append((on * level).mean())
    cover, light = leg_mean(panel, board, black, 0, s, t, ds, 0.0, ws, wt)
    assert cover == pytest.approx(np.mean(covers), abs=0.01)
    assert light == pytest.approx(np.mean(lights), abs=2.0)


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def test_benchmark_renderer(benchmark: BenchmarkFixture, camera: CameraModel) -> None:
    renderer = Renderer(Scene.from_track(one_gate()), camera, 0.004, 1)
    pose_at = moving((0.5, 0.2, 1.5), LEVEL, (5.0, 0.0, 0.0), (0.0, 0.5, 1.0))
    image = benchmark(renderer.render, 0.0, pose_at)
    assert image.shape == (camera.height, camera.width)
