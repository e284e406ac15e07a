"""Gate poses from exact and from noisy corners."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from perception_cases import LENSES, PINHOLE, as_markers, config, gate_pixels, track

from flightapp.frames import Vector, quat_conjugate, quat_from_euler, quat_multiply, quat_rotate, quat_to_rotvec
from flightapp.messages import GateSighting, MarkerDetection
from flightapp.perception.camera import CameraModel
from flightapp.perception.gate_pose import GatePoseSolver
from flightapp.track import MarkerLayout

TRACK = track()
SOLVERS = {name: GatePoseSolver(config(max_distance=100.0), TRACK, camera) for name, camera in LENSES.items()}

EDGE = math.cos(math.radians(81.0))
"""Where the T265's field of view ends; beyond, its calibration means nothing."""


def angle(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit)


@st.composite
def gate_poses(draw: st.DrawFn, camera: CameraModel, tilt: float) -> tuple[Vector, Vector]:
    """Gate poses in the body frame whose centre is in the field of view, seen obliquely by at least ``tilt``."""
    pixel = np.array([[draw(st.floats(60.0, camera.width - 60.0)), draw(st.floats(60.0, camera.height - 60.0))]])
    ray = camera.R_bc @ camera.bearings(pixel)[0]
    position = draw(st.floats(1.5, 12.0)) * ray
    heading = math.atan2(ray[1], ray[0])
    side = draw(st.sampled_from((-1.0, 1.0)))
    orientation = quat_from_euler(draw(angle(0.4)), draw(angle(0.4)), heading + side * draw(st.floats(tilt, 1.0)))
    facing = quat_rotate(orientation, np.array([1.0, 0.0, 0.0])) @ ray
    assume(0.25 < facing < math.cos(tilt))
    return position + camera.p_bc, orientation


def errors(sighting: GateSighting, position: Vector, orientation: Vector) -> Vector:
    """(6,) error of a sighting in the axes of its covariance."""
    turn = quat_multiply(quat_conjugate(orientation), sighting.orientation)
    return np.concatenate((sighting.position - position, quat_to_rotvec(turn)))


@pytest.mark.parametrize("lens", LENSES)
@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_exact_corners_give_the_exact_pose(lens: str, data: st.DataObject) -> None:
    camera = LENSES[lens]
    position, orientation = data.draw(gate_poses(camera, tilt=0.25))
    visible = data.draw(st.lists(st.integers(0, 3), min_size=1, max_size=4, unique=True))
    pixels = gate_pixels(camera, TRACK.gate, position, orientation)[visible]
    assume(camera.contains(pixels.reshape(-1, 2)).all() and camera.bearings(pixels.reshape(-1, 2))[:, 2].min() > EDGE)
    markers = [MarkerDetection(n, corners) for n, corners in zip(visible, pixels, strict=True)]
    (sighting,) = SOLVERS[lens].solve(1.5, markers)
    assert np.abs(errors(sighting, position, orientation)).max() < 1e-6
    assert (sighting.stamp, sighting.gate_id, sighting.markers) == (1.5, 10, len(visible))
    assert sighting.reprojection < 1e-6
    assert np.linalg.eigvalsh(sighting.covariance)[0] > 0.0


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("visible", [(0, 1, 2, 3), (0, 2), (1,)])
def test_errors_are_as_large_as_the_covariance_says(lens: str, visible: tuple[int, ...]) -> None:
    """The normalised squared error of 6 unknowns averages 6; over 400 draws to within ±0.6 (3.5 sigma)."""
    rng = np.random.default_rng(7)
    camera, normalised = LENSES[lens], []
    solver = GatePoseSolver(config(corner_noise=0.2), TRACK, camera)
    while len(normalised) < 400:
        position = camera.p_bc + np.array([rng.uniform(1.8, 3.2), rng.uniform(-0.5, 0.5), rng.uniform(-0.2, 0.5)])
        side = rng.choice((-1.0, 1.0))
        orientation = quat_from_euler(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), side * rng.uniform(0.5, 0.9))
        pixels = gate_pixels(camera, TRACK.gate, position, orientation)[list(visible)]
        if not camera.contains(pixels.reshape(-1, 2)).all():
            continue
        noisy = pixels + 0.2 * rng.standard_normal(pixels.shape)
        (sighting,) = solver.solve(0.0, [MarkerDetection(n, quad) for n, quad in zip(visible, noisy, strict=True)])
        error = errors(sighting, position, orientation)
        normalised.append(error @ np.linalg.solve(sighting.covariance, error))
    assert np.mean(normalised) == pytest.approx(6.0, abs=0.6)


