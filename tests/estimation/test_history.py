import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.estimation.history import PoseHistory
from flightapp.frames import Vector, quat_conjugate, quat_from_rotvec, quat_multiply, quat_to_rotvec
from flightapp.messages import PoseSample

SPIN = np.array((0.4, -0.6, 1.5))
RADIUS, OMEGA = 3.0, 1.6


def circling(t: float, confidence: int = 3) -> PoseSample:
    """A circle flown at 4.8 m/s while turning at a constant body rate."""
    c, s = math.cos(OMEGA * t), math.sin(OMEGA * t)
    return PoseSample(
        t,
        np.array((RADIUS * c, RADIUS * s, 1.0 + 0.2 * t)),
        quat_from_rotvec(t * SPIN),
        np.array((-RADIUS * OMEGA * s, RADIUS * OMEGA * c, 0.2)),
        SPIN,
        confidence,
    )


def filled(stop: float, step: float = 0.005) -> PoseHistory:
    history = PoseHistory()
    for t in np.arange(0.0, stop + 0.5 * step, step):
        history.add(circling(float(t)))
    return history


def angle_between(a: Vector, b: Vector) -> float:
    return float(np.linalg.norm(quat_to_rotvec(quat_multiply(quat_conjugate(a), b))))


COARSE = filled(2.0, 0.05)


@settings(deadline=None)
@given(st.floats(1.01, 2.0))
def test_poses_between_samples_are_the_true_ones(stamp: float) -> None:
    pose, truth = COARSE.at(stamp), circling(stamp)
    assert pose is not None
    assert pose.stamp == stamp
    assert np.linalg.norm(pose.position - truth.position) < 1e-6
    assert np.linalg.norm(pose.velocity - truth.velocity) < OMEGA**3 * RADIUS * 0.05**2
    assert angle_between(pose.orientation, truth.orientation) < 1e-9
    assert np.allclose(pose.angular_velocity, SPIN)


def test_samples_themselves_are_returned_exactly() -> None:
    pose = filled(0.5).at(0.25)
    assert pose is not None
    assert np.allclose(pose.position, circling(0.25).position, atol=1e-12)


def test_a_little_extrapolation_and_no_more() -> None:
    history = filled(0.5)
    ahead, truth = history.at(0.515), circling(0.515)
    assert ahead is not None
    assert np.linalg.norm(ahead.position - truth.position) < 0.5 * OMEGA**2 * RADIUS * 0.015**2 * 1.05
    assert angle_between(ahead.orientation, truth.orientation) < 1e-9
    assert history.at(0.521) is None


def test_outside_there_is_none() -> None:
    assert PoseHistory().at(0.0) is None
    history = filled(3.0)
    assert history.at(1.99) is None
    assert history.at(2.01) is not None
    assert history.at(math.nan) is None
    assert len(history) <= 202


def test_gaps_are_not_bridged() -> None:
    history = filled(0.1)
    history.add(circling(0.3))
    assert history.at(0.2) is None
    assert history.at(0.3) is not None
    assert history.at(0.05) is not None


def test_the_lower_confidence_counts() -> None:
    history = PoseHistory()
    history.add(circling(0.0, 3))
    history.add(circling(0.005, 1))
    pose = history.at(0.002)
    assert pose is not None
    assert pose.confidence == 1


@pytest.mark.parametrize("stamp", [0.1, 0.05, math.nan])
def test_samples_out_of_order_are_not_taken(stamp: float) -> None:
    history = filled(0.1)
    before = history.at(0.1)
    late = circling(0.0)
    assert not history.add(PoseSample(stamp, late.position, late.orientation, late.velocity, SPIN, 3))
    after = history.at(0.1)
    assert before is not None
    assert after is not None
    assert np.array_equal(before.position, after.position)


def test_samples_that_are_not_finite_are_not_taken() -> None:
    history, bad = filled(0.1), circling(0.2)
    assert not history.add(PoseSample(0.2, np.array((math.nan, 0, 0)), bad.orientation, bad.velocity, SPIN, 3))
