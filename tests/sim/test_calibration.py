"""The camera that films is not quite the one that the application is told."""

import numpy as np
import pytest

from flightapp.config import Config
from sim import calibration as left
from sim.calibration import true_camera

TOLD = Config().camera.model()


def test_without_errors_the_camera_is_the_one_that_is_told():
    true, after = true_camera(TOLD, 0.0, 5)
    for name in ("focal", "distortion", "R_bc", "p_bc"):
        np.testing.assert_array_equal(getattr(true, name), getattr(TOLD, name))
    assert after == 0.0


def test_a_flights_camera_is_the_same_again_and_another_flights_is_not():
    one, again, other = (true_camera(TOLD, 1.0, seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.R_bc, again.R_bc)
    assert not np.array_equal(one.R_bc, other.R_bc)
    np.testing.assert_allclose(one.R_bc @ one.R_bc.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_errors_are_of_the_size_that_is_said(times):
    cameras = [true_camera(TOLD, times, seed) for seed in range(600)]
    turns = [np.trace(true.R_bc @ TOLD.R_bc.T) for true, _ in cameras]
    angles = np.sqrt(np.maximum(3.0 - np.array(turns), 0.0))
    spread = {
        left.FOCAL: [true.focal[0] / TOLD.focal[0] - 1.0 for true, _ in cameras],
        left.CENTRE: [true.focal[2:] - TOLD.focal[2:] for true, _ in cameras],
        left.PLACE: [true.p_bc - TOLD.p_bc for true, _ in cameras],
        left.SYNC: [after for _, after in cameras],
        left.TURN * np.sqrt(3.0): angles,
    }
    for sigma, errors in spread.items():
        assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(times * sigma, rel=0.1)


def test_what_is_left_wrong_is_what_the_filter_expects():
    """A principal point that is off looks as if the mount were turned; distortion, as another distance."""
    expected = Config().mapping
    turned = np.hypot(left.TURN, left.CENTRE / TOLD.focal[0])
    assert expected.attitude_error == pytest.approx(turned, rel=0.05)
    assert expected.range_error == pytest.approx(np.hypot(left.FOCAL, left.DISTORTION), rel=0.05)
    assert expected.sync_error == pytest.approx(left.SYNC, rel=0.05)
