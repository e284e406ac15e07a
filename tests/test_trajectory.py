import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.frames import GRAVITY, Vector
from flightapp.trajectory import ORDER, Trajectory, hover

STAMP = 100.0


def wavy(seed: int, segments: int = 4) -> Trajectory:
    """Random pieces; they don't join, which no evaluation may rely on."""
    rng = np.random.default_rng(seed)
    knots = np.concatenate(((0.0,), np.cumsum(rng.uniform(0.3, 1.5, segments))))
    yaw_knots = np.concatenate(((0.0,), np.cumsum(rng.uniform(0.3, 1.5, segments + 1))))
    coefficients = rng.uniform(-1.0, 1.0, (segments, 3, ORDER))
    return Trajectory(STAMP, knots, coefficients, yaw_knots, rng.uniform(-1.0, 1.0, (segments + 1, 4)))


def direct(pieces: Vector, knots: Vector, t: float, order: int) -> Vector:
    """The ``order``-th derivative at ``t`` of ascending ``pieces`` (n, …, k), by numpy's polynomials."""
    i = min(int(np.searchsorted(knots, t, side="right")) - 1, len(knots) - 2)
    derivative = np.polynomial.polynomial.polyder(np.moveaxis(pieces[i], -1, 0), order)
    return np.polynomial.polynomial.polyval(t - knots[i], derivative)


@given(st.integers(0, 1000), st.floats(0.0, 1.0))
def test_values_and_derivatives_are_those_of_the_polynomials(seed: int, fraction: float) -> None:
    trajectory = wavy(seed)
    t = fraction * min(trajectory.duration, trajectory.yaw_knots[-1])
    samples = trajectory.sample(t)
    moving = (samples.position, samples.velocity, samples.acceleration, samples.jerk, samples.snap)
    for order, value in enumerate(moving):
        expected = direct(trajectory.coefficients, trajectory.knots, t, order)
        np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-9)
    for order, value in enumerate((samples.yaw, samples.yaw_rate)):
        expected = direct(trajectory.yaw_coefficients, trajectory.yaw_knots, t, order)
        assert value == pytest.approx(float(expected), rel=1e-9, abs=1e-9)


@given(st.integers(0, 1000), st.integers(0, 3), st.floats(0.1, 0.9))
def test_each_derivative_is_the_slope_of_the_one_before(seed: int, segment: int, fraction: float) -> None:
    trajectory = wavy(seed)
    lo, hi = trajectory.knots[segment : segment + 2]
    t, h = lo + fraction * (hi - lo), 1e-5
    before, here, after = (trajectory.sample(t + step) for step in (-h, 0.0, h))
    for name, slope in (
        ("position", "velocity"),
        ("velocity", "acceleration"),
        ("acceleration", "jerk"),
        ("jerk", "snap"),
    ):
        numeric = (getattr(after, name) - getattr(before, name)) / (2.0 * h)
        np.testing.assert_allclose(getattr(here, slope), numeric, rtol=1e-4, atol=1e-4)


@given(st.integers(0, 1000))
def test_many_times_at_once_are_the_same_as_one_by_one(seed: int) -> None:
    trajectory = wavy(seed)
    times = np.linspace(-0.5, trajectory.duration + 0.5, 23)
    together = trajectory.sample(times)
    for i, t in enumerate(times):
        alone = trajectory.sample(float(t))
        for name in ("position", "velocity", "acceleration", "jerk", "snap", "yaw", "yaw_rate"):
            np.testing.assert_array_equal(getattr(together, name)[i], getattr(alone, name))


def test_shapes() -> None:
    trajectory = wavy(1)
    many, one = trajectory.sample(np.zeros(5)), trajectory.sample(0.0)
    assert many.snap.shape == (5, 3)
    assert many.yaw.shape == (5,)
    assert one.snap.shape == (3,)
    assert np.ndim(one.yaw_rate) == 0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_outside_it_rests_at_its_ends(side: float) -> None:
    trajectory = wavy(2)
    longest = max(trajectory.duration, float(trajectory.yaw_knots[-1]))
    end, yaw_end = (0.0, 0.0) if side < 0.0 else (trajectory.duration, float(trajectory.yaw_knots[-1]))
    outside = trajectory.sample(-1e-3 if side < 0.0 else longest + 1e-3)
    np.testing.assert_array_equal(outside.position, trajectory.sample(end).position)
    assert outside.yaw == trajectory.sample(yaw_end).yaw
    for still in (outside.velocity, outside.acceleration, outside.jerk, outside.snap):
        np.testing.assert_array_equal(still, np.zeros(3))
    assert outside.yaw_rate == 0.0


