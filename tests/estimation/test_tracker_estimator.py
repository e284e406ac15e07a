import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.config import Config
from flightapp.estimation.tracker import RELOCALISED_AFTER, Refusal, TrackerEstimator
from flightapp.frames import (
    Vector,
    quat_conjugate,
    quat_from_rotvec,
    quat_from_yaw,
    quat_multiply,
    quat_rotate,
    quat_to_rotvec,
)
from flightapp.interfaces import Estimator
from flightapp.messages import Drift, PoseSample, VehicleState

DT = 0.005
LEVEL = quat_from_yaw(0.0)


def straight(k: int, speed: float = 2.0, offset: float = 0.0) -> PoseSample:
    return PoseSample(
        k * DT, np.array((speed * k * DT, offset, 1.5)), LEVEL, np.array((speed, 0.0, 0.0)), np.zeros(3), 3
    )


def drift_of(x: float, y: float, z: float, yaw: float, covariance: Vector | None = None) -> Drift:
    return Drift(0.0, np.array((x, y, z)), yaw, 1e-4 * np.eye(4) if covariance is None else covariance)


def accepted(state: VehicleState | None) -> VehicleState:
    assert state is not None
    return state


vectors = st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3).map(np.array)
turns = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3).map(lambda r: quat_from_rotvec(np.array(r)))
angles = st.floats(-3.1, 3.1)


