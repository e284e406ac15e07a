"""The spline and its cost, beside dense algebra and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.planning.hermite import ENERGY, POWERS, polynomial_coefficients
from flightapp.planning.minimum import BAND, smoothest
from flightapp.planning.objective import cost

ORDERS = (2, 3, 4)


def random_spline(seed, n):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n + 1, 3)) * 5.0
    points[:, 2] = rng.uniform(0.5, 3.0, n + 1)
    derivatives = np.zeros((3 * (n + 1), 3))
    derivatives[:3] = rng.normal(size=(3, 3))
    return rng.uniform(0.5, 2.0, n), points, derivatives


def derivative_row(t, d):
    return np.array([math.perm(m, d) * t ** (m - d) if m >= d else 0.0 for m in range(8)])


def dense_spline(times, points, derivatives, order):
    """Coefficients (n, 3, 8) from the Karush-Kuhn-Tucker system in the coefficients themselves."""
    n = times.size
    quadratic = np.zeros((8 * n, 8 * n))
    rows, right = [], []

    def constrain(parts, value):
        row = np.zeros(8 * n)
        for segment, values in parts:
            row[8 * segment : 8 * segment + 8] += values
        rows.append(row)
        right.append(value)

    for i, duration in enumerate(times):
        nodes, weights = np.polynomial.legendre.leggauss(12)
        for node, weight in zip(nodes, weights, strict=True):
            r = derivative_row(0.5 * duration * (node + 1.0), order)
            quadratic[8 * i : 8 * i + 8, 8 * i : 8 * i + 8] += 0.5 * duration * weight * np.outer(r, r)
        constrain([(i, derivative_row(0.0, 0))], points[i])
        constrain([(i, derivative_row(duration, 0))], points[i + 1])
        if i + 1 < n:
            for d in (1, 2, 3):
                constrain([(i, derivative_row(duration, d)), (i + 1, -derivative_row(0.0, d))], np.zeros(3))
    for d in (1, 2, 3):
        constrain([(0, derivative_row(0.0, d))], derivatives[d - 1])
        constrain([(n - 1, derivative_row(times[-1], d))], np.zeros(3))
    A = np.array(rows)
    system = np.block([[quadratic, A.T], [A, np.zeros((len(A), len(A)))]])
    known = np.vstack([np.zeros((8 * n, 3)), np.array(right)])
    return np.linalg.lstsq(system, known, rcond=1e-15)[0][: 8 * n].reshape(n, 8, 3).transpose(0, 2, 1)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_banded_solution_is_that_of_the_dense_system(order, n):
    times, points, derivatives = random_spline(order + 10 * n, n)
    assert smoothest(times, points, order, derivatives, np.empty((3 * (n - 1), BAND)))
    ours = polynomial_coefficients(times, points, derivatives)
    dense = dense_spline(times, points, derivatives, order)
    np.testing.assert_allclose(ours, dense, rtol=1e-6, atol=1e-6 * np.abs(dense).max())


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(2, 20), order=st.sampled_from(ORDERS))
def test_position_to_jerk_are_continuous_at_the_knots(seed, n, order):
    times, points, derivatives = random_spline(seed, n)
    assert smoothest(times, points, order, derivatives, np.empty((3 * (n - 1), BAND)))
    c = polynomial_coefficients(times, points, derivatives)
    for i in range(n - 1):
        for d in range(4):
            before, after = c[i] @ derivative_row(times[i], d), c[i + 1] @ derivative_row(0.0, d)
            np.testing.assert_allclose(before, after, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(derivatives).max()))
        np.testing.assert_allclose(c[i, :, 0], points[i])


@pytest.mark.parametrize("order", ORDERS)
def test_any_other_derivatives_at_the_knots_cost_more_energy(order):
    times, points, derivatives = random_spline(4, 6)
    smoothest(times, points, order, derivatives, np.empty((15, BAND)))

    def energy(rows):
        total = 0.0
        for i, duration in enumerate(times):
            y = np.vstack([rows[3 * i : 3 * i + 6], points[i + 1] - points[i]]) * (duration**POWERS)[:, None]
            total += duration ** (1 - 2 * order) * np.einsum("qa,qp,pa->", y, ENERGY[order - 2], y)
        return total

    least = energy(derivatives)
    rng = np.random.default_rng(0)
    for _ in range(20):
        other = derivatives.copy()
        other[3:-3] += rng.normal(0.0, 0.1, other[3:-3].shape)
        assert energy(other) > least


@pytest.mark.parametrize("order", ORDERS)
def test_the_gradient_is_that_of_finite_differences(order):
    n = 5
    times, points, derivatives = random_spline(1, n)
    normals = np.zeros((n + 1, 3))
    normals[2], normals[3] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    limits = np.array([4.0, 8.0, 20.0, 3.6, 1.0, 0.9])
    by_time, by_point, unused = np.empty(n), np.empty((n + 1, 3)), (np.empty(n), np.empty((n + 1, 3)))
    value = cost(times, points, normals, limits, order, 1.0, derivatives, by_time, by_point)
    assert value > times.sum()

    def at(moved_times, moved_points):
        return cost(moved_times, moved_points, normals, limits, order, 1.0, derivatives.copy(), *unused)

    step = 1e-6
    for i in range(n):
        nudge = step * np.eye(n)[i]
        slope = (at(times + nudge, points) - at(times - nudge, points)) / (2.0 * step)
        assert by_time[i] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(by_time).max())
    for place in np.ndindex(n + 1, 3):
        nudge = np.zeros((n + 1, 3))
        nudge[place] = step
        slope = (at(times, points + nudge) - at(times, points - nudge)) / (2.0 * step)
        assert by_point[place] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(by_point).max())