def test_a_knot_belongs_to_the_segment_that_it_begins() -> None:
    trajectory = wavy(3)
    for i in range(1, 4):
        at_knot = trajectory.sample(float(trajectory.knots[i]))
        np.testing.assert_array_equal(at_knot.position, trajectory.coefficients[i, :, 0])


def test_setpoint_is_the_sample_at_its_stamp() -> None:
    trajectory = wavy(4)
    setpoint, sample = trajectory.setpoint(STAMP + 0.7), trajectory.sample(0.7 + STAMP - STAMP)
    assert setpoint.stamp == STAMP + 0.7
    for name in ("position", "velocity", "acceleration", "jerk", "yaw", "yaw_rate"):
        np.testing.assert_allclose(getattr(setpoint, name), getattr(sample, name), rtol=1e-9, atol=1e-9)
    assert trajectory.end_stamp == STAMP + trajectory.duration


def test_hovering_stays_and_looks_where_it_is_told() -> None:
    trajectory = hover(5.0, np.array((1.0, 2.0, 3.0)), 0.5 * math.pi)
    for stamp in (4.0, 5.0, 5.0005, 60.0):
        setpoint = trajectory.setpoint(stamp)
        np.testing.assert_array_equal(setpoint.position, (1.0, 2.0, 3.0))
        assert setpoint.yaw == 0.5 * math.pi
        for still in (setpoint.velocity, setpoint.acceleration, setpoint.jerk):
            np.testing.assert_array_equal(still, np.zeros(3))


@given(st.integers(0, 1000))
def test_limits_are_the_greatest_of_dense_samples(seed: int) -> None:
    trajectory = wavy(seed)
    peaks = trajectory.limits(step=1e-3)
    inside = [np.linspace(a, b, 900)[:-1] for a, b in zip(trajectory.knots[:-1], trajectory.knots[1:], strict=True)]
    samples = trajectory.sample(np.concatenate(inside))
    force = samples.acceleration + np.array([0.0, 0.0, GRAVITY])
    length = np.linalg.norm(force, axis=1)
    dense = {
        "speed": np.linalg.norm(samples.velocity, axis=1),
        "acceleration": np.linalg.norm(samples.acceleration, axis=1),
        "jerk": np.linalg.norm(samples.jerk, axis=1),
        "specific_force": length,
        "body_rate": np.linalg.norm(np.cross(force, samples.jerk), axis=1) / length**2,
        "tilt": np.arccos(force[:, 2] / length),
    }
    for name, values in dense.items():
        assert getattr(peaks, name) == pytest.approx(float(values.max()), rel=2e-2), name
    assert peaks.specific_force_min == pytest.approx(float(length.min()), rel=2e-2, abs=0.05)


@given(st.integers(0, 1000))
def test_limits_of_the_yaw_are_exact(seed: int) -> None:
    trajectory = wavy(seed)
    peaks = trajectory.limits()
    knots, c = trajectory.yaw_knots, trajectory.yaw_coefficients
    rates, accelerations = [], []
    for i in range(len(c)):
        s = np.linspace(0.0, knots[i + 1] - knots[i], 2000)
        rates.append(np.abs(c[i, 1] + 2.0 * c[i, 2] * s + 3.0 * c[i, 3] * s**2).max())
        accelerations.append(np.abs(2.0 * c[i, 2] + 6.0 * c[i, 3] * s).max())
    assert max(rates) <= peaks.yaw_rate * (1.0 + 1e-12)
    assert peaks.yaw_rate == pytest.approx(max(rates), rel=1e-5)
    assert peaks.yaw_acceleration == pytest.approx(max(accelerations), rel=1e-12)


def test_limits_see_both_sides_of_a_jump() -> None:
    coefficients = np.zeros((2, 3, ORDER))
    coefficients[0, 0, 2], coefficients[1, 0, 2] = 4.0, -1.0
    knots = np.array((0.0, 0.5, 1.0))
    trajectory = Trajectory(0.0, knots, coefficients, knots, np.zeros((2, 4)))
    peaks = trajectory.limits()
    assert peaks.speed == pytest.approx(4.0)
    assert peaks.acceleration == pytest.approx(8.0)
    assert peaks.specific_force == pytest.approx(math.hypot(8.0, GRAVITY))
    assert peaks.specific_force_min == pytest.approx(math.hypot(2.0, GRAVITY))
    assert peaks.tilt == pytest.approx(math.atan2(8.0, GRAVITY))


def test_hovering_asks_for_nothing_but_weight() -> None:
    peaks = hover(0.0, np.zeros(3), 0.0, 1.0).limits()
    assert peaks.specific_force == peaks.specific_force_min == GRAVITY
    assert (peaks.speed, peaks.acceleration, peaks.jerk, peaks.body_rate, peaks.tilt) == (0.0,) * 5
    assert (peaks.yaw_rate, peaks.yaw_acceleration) == (0.0, 0.0)