@pytest.mark.parametrize(("told", "expected"), [(0.05, 0.05), (0.4, 0.4), (math.nan, 0.2), (0.0, 0.2)])
def test_what_a_detector_tells_of_its_corners_is_believed(told: float, expected: float) -> None:
    """By exact corners, of which residuals tell little; without a word, `detection.corner_noise` counts."""
    exact = gate_pixels(PINHOLE, TRACK.gate, np.array([3.0, 0.2, 0.4]), quat_from_euler(0.1, 0.0, 0.6))
    alone = GatePoseSolver(config(corner_noise=expected), TRACK, PINHOLE)
    solver = GatePoseSolver(config(corner_noise=0.2), TRACK, PINHOLE)
    (as_told,) = solver.solve(0.0, [replace(marker, noise=told) for marker in as_markers(exact)])
    (as_configured,) = alone.solve(0.0, as_markers(exact))
    assert np.allclose(as_told.covariance, as_configured.covariance, rtol=1e-6)


def test_a_small_marker_keeps_both_poses_and_one_is_right() -> None:
    rng = np.random.default_rng(3)
    solver = GatePoseSolver(config(), track(layout=MarkerLayout.TOP), PINHOLE)
    shape = track(layout=MarkerLayout.TOP).gate
    position, orientation = np.array([6.0, 0.3, 0.5]), quat_from_euler(0.0, 0.0, 0.5)
    ambiguous, wrong_first, lost = 0, 0, 0
    for _ in range(100):
        exact = gate_pixels(PINHOLE, shape, position, orientation)
        (sighting,) = solver.solve(0.0, as_markers(exact + 0.3 * rng.standard_normal(exact.shape)))
        candidates = [sighting.orientation] + ([sighting.alternative[1]] if sighting.alternative else [])
        yaws = [quat_to_rotvec(q)[2] for q in candidates]
        ambiguous += len(yaws) == 2
        wrong_first += yaws[0] < 0.0
        lost += max(yaws) < 0.0
    assert ambiguous > 80
    assert 5 < wrong_first < 60
    assert lost <= 1


def test_a_near_oblique_gate_has_one_pose() -> None:
    orientation = quat_from_euler(0.1, 0.0, 0.6)
    (sighting,) = SOLVERS["pinhole"].solve(
        0.0, as_markers(gate_pixels(PINHOLE, TRACK.gate, np.array([3.0, 0.2, 0.4]), orientation))
    )
    assert sighting.alternative is None


@pytest.mark.parametrize("bad", range(4))
def test_one_wrong_marker_of_four_is_left_out(bad: int) -> None:
    position, orientation = np.array([3.5, 0.2, 0.6]), quat_from_euler(0.1, -0.1, 0.4)
    pixels = gate_pixels(PINHOLE, TRACK.gate, position, orientation)
    pixels[bad, 1] += (9.0, -7.0)
    (sighting,) = SOLVERS["pinhole"].solve(0.0, as_markers(pixels))
    assert sighting.markers == 3
    assert np.abs(errors(sighting, position, orientation)).max() < 1e-6


