"""The spline, its cost and its ends, beside dense algebra and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.jit import lean_kernel
from flightapp.planning.hermite import ACCELERATION, JERK, SNAP
from flightapp.planning.minimum import smoothest
from flightapp.planning.objective import cost
from flightapp.planning.optimal import write
from flightapp.planning.spline import divide, spline

ORDERS = (ACCELERATION, JERK, SNAP)
LIMITS = np.array([4.0, 8.0, 20.0, 5.0, 3.6])


@lean_kernel
def bend(s, first, last):
    divide(s, first, last)


def random_spline(seed, n):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n + 1, 3)) * 5.0
    s = spline(points, rng.normal(size=(2, 3, 3)))
    s.times[:] = rng.uniform(0.5, 2.0, n)
    bend(s, 0.3, 0.4)
    return s


def solve(order, s):
    return smoothest(order, s.times, s.points, s.ends, s.derivatives, s.factors, s.couplings)


def derivative_row(t, d, size=8):
    return np.array([math.perm(m, d) * t ** (m - d) if m >= d else 0.0 for m in range(size)])


def dense_derivatives(order, s):
    """(n + 1, d, 3) from the Karush-Kuhn-Tucker system in the coefficients themselves."""
    free, n, size = len(order), s.times.size, 2 * len(order) + 2
    quadratic = np.zeros((size * n, size * n))
    rows, right = [], []

    def constrain(parts, value):
        row = np.zeros(size * n)
        for segment, values in parts:
            row[size * segment : size * segment + size] += values
        rows.append(row)
        right.append(value)

    for i, duration in enumerate(s.times):
        nodes, weights = np.polynomial.legendre.leggauss(12)
        for node, weight in zip(nodes, weights, strict=True):
            r = derivative_row(0.5 * duration * (node + 1.0), free + 1, size)
            part = slice(size * i, size * i + size)
            quadratic[part, part] += 0.5 * duration * weight * np.outer(r, r)
        constrain([(i, derivative_row(0.0, 0, size))], s.points[i])
        constrain([(i, derivative_row(duration, 0, size))], s.points[i + 1])
        if i + 1 < n:
            for d in range(1, free + 1):
                ends = [(i, derivative_row(duration, d, size)), (i + 1, -derivative_row(0.0, d, size))]
                constrain(ends, np.zeros(3))
    for d in range(1, free + 1):
        constrain([(0, derivative_row(0.0, d, size))], s.ends[0, d - 1])
        constrain([(n - 1, derivative_row(s.times[-1], d, size))], s.ends[1, d - 1])
    A = np.array(rows)
    system = np.block([[quadratic, A.T], [A, np.zeros((len(A), len(A)))]])
    known = np.vstack([np.zeros((size * n, 3)), np.array(right)])
    c = np.linalg.lstsq(system, known, rcond=1e-15)[0][: size * n].reshape(n, size, 3)
    at_starts = [[derivative_row(0.0, d, size) @ c[i] for d in range(1, free + 1)] for i in range(n)]
    return np.array([*at_starts, [derivative_row(s.times[-1], d, size) @ c[-1] for d in range(1, free + 1)]])


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_solution_is_that_of_the_dense_system(order, n):
    s = random_spline(len(order) + 10 * n, n)
    assert solve(order, s)
    dense = dense_derivatives(order, s)
    ours = s.derivatives[:, : len(order)]
    np.testing.assert_allclose(ours, dense, rtol=1e-6, atol=1e-6 * np.abs(dense).max())


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 20), order=st.sampled_from(ORDERS))
def test_a_plan_goes_through_its_points_without_a_step_and_has_the_ends_asked_for(seed, n, order):
    s = random_spline(seed, n)
    assert solve(order, s)
    knots, c = np.empty(n + 3), np.empty((n + 2, 3, 8))
    assert write(order, s, knots, c)
    assert knots[-1] == pytest.approx(s.times.sum())
    scale = max(1.0, np.abs(c).max())
    for d in range(1, 4):
        np.testing.assert_allclose(c[0] @ derivative_row(0.0, d), s.ends[0, d - 1], atol=1e-9 * scale)
        np.testing.assert_allclose(c[-1] @ derivative_row(np.diff(knots)[-1], d), s.ends[1, d - 1], atol=1e-9 * scale)
    for i, duration in enumerate(np.diff(knots)[:-1]):
        for d in range(min(len(order), 2) + 2):
            before, after = c[i] @ derivative_row(duration, d), c[i + 1] @ derivative_row(0.0, d)
            np.testing.assert_allclose(before, after, rtol=1e-9, atol=1e-9 * scale)
    np.testing.assert_allclose(c[:, :, 0][[0, *range(2, n + 1)]], s.points[:-1])


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("n", [1, 2, 6])
def test_the_gradient_is_that_of_finite_differences(order, n):
    s = random_spline(1, n)
    gradient, unused = np.empty(n), np.empty(n)
    assert cost(order, s, LIMITS, 1.0, gradient) > s.times.sum()
    times, step = s.times.copy(), 1e-6

    def at(i, change):
        s.times[:] = times
        s.times[i] *= math.exp(change)
        return cost(order, s, LIMITS, 1.0, unused)

    for i in range(n):
        slope = (at(i, step) - at(i, -step)) / (2.0 * step)
        assert gradient[i] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(gradient).max())


def test_within_the_limits_the_cost_is_the_duration():
    s = random_spline(2, 4)
    gradient = np.empty(4)
    assert cost(JERK, s, np.array([1e3, 1e3, 1e3, 1e-3, 1e3]), 50.0, gradient) == pytest.approx(s.times.sum())
    np.testing.assert_allclose(gradient, s.times)
