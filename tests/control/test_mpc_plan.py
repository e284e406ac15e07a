"""Plans of the model-predictive controller, against slower ways to the same."""

import numpy as np
import pytest
from planned import CALM, GRID, NUMBERS, REST, P, at_hover, changed, cost_derivatives, jacobian, weights_of

from flightapp.control.mpc import carry_on
from flightapp.control.mpc_model import TANGENT
from flightapp.control.mpc_solver import PLANNED, plan
from flightapp.control.mpc_work import STEPS, room
from flightapp.control.riccati import WIDE
from flightapp.frames import GRAVITY, quat_from_euler

UNTILTED = P._replace(tilt_cotangent=-1e3)
"""Without a limit of the tilt."""


def hovering(start, p=UNTILTED):
    """A horizon that hovers at `REST`, and begins at ``start`` (14,)."""
    work = room(p, GRID)
    work.bounds[0], work.bounds[1] = -100.0, 100.0
    work.asked[:, 3] = GRAVITY
    work.reference[:] = at_hover(start)
    work.x[0] = start
    return work


def test_near_a_hover_it_is_the_linear_quadratic_regulator():
    """Against the Riccati recursion with derivatives from differences."""
    rest = np.concatenate((REST, np.zeros(3), [1.0, 0.0, 0.0, 0.0], np.zeros(3), [GRAVITY]))
    trim, level = np.array([0.0, 0.0, 0.0, GRAVITY]), at_hover(rest)
    turn, yaw, lift = weights_of(NUMBERS, level)
    V = np.zeros((TANGENT, TANGENT))
    for k in range(STEPS - 1, -1, -1):
        Q = np.zeros((TANGENT, WIDE))
        cost_derivatives(NUMBERS, rest, level, GRID[k, 0], k == STEPS - 1, Q.ravel())
        V = V + Q[:, :TANGENT]
        F = jacobian(rest, trim, GRID[k])
        A, B = F[:, :TANGENT], F[:, TANGENT:]
        R = GRID[k, 0] * np.diag((turn, turn, yaw, lift)) + B.T @ V @ B
        K = np.linalg.solve(R, B.T @ V @ A)
        V = A.T @ V @ (A - B @ K)
    change = 1e-4 * np.random.default_rng(4).standard_normal(TANGENT)
    work = hovering(changed(rest, change), P)
    assert plan(work, CALM, 1) == PLANNED
    assert work.u[0] - trim == pytest.approx(-K @ change, rel=0.01, abs=2e-6)


def test_a_plan_keeps_to_the_bounds_and_meets_them():
    far = np.concatenate((REST + np.array((3.0, -3.0, 2.0)), np.zeros(3), [1.0, 0.0, 0.0, 0.0], np.zeros(3), [GRAVITY]))
    work = hovering(far)
    work.bounds[0], work.bounds[1] = (-2.0, -2.0, -1.0, 5.0), (2.0, 2.0, 1.0, 15.0)
    for _ in range(10):
        plan(work, CALM, 1)
        assert (work.u >= work.bounds[0]).all()
        assert (work.u <= work.bounds[1]).all()
    assert np.abs(work.u[:, :2]).max() == 2.0
    assert work.u[:, 3].min() == 5.0


def test_iterations_come_to_an_end_at_one_plan():
    start = REST + np.array((1.0, 0.0, 0.5))
    far = np.concatenate((start, [2.0, 1.0, 0.0], quat_from_euler(0.8, 0.3, 1.0), np.zeros(3), [12.0]))
    one, other = hovering(far), hovering(far)
    other.off[:] = np.random.default_rng(0).uniform(-1.0, 1.0, other.off.shape)
    for work in (one, other):
        work.bounds[0], work.bounds[1] = (-4.0, -4.0, -2.0, 2.0), (4.0, 4.0, 2.0, 25.0)
        assert plan(work, CALM, 100) == PLANNED
    assert other.x[:, :6] == pytest.approx(one.x[:, :6], abs=0.01)


@pytest.mark.parametrize("elapsed", [0.0, 0.004, 0.1])
def test_the_plan_is_carried_on_to_the_same_moments(elapsed):
    work = room(P, GRID)
    work.off[:] = np.outer(GRID[:, 4], (1.0, -2.0, 0.5, 3.0)) + 1.0
    end = work.off[-1].copy()
    carry_on(work, elapsed)
    inside = GRID[:, 4] + elapsed <= GRID[-1, 4]
    assert work.off[inside] == pytest.approx(np.outer(GRID[inside, 4] + elapsed, (1.0, -2.0, 0.5, 3.0)) + 1.0)
    assert work.off[~inside] == pytest.approx(np.tile(end, ((~inside).sum(), 1)))


def test_the_steps_begin_with_a_tick_and_fill_the_horizon():
    assert GRID[0, 0] == 0.004
    assert GRID[:, 0].sum() == pytest.approx(0.6)
    assert (np.diff(GRID[:, 0]) > 0.0).all()
