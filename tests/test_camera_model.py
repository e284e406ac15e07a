import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.frames import Vector, camera_mount
from flightapp.perception.camera import CameraModel, Lens

FOCAL = np.array((320.0, 322.0, 319.5, 239.5))
BROWN = np.array((-0.28, 0.07, 0.0008, -0.0005))
KANNALA = np.array((-0.008, 0.041, -0.038, 0.0065))
"""Of a T265's fisheye, whose image goes beyond 90° from the axis."""


def camera(lens: Lens, distortion: Vector, focal: Vector = FOCAL) -> CameraModel:
    return CameraModel(lens, 640, 480, focal, distortion, camera_mount(0.2), np.array((0.1, 0.0, 0.0)))


def rays(angles: Vector, turns: Vector) -> Vector:
    """Unit rays (n, 3) at ``angles`` from the axis."""
    return np.stack((np.sin(angles) * np.cos(turns), np.sin(angles) * np.sin(turns), np.cos(angles)), axis=1)


PINHOLE = camera(Lens.PINHOLE, BROWN)
FISHEYE = camera(Lens.FISHEYE, KANNALA, np.array((285.0, 286.0, 420.0, 400.0)))
turns = st.floats(-math.pi, math.pi)
distances = st.floats(0.3, 30.0)


@given(st.floats(0.0, 0.6), turns, distances)
def test_pinhole_bearing_leads_back_along_the_ray(angle: float, turn: float, distance: float) -> None:
    ray = rays(np.array((angle,)), np.array((turn,)))
    np.testing.assert_allclose(PINHOLE.bearings(PINHOLE.project(distance * ray)), ray, atol=1e-8)


@given(st.floats(0.0, 1.8), turns, distances)
def test_fisheye_bearing_leads_back_even_beyond_a_right_angle(angle: float, turn: float, distance: float) -> None:
    ray = rays(np.array((angle,)), np.array((turn,)))
    np.testing.assert_allclose(FISHEYE.bearings(FISHEYE.project(distance * ray)), ray, atol=1e-8)


@given(st.floats(0.0, 639.0), st.floats(0.0, 479.0))
def test_pixels_of_the_image_lead_back(u: float, v: float) -> None:
    pixel = np.array(((u, v),))
    for model in (camera(Lens.PINHOLE, 0.5 * BROWN), FISHEYE):
        bearing = model.bearings(pixel)
        assert np.linalg.norm(bearing) == pytest.approx(1.0)
        np.testing.assert_allclose(model.project(bearing), pixel, atol=1e-5)


def test_pinhole_agrees_with_opencv() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform((-2.0, -1.5, 2.5), (2.0, 1.5, 8.0), (200, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), PINHOLE.matrix, BROWN)
    np.testing.assert_allclose(PINHOLE.project(points), expected[:, 0], atol=1e-9)


def test_pinhole_bearings_agree_with_opencv() -> None:
    rng = np.random.default_rng(2)
    pixels = rng.uniform((100.0, 80.0), (540.0, 400.0), (200, 2))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
    expected = cv2.undistortPoints(pixels[:, None], PINHOLE.matrix, BROWN, criteria=criteria)[:, 0]
    bearings = PINHOLE.bearings(pixels)
    np.testing.assert_allclose(bearings[:, :2] / bearings[:, 2:], expected, atol=1e-7)


def test_fisheye_agrees_with_opencv_in_front() -> None:
    rng = np.random.default_rng(3)
    points = 4.0 * rays(rng.uniform(0.01, 1.5, 200), rng.uniform(-math.pi, math.pi, 200))
    expected, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), FISHEYE.matrix, KANNALA)
    np.testing.assert_allclose(FISHEYE.project(points), expected[:, 0], atol=1e-8)


def test_fisheye_bearings_agree_with_opencv_in_front() -> None:
    rng = np.random.default_rng(4)
    pixels = FISHEYE.project(rays(rng.uniform(0.01, 1.3, 200), rng.uniform(-math.pi, math.pi, 200)))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
    expected = cv2.fisheye.undistortPoints(pixels[:, None], FISHEYE.matrix, KANNALA, criteria=criteria)[:, 0]
    bearings = FISHEYE.bearings(pixels)
    np.testing.assert_allclose(bearings[:, :2] / bearings[:, 2:], expected, rtol=1e-6, atol=1e-7)


def test_fisheye_image_grows_steadily_across_the_right_angle() -> None:
    angles = np.linspace(0.0, 1.8, 181)
    pixels = FISHEYE.project(rays(angles, np.zeros_like(angles)))
    assert np.all(np.diff(pixels[:, 0]) > 0.0)
    assert np.max(np.abs(np.diff(pixels[:, 0], 2))) < 0.5


def test_axis_meets_the_principal_point() -> None:
    for model in (PINHOLE, FISHEYE):
        np.testing.assert_allclose(model.project(np.array(((0.0, 0.0, 3.0),)))[0], model.focal[2:])
        np.testing.assert_allclose(model.bearings(model.focal[None, 2:])[0], (0.0, 0.0, 1.0))


def test_pinhole_sees_nothing_behind_it() -> None:
    assert np.isnan(PINHOLE.project(np.array(((0.1, 0.2, -1.0), (0.1, 0.2, 0.0))))).all()


def test_fisheye_sees_what_is_beside_and_a_little_behind_it() -> None:
    beside, behind = FISHEYE.project(np.array(((1.0, 0.0, 0.0), (1.0, 0.0, -0.1))))
    assert np.isfinite(beside).all()
    assert behind[0] > beside[0]


def test_up_in_the_world_is_up_in_the_image() -> None:
    points = (np.array(((5.0, 0.0, 0.0), (5.0, 0.0, 0.5), (5.0, 0.5, 0.0))) - PINHOLE.p_bc) @ PINHOLE.R_bc
    level, above, left = PINHOLE.project(points)
    assert above[1] < level[1]
    assert left[0] < level[0]
    assert level[1] > PINHOLE.focal[3]  # it looks up, so the horizon lies low


def test_contains_keeps_its_margin() -> None:
    pixels = np.array(((0.0, 0.0), (639.0, 479.0), (639.5, 10.0), (10.0, -0.1), (5.0, 5.0), (np.nan, 3.0)))
    np.testing.assert_array_equal(PINHOLE.contains(pixels), (True, True, False, False, True, False))
    np.testing.assert_array_equal(PINHOLE.contains(pixels, 5.0), (False, False, False, False, True, False))


def test_only_the_fisheye_is_one() -> None:
    assert FISHEYE.fisheye
    assert not PINHOLE.fisheye