@settings(deadline=None)
@given(vectors, turns, vectors, vectors, vectors, angles)
def test_poses_are_composed_with_the_drift(p: Vector, q: Vector, v: Vector, w: Vector, t: Vector, yaw: float) -> None:
    estimator = TrackerEstimator(Config())
    estimator.on_drift(drift_of(*t, yaw))
    state = accepted(estimator.on_pose(PoseSample(1.0, p, q, v, w, 3)))
    q_wo = quat_from_yaw(yaw)
    assert state.stamp == 1.0
    assert np.allclose(state.position, quat_rotate(q_wo, p) + t)
    assert np.allclose(state.velocity, quat_rotate(q_wo, v))
    assert np.allclose(state.angular_velocity, w)
    assert np.allclose(quat_multiply(quat_conjugate(state.orientation), quat_multiply(q_wo, q))[1:], 0.0, atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(vectors, turns, vectors, vectors, angles, st.integers(0, 1000))
def test_the_covariance_is_that_of_the_composition(
    p: Vector, q: Vector, v: Vector, t: Vector, yaw: float, seed: int
) -> None:
    """The drift's covariance is carried over as numerical differentiation says, on top of the tracker's noise."""
    root = np.random.default_rng(seed).normal(0.0, 0.1, (4, 4))
    covariance = root @ root.T
    sample = PoseSample(1.0, p, q, v, np.zeros(3), 3)
    mean = np.array((*t, yaw))

    def state_at(drift: Vector) -> VehicleState:
        estimator = TrackerEstimator(Config())
        estimator.on_drift(drift_of(*drift, covariance))
        return accepted(estimator.on_pose(sample))

    centre, step = state_at(mean), 1e-6
    G = np.zeros((9, 4))
    for k in range(4):
        moved = state_at(mean + step * np.eye(4)[k])
        turn = quat_to_rotvec(quat_multiply(quat_conjugate(centre.orientation), moved.orientation))
        G[:, k] = np.concatenate((moved.position - centre.position, moved.velocity - centre.velocity, turn)) / step
    e = Config().estimation
    own = np.repeat((e.position_noise, e.velocity_noise, e.attitude_noise), 3) ** 2
    assert np.allclose(centre.covariance, np.diag(own) + G @ covariance @ G.T, atol=1e-6)


def test_it_is_an_estimator() -> None:
    estimator: Estimator = TrackerEstimator(Config())
    assert estimator.on_pose(straight(0)) is not None


def test_a_new_drift_is_blended_in() -> None:
    estimator = TrackerEstimator(Config())
    accepted(estimator.on_pose(straight(0)))
    estimator.on_drift(drift_of(0.0, 0.4, -0.2, 0.1))
    offsets, yaws = [], []
    for k in range(1, 201):
        state = accepted(estimator.on_pose(straight(k, speed=0.0)))
        offsets.append(state.position - (0.0, 0.0, 1.5))
        yaws.append(2.0 * math.atan2(state.orientation[3], state.orientation[0]))
    steps = np.abs(np.diff(np.array(offsets)[:, 1], prepend=0.0))
    assert steps.max() < 0.4 * DT / Config().estimation.drift_blend * 1.01
    assert offsets[59][1] == pytest.approx(0.4 * (1.0 - math.exp(-0.3 / Config().estimation.drift_blend)), rel=1e-6)
    assert np.allclose(offsets[-1], (0.0, 0.4, -0.2), atol=2e-3)
    assert yaws[-1] == pytest.approx(0.1, abs=1e-3)
    assert np.all(np.diff(yaws) > 0.0)


def test_yaw_is_blended_the_short_way() -> None:
    estimator = TrackerEstimator(Config())
    estimator.on_drift(drift_of(0.0, 0.0, 0.0, 3.1))
    accepted(estimator.on_pose(straight(0)))
    estimator.on_drift(drift_of(0.0, 0.0, 0.0, -3.1))
    for k in range(1, 100):
        state = accepted(estimator.on_pose(straight(k, speed=0.0)))
        ahead = quat_rotate(state.orientation, np.array((1.0, 0.0, 0.0)))
        assert ahead[0] < -0.99


@pytest.mark.parametrize("field", ["position", "orientation", "velocity", "angular_velocity"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_samples_that_are_not_finite_are_refused(field: str, value: float) -> None:
    estimator = TrackerEstimator(Config())
    accepted(estimator.on_pose(straight(0)))
    bad = getattr(straight(1), field).copy()
    bad[1] = value
    assert estimator.on_pose(replace(straight(1), **{field: bad})) is None
    assert estimator.counts[Refusal.NOT_FINITE] == 1
    assert estimator.last_refusal is Refusal.NOT_FINITE
    assert np.isfinite(accepted(estimator.on_pose(straight(2))).position).all()
    assert estimator.last_refusal is Refusal.NONE


def test_quaternions_are_normalised_or_refused() -> None:
    estimator = TrackerEstimator(Config())
    nearly = accepted(estimator.on_pose(replace(straight(0), orientation=1.0009 * LEVEL)))
    assert np.linalg.norm(nearly.orientation) == pytest.approx(1.0, abs=1e-12)
    assert estimator.on_pose(replace(straight(1), orientation=1.0011 * LEVEL)) is None
    assert estimator.on_pose(replace(straight(1), orientation=0.0 * LEVEL)) is None
    assert estimator.counts[Refusal.NOT_UNIT] == 2


def test_old_and_repeated_samples_are_refused() -> None:
    estimator = TrackerEstimator(Config())
    for k in (0, 1, 2):
        accepted(estimator.on_pose(straight(k)))
    assert estimator.on_pose(straight(2)) is None
    assert estimator.on_pose(straight(1)) is None
    assert estimator.counts[Refusal.STALE] == 2
    accepted(estimator.on_pose(straight(3)))


def test_a_failed_tracker_is_refused() -> None:
    estimator = TrackerEstimator(Config())
    assert estimator.on_pose(replace(straight(0), confidence=0)) is None
    assert estimator.counts[Refusal.LOST] == 1


def test_a_single_jump_is_refused() -> None:
    estimator = TrackerEstimator(Config())
    accepted(estimator.on_pose(straight(0)))
    for k in range(1, 40):
        jumps = k % 2 == 1
        state = estimator.on_pose(straight(k, offset=1.0 + k if jumps else 0.0))
        assert (state is None) == jumps
    assert estimator.counts[Refusal.JUMP] == 20


def test_speed_explains_a_way() -> None:
    estimator = TrackerEstimator(Config())
    accepted(estimator.on_pose(straight(0, speed=8.0)))
    assert estimator.on_pose(straight(100, speed=8.0)) is not None


def test_a_jump_that_stays_is_a_relocalisation() -> None:
    estimator = TrackerEstimator(Config())
    accepted(estimator.on_pose(straight(0)))
    states = [estimator.on_pose(straight(k, offset=1.0)) for k in range(1, 2 * RELOCALISED_AFTER)]
    assert [state is None for state in states[:RELOCALISED_AFTER]] == [True] * (RELOCALISED_AFTER - 1) + [False]
    assert all(state is not None for state in states[RELOCALISED_AFTER:])
    assert accepted(states[-1]).position[1] == pytest.approx(1.0)
    assert estimator.counts[Refusal.JUMP] == RELOCALISED_AFTER - 1


def test_a_drift_that_is_not_finite_is_refused() -> None:
    estimator = TrackerEstimator(Config())
    estimator.on_drift(drift_of(math.nan, 0.0, 0.0, 0.0))
    estimator.on_drift(drift_of(0.0, 0.0, 0.0, 0.0, np.full((4, 4), math.inf)))
    assert estimator.counts[Refusal.BAD_DRIFT] == 2
    assert accepted(estimator.on_pose(straight(0))).position[2] == 1.5


def test_states_do_not_share_memory() -> None:
    estimator = TrackerEstimator(Config())
    first = accepted(estimator.on_pose(straight(0)))
    kept = first.position.copy()
    accepted(estimator.on_pose(straight(1)))
    assert np.array_equal(first.position, kept)


@pytest.mark.parametrize("make", [lambda a: np.asarray(a, np.float32), lambda a: np.repeat(a, 2)[::2], tuple])
def test_any_kind_of_array_is_taken_without_compiling_again(make: object) -> None:
    estimator = TrackerEstimator(Config())
    s = straight(0)
    arrays = (make(a) for a in (s.position, s.orientation, s.velocity, s.angular_velocity))  # type: ignore[operator]
    assert np.allclose(accepted(estimator.on_pose(PoseSample(0.0, *arrays, 3))).position, s.position)


@pytest.mark.benchmark(group="estimation")
def test_step_speed(benchmark: object) -> None:
    estimator = TrackerEstimator(Config())
    estimator.on_drift(drift_of(0.1, 0.2, 0.3, 0.1))
    samples = iter(straight(k) for k in range(10_000_000))
    state = benchmark(lambda: estimator.on_pose(next(samples)))  # type: ignore[operator]
    assert state is not None
