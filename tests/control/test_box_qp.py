"""Small quadratic programs with bounds."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.control.box_qp import minimise
from flightapp.jit import kernel


@kernel
def solved(H, g, low, high, x):
    return minimise(H, g, low, high, x, np.zeros(x.size), np.zeros(H.shape), np.zeros((2, x.size)), x.size)


@given(st.integers(0, 10**6), st.integers(1, 5))
@settings(max_examples=50)
def test_a_small_program_is_solved_as_by_trying_all_sets_of_bounds(seed, n):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    H, g = A @ A.T + 0.1 * np.eye(n), 3.0 * rng.standard_normal(n)
    low, high = -rng.uniform(0.0, 1.0, n), rng.uniform(0.0, 1.0, n)
    x = np.zeros(n)
    assert solved(H, g, low, high, x)
    assert (low <= x).all()
    assert (x <= high).all()
    best = np.inf
    for held in itertools.product((-1, 0, 1), repeat=n):
        y = np.where(np.array(held) < 0, low, high)
        free = np.array(held) == 0
        y[free] = np.linalg.solve(H[np.ix_(free, free)], -g[free] - H[np.ix_(free, ~free)] @ y[~free])
        if (y >= low - 1e-12).all() and (y <= high + 1e-12).all():
            best = min(best, y @ (0.5 * H @ y + g))
    assert x @ (0.5 * H @ x + g) == pytest.approx(best, abs=1e-9)
