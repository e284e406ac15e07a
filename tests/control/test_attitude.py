import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lag_plant import lemniscate

from flightapp.config import Config
from flightapp.control.attitude import correction, feedforward, limited, thrust_turn
from flightapp.control.parameters import parameters_of, unpacked
from flightapp.control.vectors import axes
from flightapp.frames import GRAVITY, quat_from_euler, quat_from_rotvec, quat_multiply, quat_to_matrix

P = parameters_of(Config())._replace(rate_lead=0.0)
TILT = np.radians(Config().control.tilt_max_deg)
G = np.array([0.0, 0.0, GRAVITY])
numbers = st.floats(-100.0, 100.0)


def wanted_axes(trajectory, t):
    """Thrust axis and heading axis of a drag-free vehicle, straight from their definitions."""
    s = trajectory.sample(t)
    force = s.acceleration + G
    z = force / np.linalg.norm(force)
    x = np.cross([-np.sin(s.yaw), np.cos(s.yaw), 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(z, x), z), axis=1)


def test_the_array_holds_the_numbers_in_order():
    assert unpacked(np.array(P)) == P


@pytest.mark.parametrize("t", [1.0, 2.3, 3.1, 4.2])
def test_feedforward_rates_turn_the_wanted_attitude_as_the_trajectory_does(t):
    trajectory, h = lemniscate(7.0), 1e-5
    s = trajectory.sample(t)
    force = tuple(s.acceleration + G)
    R = wanted_axes(trajectory, t)
    turn, bend = thrust_turn(tuple(R[:, 2]), force, tuple(s.jerk), tuple(s.snap))
    omega, x, weight = feedforward(P, tuple(R[:, 2]), turn, bend, float(s.yaw), float(s.yaw_rate))
    rate = (wanted_axes(trajectory, t + h) - wanted_axes(trajectory, t - h)) / (2.0 * h)
    spin = rate @ R.T
    assert weight == 1.0
    assert x == pytest.approx(R[:, 0])
    assert omega == pytest.approx((spin[2, 1], spin[0, 2], spin[1, 0]), abs=1e-6)


def test_the_second_derivative_of_the_thrust_axis():
    trajectory, t, h = lemniscate(7.0), 2.3, 1e-3
    s = trajectory.sample(t)
    force = tuple(s.acceleration + G)
    before, now, after = (wanted_axes(trajectory, t + d)[:, 2] for d in (-h, 0.0, h))
    _, bend = thrust_turn(tuple(now), force, tuple(s.jerk), tuple(s.snap))
    assert bend == pytest.approx((after - 2.0 * now + before) / h**2, abs=1e-3)


@given(st.tuples(numbers, numbers, numbers))
def test_thrust_and_tilt_stay_within_their_limits(force):
    (x, y, z), share = limited(P, force, P.thrust_min)
    assert np.linalg.norm((x, y, z)) <= P.thrust_max * (1.0 + 1e-9)
    assert np.arctan2(np.hypot(x, y), z) <= TILT + 1e-6
    assert 0.0 <= share <= 1.0


def test_height_is_kept_at_the_expense_of_the_rest():
    (x, _, z), _ = limited(P, (100.0, 0.0, 20.0), P.thrust_min)
    assert z == 20.0
    assert np.hypot(x, z) == pytest.approx(P.thrust_max)


@given(st.tuples(numbers, numbers, numbers))
def test_beyond_a_right_angle_the_thrust_may_point_down_as_far_as_allowed(force):
    loose = P._replace(tilt_cotangent=1.0 / np.tan(np.radians(120.0)))
    (x, y, z), _ = limited(loose, force, loose.thrust_min)
    assert np.linalg.norm((x, y, z)) <= P.thrust_max * (1.0 + 1e-9)
    assert z >= np.hypot(x, y) * loose.tilt_cotangent - 1e-9


@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-3.1, 3.1), st.floats(-3.1, 3.1), st.floats(-3.0, 3.0))
def test_the_correction_reaches_the_wanted_attitude(roll, pitch, yaw, turn, lean):
    body = quat_multiply(quat_from_euler(lean, 0.0, turn), quat_from_euler(roll, pitch, yaw))
    goal = quat_to_matrix(quat_from_euler(0.2, -0.3, yaw))
    for _ in range(400):
        rates = correction(P, axes(tuple(body)), tuple(goal[:, 2]), tuple(goal[:, 0]), 1.0)
        body = quat_multiply(body, quat_from_rotvec(0.01 * np.array(rates)))
    assert quat_to_matrix(body) == pytest.approx(goal, abs=0.02)


def test_a_tilt_error_alone_asks_for_no_yaw_and_goes_the_short_way():
    body = axes(tuple(quat_from_euler(0.4, 0.0, 0.0)))
    level = np.eye(3)
    roll, pitch, yaw = correction(P, body, tuple(level[:, 2]), tuple(level[:, 0]), 1.0)
    assert roll == pytest.approx(-P.attitude_gain * 2.0 * np.sin(0.2))
    assert (pitch, yaw) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_upside_down_it_rolls():
    roll, pitch, yaw = correction(P, axes((0.0, 1.0, 0.0, 0.0)), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), 1.0)
    assert roll == pytest.approx(2.0 * P.attitude_gain)
    assert (pitch, yaw) == (0.0, 0.0)


def test_yaw_fades_where_the_heading_is_not_defined():
    still = (0.0, 0.0, 0.0)
    weights = []
    for roll in np.radians([0.0, 50.0, 70.0, 85.0, 90.0]):
        z = tuple(quat_to_matrix(quat_from_euler(roll, 0.0, 0.0))[:, 2])
        omega, _, weight = feedforward(P, z, still, still, 0.0, 1.0)
        assert np.linalg.norm(omega) < 2.0
        weights.append(weight)
    assert weights[:2] == [1.0, 1.0]
    assert weights == sorted(weights, reverse=True)
    assert weights[-2:] == [0.0, 0.0]
