"""The filter's derivatives against differences of the functions that they are derivatives of."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.config import Config
from flightapp.estimation import process as at
from flightapp.estimation.correction import correct, correct_despite, use_pose
from flightapp.estimation.process import CORE, GATE, attitude, predict
from flightapp.estimation.settings import process_settings
from flightapp.estimation.sighting import SEEN, _derivative, _innovation, place, sighted
from flightapp.frames import GRAVITY, quat_from_euler, quat_from_rotvec, quat_multiply, quat_to_rotvec

SIZE = CORE + 2 * GATE
SETTINGS = process_settings(Config().estimation, Config().mapping)
QUIET = SETTINGS.copy()
for noise in (at.ACCELEROMETER, at.MANOEUVRE, at.BIAS_WALK, at.WALK, at.WALK_AT_REST, at.YAW_WALK, at.YAW_AT_REST):
    QUIET[noise] = 0.0
for noise in (at.SLIP_ACROSS, at.CLIMB_SIZE, at.TILT_SIZE):
    QUIET[noise] = 0.0
STEP = 1e-6


def a_row(rng, stamp, felt=True):
    row = np.zeros(at.ROW)
    row[at.STAMP], row[at.KIND], row[at.FELT] = stamp, 1.0, float(felt)
    row[at.ODOM : at.ODOM + 3] = rng.normal(0.0, 5.0, 3)
    row[at.ATTITUDE : at.ATTITUDE + 4] = quat_from_euler(*rng.uniform(-0.8, 0.8, 2), rng.uniform(-3.0, 3.0))
    row[at.SPEED : at.SPEED + 3] = rng.normal(0.0, 4.0, 3)
    row[at.PACE] = np.linalg.norm(row[at.SPEED : at.SPEED + 3])
    row[at.RATES : at.RATES + 3] = rng.normal(0.0, 2.0, 3)
    row[at.FORCE : at.FORCE + 3] = rng.normal((0.0, 0.0, GRAVITY), 3.0)
    return row


def a_state(rng):
    x = rng.normal(0.0, 1.0, SIZE)
    x[at.VELOCITY : at.VELOCITY + 2] += 3.0
    x[at.SCALE] = rng.normal(0.0, 0.03)
    x[at.TILT : at.TILT + 2] = 0.0
    x[at.CLIMB] = rng.normal(0.0, 0.03)
    x[at.MOUNT : at.MOUNT + 3] = x[at.RANGE] = 0.0
    return x


def a_covariance(rng, size=SIZE):
    A = rng.normal(0.0, 0.1, (size, size))
    return A @ A.T + 1e-3 * np.eye(size)


def moved(x, i, amount):
    """``x`` with the error ``amount`` in state ``i``: the attitude's error is a rotation in world axes."""
    x = x.copy()
    x[i] += amount
    return x


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10_000), felt=st.booleans())
def test_the_covariance_moves_as_the_state_does(seed, felt):
    """P becomes F P Fᵀ with the F that differences of the state's own motion give."""
    rng = np.random.default_rng(seed)
    x, P = a_state(rng), a_covariance(rng)
    before, row = a_row(rng, 0.0), a_row(rng, 0.005, felt)
    F = np.empty((SIZE, SIZE))
    for i in range(SIZE):
        ends = []
        for sign in (1.0, -1.0):
            y, Q = moved(x, i, sign * STEP), np.zeros((SIZE, SIZE))
            predict(y, Q, before, row, QUIET)
            ends.append(y)
        F[:, i] = (ends[0] - ends[1]) / (2.0 * STEP)
    # Only the velocity feels the half step of the acceleration in the position, which the model leaves out.
    moved_P = P.copy()
    predict(x.copy(), moved_P, before, row, QUIET)
    F[at.POSITION : at.POSITION + 3, [at.TILT, at.TILT + 1, at.YAW, at.BIAS, at.BIAS + 1, at.BIAS + 2]] = 0.0
    np.testing.assert_allclose(moved_P, F @ P @ F.T, atol=2e-6)
    np.testing.assert_allclose(moved_P, moved_P.T, atol=1e-15)


