"""Success rates."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from flightapp.evaluation.sweep import sweep_summary, wilson_interval


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_against_published_values(successes, runs, low, high):
    """R. G. Newcombe, Statistics in Medicine 17 (1998), table I, method 3, to its four digits."""
    assert wilson_interval(successes, runs) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 500), st.data())
def test_wilson_agrees_with_scipy(runs, data):
    successes = data.draw(st.integers(0, runs))
    expected = binomtest(successes, runs).proportion_ci(0.95, method="wilson")
    assert wilson_interval(successes, runs) == pytest.approx((expected.low, expected.high), abs=1e-12)


@given(st.integers(0, 500), st.integers(0, 500))
def test_wilson_holds_the_rate_and_is_symmetric(successes, failures):
    runs = successes + failures
    low, high = wilson_interval(successes, runs)
    assert 0.0 <= low <= high <= 1.0
    if runs:
        assert low <= successes / runs <= high
    mirrored = wilson_interval(failures, runs)
    assert (1.0 - mirrored[1], 1.0 - mirrored[0]) == pytest.approx((low, high), abs=1e-12)


def test_wilson_refuses_what_cannot_be():
    with pytest.raises(ValueError, match="3 successes in 2 runs"):
        wilson_interval(3, 2)


def test_sweep_by_hand():
    good = {"outcome": "GOAL_ACHIEVED", "gates": [{"id": 0, "passed": True}], "collisions": []}
    results = [{**good, "seed": i, "elapsed": 10.0 + i} for i in range(3)]
    results.append({**good, "seed": 3, "elapsed": 4.0, "gates": [{"id": 0, "passed": False}]})
    results.append({"seed": 4, "why": "the process was killed"})
    summary = sweep_summary(results)
    assert list(summary) == ["runs", "successes", "rate", "ci95", "elapsed", "offset", "estimation", "failures"]
    assert summary["offset"] == {"p50": None, "p95": None, "max": None}
    assert summary["estimation"] is None
    assert (summary["runs"], summary["successes"], summary["rate"]) == (5, 3, 0.6)
    assert summary["ci95"] == list(wilson_interval(3, 5))
    assert summary["elapsed"] == {"p50": 11.0, "p95": pytest.approx(11.9)}
    assert summary["failures"] == [{"seed": 3, "why": "missed gate 0"}, {"seed": 4, "why": "the process was killed"}]


def test_sweep_tells_of_estimates_and_offsets():
    def flight(ours, theirs, nees, offset):
        gates = [{"id": 0, "passed": True, "offset": offset}]
        errors = {"estimation_rmse": {"total": ours}, "tracker_rmse": {"total": theirs}, "estimation_nees": nees}
        return {"outcome": "GOAL_ACHIEVED", "gates": gates, "collisions": [], "seed": 0, "elapsed": 1.0, **errors}

    summary = sweep_summary([flight(0.1, 0.4, 2.0, 0.1), flight(0.3, 0.4, 4.0, 0.2), flight(0.2, 0.4, 3.0, 0.3)])
    assert summary["offset"] == {"p50": 0.2, "p95": pytest.approx(0.29), "max": 0.3}
    estimation = summary["estimation"]
    assert estimation["rmse"]["p50"] == 0.2
    assert estimation["ratio"]["p50"] == pytest.approx(0.5)
    assert estimation["halved"] == 2
    assert estimation["nees"]["mean"] == pytest.approx(3.0)
    low, high = estimation["nees"]["band95"]
    assert low < 3.0 < high


def test_sweep_without_a_success_has_no_times():
    assert sweep_summary([{"seed": 0, "why": "x"}])["elapsed"] == {"p50": None, "p95": None}
    assert sweep_summary([])["rate"] == 0.0