def test_two_markers_that_disagree_are_refused() -> None:
    pixels = gate_pixels(PINHOLE, TRACK.gate, np.array([3.5, 0.2, 0.6]), quat_from_euler(0.0, 0.0, 0.4))[:2]
    pixels[1] += (40.0, 25.0)
    assert SOLVERS["pinhole"].solve(0.0, as_markers(pixels)) == ()


def test_gates_too_far_away_are_refused() -> None:
    solver = GatePoseSolver(config(max_distance=5.0), TRACK, PINHOLE)
    for distance, count in ((4.8, 1), (5.4, 0)):
        pixels = gate_pixels(PINHOLE, TRACK.gate, np.array([distance, 0.0, 0.3]), quat_from_euler(0.0, 0.0, 0.4))
        assert len(solver.solve(0.0, as_markers(pixels))) == count


def test_a_gate_whose_markers_face_away_is_refused() -> None:
    orientation = quat_from_euler(0.0, 0.0, math.pi - 0.4)
    pixels = gate_pixels(PINHOLE, TRACK.gate, np.array([3.0, 0.2, 0.4]), orientation)
    assert SOLVERS["pinhole"].solve(0.0, as_markers(pixels)) == ()


def test_useless_markers_are_ignored() -> None:
    position, orientation = np.array([3.0, 0.2, 0.4]), quat_from_euler(0.0, 0.0, 0.4)
    good = as_markers(gate_pixels(PINHOLE, TRACK.gate, position, orientation))
    unknown = MarkerDetection(49, good[0].corners)
    broken = MarkerDetection(3, np.full((4, 2), np.nan))
    point = MarkerDetection(3, np.full((4, 2), 100.0))
    (sighting,) = SOLVERS["pinhole"].solve(0.0, [unknown, broken, *good[:3]])
    assert sighting.markers == 3
    assert SOLVERS["pinhole"].solve(0.0, [unknown]) == ()
    assert SOLVERS["pinhole"].solve(0.0, [point]) == ()
    assert SOLVERS["pinhole"].solve(0.0, []) == ()


@pytest.mark.parametrize("lens", LENSES)
@settings(deadline=None, max_examples=150)
@given(
    corners=st.lists(st.floats(-1e4, 1e4) | st.integers(0, 3).map(float), min_size=32, max_size=32),
    count=st.integers(1, 4),
)
def test_whatever_the_corners_a_sighting_is_finite(lens: str, corners: list[float], count: int) -> None:
    solver = GatePoseSolver(config(max_reprojection=50.0, max_distance=100.0), TRACK, LENSES[lens])
    for sighting in solver.solve(0.0, as_markers(np.array(corners).reshape(4, 4, 2)[:count])):
        assert np.isfinite(sighting.position).all()
        assert np.isfinite(sighting.covariance).all()
        assert np.linalg.norm(sighting.orientation) == pytest.approx(1.0)
        assert sighting.reprojection <= 50.0


def test_each_gate_has_its_own_sighting() -> None:
    two = track(gates=2)
    poses = [(np.array([3.0, -0.8, 0.4]), 0.5), (np.array([7.0, 1.5, 0.2]), -0.4)]
    markers = []
    for n, (position, yaw) in enumerate(poses):
        pixels = gate_pixels(PINHOLE, two.gate, position, quat_from_euler(0.0, 0.0, yaw))
        markers += [MarkerDetection(4 * n + k, corners) for k, corners in enumerate(pixels)]
    sightings = GatePoseSolver(config(), two, PINHOLE).solve(0.0, markers[::-1])
    assert [sighting.gate_id for sighting in sightings] == [10, 11]
    for sighting, (position, yaw) in zip(sightings, poses, strict=True):
        assert np.abs(errors(sighting, position, quat_from_euler(0.0, 0.0, yaw))).max() < 1e-6
        ahead = quat_rotate(sighting.orientation, np.array([1.0, 0.0, 0.0]))
        assert ahead[0] > 0.0