def test_the_covariance_stays_positive_over_a_minute_of_flight():
    rng = np.random.default_rng(3)
    x, P = a_state(rng), a_covariance(rng)
    before = a_row(rng, 0.0)
    for count in range(1, 12_000):
        row = a_row(rng, 0.005 * count)
        predict(x, P, before, row, SETTINGS)
        row[at.ODOM : at.ODOM + 3] = rng.normal(0.0, 0.1, 3)
        use_pose(x, P, row, SETTINGS)
        before = row
    assert np.isfinite(P).all()
    assert np.linalg.eigvalsh(P).min() > 0.0


def test_attitude_error_is_a_rotation_in_world_axes():
    q_ob = quat_from_euler(0.3, -0.2, 1.0)
    x = np.zeros(SIZE)
    x[at.YAW] = 0.7
    for i, axis in ((at.TILT, 0), (at.TILT + 1, 1), (at.YAW, 2)):
        turned = attitude(moved(x, i, 1e-5), q_ob)
        back = attitude(x, q_ob) * (1.0, -1.0, -1.0, -1.0)
        expected = np.zeros(3)
        expected[axis] = 1e-5
        np.testing.assert_allclose(quat_to_rotvec(quat_multiply(turned, back)), expected, atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_a_sightings_derivative(seed):
    rng = np.random.default_rng(seed)
    x, row = a_state(rng), a_row(rng, 0.0)
    sighting = np.concatenate((rng.normal(0.0, 4.0, 3), quat_from_euler(0.0, 0.0, 0.4), 1e-4 * np.eye(6).ravel()))
    # The gate's own lean would mix with the tilt's error in its yaw, which the model leaves out: it is upright.
    row[at.ATTITUDE : at.ATTITUDE + 4] = quat_from_euler(0.0, 0.0, rng.uniform(-3.0, 3.0))
    errors, at_gate = np.zeros(3), CORE + GATE

    def innovation(y):
        z, R = np.empty(4), np.empty((4, 4))
        sighted(y, row, sighting, errors, z, R)
        return _innovation(y, at_gate, z)

    z, H, columns = np.empty(4), np.empty((4, SEEN)), np.empty(SEEN, np.int64)
    sighted(x, row, sighting, errors, z, np.empty((4, 4)))
    x[at_gate : at_gate + 3] = x[at.POSITION : at.POSITION + 3] + z[:3]
    _derivative(x, row, at_gate, z, H, columns)
    for k, i in enumerate(columns):
        slope = (innovation(moved(x, i, STEP)) - innovation(moved(x, i, -STEP))) / (2.0 * STEP)
        np.testing.assert_allclose(-slope, H[:, k], atol=1e-6)


def followed(P, moved):
    """``P`` after the state has ``moved``: what an error of the heading does to each vector is about its new place."""
    M = np.eye(SIZE)
    for a in (at.POSITION, at.VELOCITY, at.DRIFT, at.SLIP, CORE, CORE + GATE):
        M[a : a + 2, at.YAW] = -moved[a + 1], moved[a]
    return M @ P @ M.T


def test_a_correction_is_that_of_the_textbook():
    rng = np.random.default_rng(5)
    x, P = rng.normal(0.0, 1.0, SIZE), a_covariance(rng)
    columns, H, R = np.array((0, 7, 12)), rng.normal(0.0, 1.0, (2, 3)), np.diag((0.3, 0.1))
    full = np.zeros((2, SIZE))
    full[:, columns] = H
    nu = np.array((0.2, -0.1))
    S = full @ P @ full.T + R
    K = P @ full.T @ np.linalg.inv(S)
    expected_x, expected_P = x + K @ nu, followed(P - K @ S @ K.T, K @ nu)
    chi2 = correct(x, P, nu.copy(), H, columns, R, math.inf)
    assert chi2 == pytest.approx(float(nu @ np.linalg.inv(S) @ nu))
    expected_x[at.YAW] = math.remainder(expected_x[at.YAW], math.tau)
    np.testing.assert_allclose(x, expected_x, atol=1e-12)
    np.testing.assert_allclose(P, expected_P, atol=1e-12)


def test_a_correction_despite_a_state_keeps_that_and_knows_what_it_costs():
    """The covariance of any linear correction with that gain: (I - K H) P (I - K H)ᵀ + K R Kᵀ."""
    rng = np.random.default_rng(8)
    x, P = rng.normal(0.0, 1.0, SIZE), a_covariance(rng)
    columns, H, R = np.array((0, 7, 12)), rng.normal(0.0, 1.0, (2, 3)), np.array(((0.3, 0.1), (0.1, 0.2)))
    slope, nu, given_state = np.array((0.7, -0.4)), np.array((0.2, -0.1)), at.SCALE
    full = np.zeros((2, SIZE))
    full[:, columns] = H
    alone = P - np.outer(P[given_state], P[given_state]) / P[given_state, given_state]
    K = alone @ full.T @ np.linalg.inv(full @ alone @ full.T + R)
    full[:, given_state] = slope
    left = np.eye(SIZE) - K @ full
    expected_x, expected_P = x + K @ nu, followed(left @ P @ left.T + K @ R @ K.T, K @ nu)
    whole = full @ P @ full.T + R
    fit = correct_despite(x, P, nu.copy(), H, columns, given_state, slope, R, math.inf)
    assert fit == pytest.approx(float(nu @ np.linalg.solve(whole, nu)))
    expected_x[at.YAW] = math.remainder(expected_x[at.YAW], math.tau)
    np.testing.assert_allclose(x, expected_x, atol=1e-12)
    np.testing.assert_allclose(P, expected_P, atol=1e-12)
    assert K[given_state] == pytest.approx(np.zeros(2), abs=1e-12)


def test_a_measurement_beyond_the_gate_changes_nothing():
    rng = np.random.default_rng(6)
    x, P = rng.normal(0.0, 1.0, SIZE), a_covariance(rng)
    before = x.copy(), P.copy()
    chi2 = correct(x, P, np.array((50.0,)), np.ones((1, 1)), np.array((3,)), 0.01 * np.eye(1), 9.0)
    assert chi2 > 9.0
    np.testing.assert_array_equal(x, before[0])
    np.testing.assert_array_equal(P, before[1])


def test_a_placed_gate_is_as_uncertain_as_vehicle_and_sighting_together():
    """Against many draws of vehicle, attitude and sighting, each of which places the gate itself."""
    rng = np.random.default_rng(7)
    x = np.zeros(SIZE)
    P = np.zeros((SIZE, SIZE))
    known = [at.POSITION, at.POSITION + 1, at.POSITION + 2, at.TILT, at.TILT + 1, at.YAW]
    P[np.ix_(known, known)] = 1e-4 * (np.eye(6) + 0.3)
    C = np.diag((4e-4, 1e-4, 1e-4, 1e-6, 1e-6, 1e-4))
    position, row, at_gate = np.array((6.0, 1.0, 0.5)), a_row(rng, 0.0), CORE
    row[at.ATTITUDE : at.ATTITUDE + 4] = (1.0, 0.0, 0.0, 0.0)
    sighting = np.concatenate((position, (1.0, 0.0, 0.0, 0.0), C.ravel()))
    y, Q = x.copy(), P.copy()
    place(y, Q, at_gate, row, sighting, np.zeros(3))
    draws = []
    for error, seen in zip(
        rng.multivariate_normal(np.zeros(SIZE), P, 20_000), rng.multivariate_normal(np.zeros(6), C, 20_000), strict=True
    ):
        turn = quat_from_rotvec(np.array((error[at.TILT], error[at.TILT + 1], error[at.YAW])))
        way = position + seen[:3]
        w = turn[1:]
        rotated = way + 2.0 * np.cross(w, np.cross(w, way) + turn[0] * way)
        draws.append((*(error[:3] + rotated), error[at.YAW] + seen[5]))
    np.testing.assert_allclose(y[at_gate : at_gate + 3], position)
    np.testing.assert_allclose(Q[at_gate : at_gate + 4, at_gate : at_gate + 4], np.cov(np.array(draws).T), atol=1e-4)
    assert np.linalg.eigvalsh(Q[: CORE + GATE, : CORE + GATE]).min() > -1e-12
