"""Metrics against numbers worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flightapp.evaluation.flight import Flight, Motions, Setpoints, States
from flightapp.evaluation.metrics import (
    Window,
    plan_statistics,
    position_error,
    position_nees,
    racing_window,
    rmse,
    sender_statistics,
    speeds,
    velocity_error,
)
from flightapp.messages import Event, PlanReport

ALL = Window(-1e9, 1e9)


def motions(stamps, position, velocity=None, kind=Motions):
    stamps, position = np.asarray(stamps, float), np.asarray(position, float)
    velocity = np.zeros_like(position) if velocity is None else np.asarray(velocity, float)
    return kind(stamp=stamps, position=position, velocity=velocity)


def test_rmse_by_hand():
    found = rmse(np.array([[3.0, 0.0, 0.0], [4.0, 1.0, 0.0]]))
    assert found is not None
    assert found.x == pytest.approx(math.sqrt(12.5))
    assert found.y == pytest.approx(math.sqrt(0.5))
    assert found.z == 0.0
    assert found.total == pytest.approx(math.sqrt((9.0 + 17.0) / 2.0))


def test_rmse_of_nothing_is_none():
    assert rmse(np.zeros((0, 3))) is None


@given(arrays(float, st.tuples(st.integers(1, 30), st.just(3)), elements=st.floats(-1e3, 1e3)))
def test_total_is_the_root_mean_square_length(error):
    found = rmse(error)
    assert found is not None
    assert found.total == pytest.approx(np.sqrt(np.mean(np.linalg.norm(error, axis=1) ** 2)), abs=1e-9)
    assert found.total == pytest.approx(math.hypot(found.x, found.y, found.z), abs=1e-9)


def test_error_is_read_between_the_states():
    """The state moves at 2 m/s in x; half-way between its samples it is half-way between its positions."""
    states = motions([0.0, 1.0, 2.0], [[0, 0, 0], [2, 0, 0], [4, 0, 0]], kind=States)
    setpoints = motions([0.5, 1.25], [[1.5, 0, 0], [2.5, 1.0, 0]], kind=Setpoints)
    stamps, error = position_error(setpoints, states, ALL)
    assert stamps.tolist() == [0.5, 1.25]
    assert np.allclose(error, [[0.5, 0, 0], [0.0, 1.0, 0]])


def test_error_is_never_extrapolated():
    states = motions([1.0, 2.0], [[0, 0, 0], [0, 0, 0]], kind=States)
    setpoints = motions([0.5, 1.0, 1.5, 2.5], np.ones((4, 3)), kind=Setpoints)
    stamps, _ = position_error(setpoints, states, ALL)
    assert stamps.tolist() == [1.0, 1.5]


def test_error_keeps_to_the_window_and_is_empty_without_the_other():
    states = motions([0.0, 9.0], np.zeros((2, 3)), kind=States)
    setpoints = motions(range(10), np.ones((10, 3)), np.full((10, 3), 2.0), kind=Setpoints)
    stamps, error = velocity_error(setpoints, states, Window(2.5, 5.0))
    assert stamps.tolist() == [3.0, 4.0, 5.0]
    assert np.all(error == 2.0)
    assert position_error(setpoints, Motions(), ALL)[1].shape == (0, 3)


def test_mean_speed_is_over_time_not_over_samples():
    """1 m/s for nine seconds with two samples, then 1 to 3 m/s in one second with two more."""
    velocity = [[1, 0, 0], [0, 1, 0], [0, 0, 2], [0, 0, -3]]
    found = speeds(motions([0.0, 9.0, 9.5, 10.0], np.zeros((4, 3)), velocity), ALL)
    assert found is not None
    assert found.peak == 3.0
    assert found.mean == pytest.approx((9.0 + 0.75 + 1.25) / 10.0)


def test_speed_of_nothing_is_none():
    assert speeds(Motions(), ALL) is None


@pytest.mark.parametrize(
    ("events", "expected"),
    [
        ([(1.0, "takeoff"), (2.0, "flying: race"), (7.0, "landing: done"), (9.0, "landed")], (2.0, 7.0)),
        ([(2.0, "flying"), (3.0, "flying: again"), (7.0, "aborted: tilt")], (2.0, 7.0)),
        ([(2.0, "flying")], (2.0, 10.0)),
        ([(1.0, "takeoff")], (0.0, 10.0)),
    ],
)
def test_window_is_from_flying_to_the_next_phase(events, expected):
    flight = Flight(
        states=motions([0.0, 10.0], np.zeros((2, 3)), kind=States),
        events=(Event(2.5, "behavior", "landing on its feet"), *(Event(s, "phase", text) for s, text in events)),
    )
    window = racing_window(flight)
    assert (window.start, window.end) == expected


def test_sender_statistics_by_hand():
    """A hundred intervals of 4 ms but one of 12 ms: two deadlines were missed."""
    stamps = np.cumsum([0.0] + [0.004] * 60 + [0.012] + [0.004] * 39)
    for rate in (250.0, None):
        found = sender_statistics(stamps, ALL, rate)
        assert found is not None
        assert found.rate == pytest.approx(100.0 / 0.408)
        assert found.p50 == pytest.approx(0.004)
        assert found.p999 == pytest.approx(0.004 + 0.901 * 0.008, rel=1e-3)
        assert found.overruns == 2


def test_sender_statistics_of_one_command_are_none():
    assert sender_statistics(np.ones(1), ALL) is None


def test_plan_statistics_count_what_was_flown_and_refused():
    plans = tuple(PlanReport(i, 0.001 * (i + 1), i != 2, "") for i in range(5))
    found = plan_statistics(plans, Window(0.5, 10.0))
    assert (found.count, found.refused) == (3, 1)
    assert found.p50 == pytest.approx(0.0035)
    assert plan_statistics((), ALL).count == 0


def test_nees_of_errors_that_are_as_large_as_said():
    """Errors drawn from the covariance itself have a mean of 3; half as large ones, of 3/4."""
    rng, n = np.random.default_rng(3), 20_000
    C = np.array(((0.04, 0.01, -0.005), (0.01, 0.02, 0.0), (-0.005, 0.0, 0.01)))
    errors, stamps = rng.multivariate_normal(np.zeros(3), C, n), np.arange(n) * 0.01
    truth = Motions(stamp=stamps, position=np.zeros((n, 3)))
    variance = np.tile(np.concatenate((np.diag(C), np.ones(6))), (n, 1))
    cross = np.tile((C[0, 1], C[0, 2], C[1, 2]), (n, 1))
    window = Window(0.0, stamps[-1])
    for share, expected in ((1.0, 3.0), (0.5, 0.75)):
        states = States(stamp=stamps, position=share * errors, variance=variance, position_covariance=cross)
        assert position_nees(states, truth, window) == pytest.approx(expected, rel=0.03)
    assert position_nees(States(), truth, window) is None
