"""The fits find what a flight was made with, within their own standard errors, and say when it was not told."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import Made, model_rates, stretch

from flightapp.config import Vehicle
from flightapp.identification.findings import identify
from flightapp.identification.fitting import Start, robust_fit
from flightapp.identification.rates import fit_rates

BEFORE = Vehicle(hover_thrust=0.3, delay=0.02, rate_lag=0.05)


def truth(made):
    return {
        "delay": made.delay,
        "rate_lag": made.rate_lag,
        "yaw_rate_lag": made.yaw_rate_lag,
        "hover_thrust": made.hover,
        "thrust_curve": made.curve,
        "motor_lag": made.thrust_late,
        "drag x": made.drag[0],
        "drag y": made.drag[1],
        "drag z": made.drag[2],
    }


def off(found, made):
    """How many standard errors each finding is off."""
    expected = truth(made)
    return {f.name: (f.value - expected[f.name]) / f.sigma for f in found.findings if f.name in expected}


def test_the_synthetic_flight_is_made_as_it_says():
    made = Made(rate_noise=0.0, rate_bias=0.0)
    part = stretch(made, 1, 10.0)
    np.testing.assert_allclose(part.angular_velocity, model_rates(made, part), atol=0.03)


@pytest.mark.parametrize("made", [Made(gust=0.3, wind=(0.5, -0.3)), Made(delay=0.04, drag=(0.6, 0.2, 0.9))])
def test_all_parameters_are_found(made):
    found = identify([stretch(made, 3)], BEFORE)
    assert not found.refusals
    errors = off(found, made)
    assert errors.keys() == truth(made).keys()
    assert max(map(abs, errors.values())) < 4.0, errors


def test_standard_errors_are_honest():
    made = Made(gust=0.3)
    errors = [off(identify([stretch(made, 100 + seed, 20.0)], BEFORE), made) for seed in range(5)]
    squares = [e**2 for one in errors for e in one.values()]
    assert 0.4 < np.mean(squares) < 2.5, errors


def test_flights_together_tell_more_than_one():
    made = Made(gust=0.3)
    parts = [stretch(made, seed, 20.0) for seed in (11, 12, 13)]
    one, all_of_them = identify(parts[:1], BEFORE), identify(parts, BEFORE)
    assert all_of_them.duration > 2.9 * one.duration
    sigma = {f.name: f.sigma for f in one.findings}
    assert np.mean([f.sigma / sigma[f.name] for f in all_of_them.findings if f.sigma > 0.0]) < 0.85


def test_a_hover_tells_the_hover_thrust_and_refuses_the_rest():
    made = Made(curve=0.001)
    found = identify([stretch(made, 5, 20.0, gain=0.0)], replace_curve(BEFORE))
    assert [f.name for f in found.findings] == ["hover_thrust", "thrust_to_weight"]
    assert found.value("hover_thrust") == pytest.approx(made.hover, rel=0.01)
    why = {refusal.name: refusal.why for refusal in found.refusals}
    assert "never commanded above" in why["delay"] and "never commanded above" in why["yaw_rate_lag"]
    assert "swung by only" in why["motor_lag"]
    assert "never above" in why["drag x"] and "it takes" in why["drag z"]


def replace_curve(vehicle):
    return vehicle.model_copy(update={"thrust_curve": 0.0})


def test_nothing_is_said_of_the_thrust_where_its_map_was_learning():
    found = identify([stretch(Made(), 6, 20.0)], BEFORE, map_known=False)
    assert {f.name for f in found.findings} <= {"delay", "rate_lag", "yaw_rate_lag"}
    assert all("learn_hover_thrust" in r.why for r in found.refusals)


def test_outliers_hardly_matter():
    made = Made()
    clean = stretch(made, 7)
    rates = clean.angular_velocity.copy()
    rng = np.random.default_rng(1)
    rates[rng.integers(0, len(rates), 60)] += rng.uniform(5.0, 20.0, (60, 3))
    a, b = fit_rates([clean], (0, 1)), fit_rates([replace(clean, angular_velocity=rates)], (0, 1))
    assert b.delay == pytest.approx(a.delay, abs=5e-4)
    assert b.lag == pytest.approx(a.lag, abs=1e-3)


def test_the_sandwich_sees_errors_that_last():
    rng = np.random.default_rng(2)
    blocks = np.repeat(np.arange(50), 20)
    start = Start(np.zeros(1), np.ones(1), np.full(1, -9.0), np.full(1, 9.0))
    ends = []
    for _ in range(40):
        y = 1.0 + np.repeat(rng.standard_normal(50), 20) + 0.1 * rng.standard_normal(1000)
        fit = robust_fit(lambda x, y=y: x[0] - y, start, np.zeros(1000, int), blocks)
        ends.append((fit.values[0], fit.sigmas[0]))
    values, sigmas = np.array(ends).T
    assert np.mean(sigmas) == pytest.approx(np.std(values), rel=0.3)
