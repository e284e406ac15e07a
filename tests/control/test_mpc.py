"""The parts of the model-predictive controller against slower ways to the same numbers, and how it flies."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lag_plant import LagPlant, Lags, Noise, at_start, believing, fly, lemniscate, rmse
from numba.core.runtime import _nrt_python, rtsys

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.box_qp import minimise
from flightapp.control.errors import ControllerError
from flightapp.control.flatness import FlatnessController, flatness_command
from flightapp.control.mpc import Fallback, MpcController, carry_on, mpc_command
from flightapp.control.mpc_cost import REFERENCE, add_state_cost, input_weights, state_cost
from flightapp.control.mpc_model import CHANGES, INPUTS, STATE, TANGENT, difference, linearise, pull_back, step
from flightapp.control.mpc_solver import PLANNED, plan
from flightapp.control.mpc_work import STEPS, room, steps_of
from flightapp.control.parameters import parameters_of, unpacked
from flightapp.frames import GRAVITY, quat_from_euler, quat_from_rotvec, quat_multiply
from flightapp.jit import kernel, lean_kernel
from flightapp.messages import VehicleState
from flightapp.trajectory import hover

CONFIG = believing(Lags())
P = parameters_of(CONFIG)
NUMBERS = np.array(P)
UNTILTED = P._replace(tilt_cotangent=-1e3)
"""Without a limit of the tilt."""
CALM = (0.0, 0.0, 0.0)
GRID = steps_of(P, 0.004, 0.6)
REST = np.array([0.0, 0.0, 1.5])
PUSH = (0.3, -0.2, 0.0)


@kernel
def stepped(numbers, x, u, g, out):
    step(unpacked(numbers), x, u, g, (0.3, -0.2, 0.0), out)


@kernel
def derivatives(numbers, x, u, g, rows, out):
    j = np.zeros(CHANGES)
    linearise(unpacked(numbers), x, u, g, j)
    pull_back(j, g, rows, rows.shape[1], out)


@kernel
def between(x, y, out):
    difference(x, y, out)


@kernel
def cost_of(numbers, x, r, duration, last):
    return state_cost(unpacked(numbers), x, r, duration, last)


@kernel
def cost_derivatives(numbers, x, r, duration, last, value):
    add_state_cost(unpacked(numbers), x, r, duration, last, value)


@kernel
def weights_of(numbers, r):
    return input_weights(unpacked(numbers), r)


@kernel
def solved(H, g, low, high, x):
    return minimise(H, g, low, high, x, np.zeros(4), np.zeros((4, 4)), np.zeros((2, 4)))


@lean_kernel
def commands(m, work, n):
    total = 0.0
    for tick in range(1, n + 1):
        m[at.STAMP] = m[at.STATE] = 0.004 * tick
        total += flatness_command(m)
        ended, thrust = mpc_command(m, work, 0.004, 1)
        total += ended + thrust
    return total


def a_state(seed, tilt=0.6):
    rng = np.random.default_rng(seed)
    q = quat_from_rotvec(tilt * rng.standard_normal(3))
    return np.concatenate((rng.standard_normal(3), 4.0 * rng.standard_normal(3), q, rng.standard_normal(3), [14.0]))


def changed(x, change):
    """``x`` changed by a small ``change`` (13,)."""
    y = x + np.concatenate((change[:6], np.zeros(4), change[9:]))
    y[6:10] = quat_multiply(x[6:10], quat_from_rotvec(change[6:9]))
    return y


def after(x, u, g):
    out = np.zeros(STATE)
    stepped(NUMBERS, x, u, g, out)
    return out


def change_between(x, y):
    out = np.zeros(TANGENT)
    between(x, y, out)
    return out


def jacobian(x, u, g, h=1e-6):
    """(13, 17) derivatives of a step by state and input, from differences."""
    columns = []
    for i in range(TANGENT + INPUTS):
        ends = []
        for sign in (-h, h):
            e = np.zeros(TANGENT + INPUTS)
            e[i] = sign
            ends.append(after(changed(x, e[:TANGENT]), u + e[TANGENT:], g))
        columns.append(change_between(*ends) / (2.0 * h))
    return np.array(columns).T


def at_hover(x):
    """A reference row: to rest, level, at ``REST``."""
    return np.concatenate((REST, np.zeros(3), [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [GRAVITY, 1.0]))


@pytest.mark.parametrize(("k", "tolerance"), [(0, 1e-5), (12, 2e-4), (STEPS - 1, 5e-3)])
@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_a_step_are_those_of_differences(seed, k, tolerance):
    x, u = a_state(seed), np.array([1.0, -2.0, 0.5, 16.0])
    expected, found = jacobian(x, u, GRID[k]), np.zeros((TANGENT + INPUTS, TANGENT))
    derivatives(NUMBERS, x, u, GRID[k], np.eye(TANGENT), found)
    found = found.T
    assert found == pytest.approx(expected, abs=tolerance)


def test_a_change_leads_from_one_state_to_the_other():
    change = 1e-4 * np.random.default_rng(1).standard_normal(TANGENT)
    assert change_between(a_state(5), changed(a_state(5), change)) == pytest.approx(change, abs=1e-9)


def test_a_step_is_what_the_plant_does():
    plant = LagPlant(Lags(), REST.copy(), velocity=np.array([3.0, 0.0, 0.0]))
    x, u = np.zeros(STATE), np.array([2.0, -1.0, 0.5, 14.0])
    x[0:3], x[3:6], x[6:10], x[13] = plant.position, plant.velocity, plant.orientation, GRAVITY
    plant._command = u
    grid = steps_of(P, 0.002, 0.04)
    out = np.zeros(STATE)
    for g in grid:
        stepped(NUMBERS, x, u, g, out)
        x[:] = out
    plant.advance(0.04)
    # The push from outside is the only difference.
    x[0:3] -= 0.5 * 0.04**2 * np.array(PUSH)
    x[3:6] -= 0.04 * np.array(PUSH)
    flown = plant.state
    assert x[0:3] == pytest.approx(flown[0:3], abs=5e-4)
    assert x[3:6] == pytest.approx(flown[7:10], abs=2e-2)
    assert x[6:10] == pytest.approx(flown[3:7], abs=2e-3)
    assert x[10:14] == pytest.approx(flown[10:14], abs=1e-6)


@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("tilt", [0.2, 1.5])
def test_the_costs_slope_is_that_of_differences(last, tilt):
    x, r, h = a_state(2, tilt), np.zeros(REFERENCE), 1e-6
    r[:] = at_hover(x)
    r[13] = 0.7
    value, slope = np.zeros((TANGENT, TANGENT + 1)), np.zeros(TANGENT)
    cost_derivatives(NUMBERS, x, r, 0.02, last, value)
    for i in range(TANGENT):
        e = np.zeros(TANGENT)
        e[i] = h
        ends = [cost_of(NUMBERS, changed(x, sign * e), r, 0.02, last) for sign in (1.0, -1.0)]
        slope[i] = (ends[0] - ends[1]) / (2.0 * h)
    assert value[:, TANGENT] == pytest.approx(slope, rel=1e-4, abs=1e-5)
    assert np.linalg.eigvalsh(value[:, :TANGENT]).min() > -1e-9


@given(st.integers(0, 10**6))
@settings(max_examples=50)
def test_a_small_program_is_solved_as_by_trying_all_sets_of_bounds(seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((INPUTS, INPUTS))
    H, g = A @ A.T + 0.1 * np.eye(INPUTS), 3.0 * rng.standard_normal(INPUTS)
    low, high = -rng.uniform(0.0, 1.0, INPUTS), rng.uniform(0.0, 1.0, INPUTS)
    x = np.zeros(INPUTS)
    assert solved(H, g, low, high, x)
    assert (low <= x).all()
    assert (x <= high).all()
    best = np.inf
    for held in itertools.product((-1, 0, 1), repeat=INPUTS):
        y = np.where(np.array(held) < 0, low, high)
        free = np.array(held) == 0
        y[free] = np.linalg.solve(H[np.ix_(free, free)], -g[free] - H[np.ix_(free, ~free)] @ y[~free])
        if (y >= low - 1e-12).all() and (y <= high + 1e-12).all():
            best = min(best, y @ (0.5 * H @ y + g))
    assert x @ (0.5 * H @ x + g) == pytest.approx(best, abs=1e-9)


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
        Q = np.zeros((TANGENT, TANGENT + 1))
        cost_derivatives(NUMBERS, rest, level, GRID[k, 0], k == STEPS - 1, Q)
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


def state(stamp=0.0, position=REST, velocity=(0.0, 0.0, 0.0), q=(1.0, 0.0, 0.0, 0.0)):
    return VehicleState(stamp, np.array(position), np.array(q), np.array(velocity), np.zeros(3), np.zeros((9, 9)))


def triples(size):
    return st.tuples(*[st.floats(-size, size)] * 3)


BOUNDED = MpcController(Config())


@given(triples(1e4), triples(100.0), triples(1e4), st.tuples(*[st.floats(-1.0, 1.0)] * 4), st.floats(-9.0, 9.0))
def test_whatever_the_state_the_command_is_finite_and_bounded(position, velocity, goal, q, yaw):
    if np.linalg.norm(q) < 0.01:
        q = (1.0, 0.0, 0.0, 0.0)
    command = BOUNDED.command(0.0, state(0.0, position, velocity, q), hover(0.0, np.array(goal), yaw))
    vehicle = Config().vehicle
    assert (np.abs(command.rates) <= (vehicle.rate_max, vehicle.rate_max, vehicle.yaw_rate_max)).all()
    assert Config().guard.thrust_min <= command.thrust <= vehicle.thrust_max


def test_what_cannot_be_planned_is_left_to_the_flatness_controller_and_counted():
    controller, simple, line = MpcController(CONFIG), FlatnessController(CONFIG), hover(0.0, REST, 0.0)
    over = state(q=(0.0, 1.0, 0.0, 0.0))
    astray, expected = (c.command(0.0, over, line) for c in (controller, simple))
    assert (*astray.rates, astray.thrust) == (*expected.rates, expected.thrust)
    assert controller.fallbacks == {Fallback.ASTRAY: 1}
    controller._work.off[:] = np.nan
    assert np.isfinite(controller.command(0.004, state(0.004), line).thrust)
    assert controller.fallbacks == {Fallback.ASTRAY: 1, Fallback.NOT_FINITE: 1}
    controller.command(0.008, state(0.008), line)
    controller.command(0.108, state(0.108), line)
    assert controller.report == "1 of 4 commands planned; by flatness: astray 1, late 1, not finite 1"


def test_what_is_remembered_is_the_command_that_was_sent():
    controller, line = MpcController(CONFIG), lemniscate(5.0)
    for tick in range(20):
        stamp = 0.004 * tick
        command = controller.command(stamp, state(stamp), line)
        m = controller._memory
        e = at.HISTORY + ((int(m[at.COUNT]) - 1) & at.MASK) * at.ENTRY
        kept = m[e + at.ENTRY_COMMAND : e + at.ENTRY_COMMAND + 4]
        assert m[e + at.ENTRY_STAMP] == stamp + P.delay
        assert kept[:3] == pytest.approx(command.rates)
        assert kept[3] * (1.0 + m[at.TRIM]) == pytest.approx(command.thrust)
    assert not controller.fallbacks


def test_a_state_that_is_not_finite_never_becomes_a_command_and_leaves_no_trace():
    clean, troubled = MpcController(CONFIG), MpcController(CONFIG)
    line = hover(0.0, REST + np.array([0.5, 0.0, 0.3]), 0.0)
    for tick in range(12):
        stamp = 0.004 * tick
        if tick % 3 == 0:
            with pytest.raises(ControllerError):
                troubled.command(stamp, state(stamp, velocity=(np.nan, 0.0, 0.0)), line)
        one, other = (c.command(stamp, state(stamp), line) for c in (clean, troubled))
        assert np.array_equal(one.rates, other.rates)
        assert one.thrust == other.thrust


def test_a_tick_allocates_nothing():
    controller, line = MpcController(CONFIG), lemniscate(5.0)
    controller.command(0.0, state(), line)
    memory, work = controller._memory, controller._work
    commands(memory, work, 1)
    _nrt_python.memsys_enable_stats()
    try:
        counts = [rtsys.get_allocation_stats().alloc]
        for call in (lambda: commands(memory, work, 50), lambda: line.sample(0.0)):
            assert call() is not None
            counts.append(rtsys.get_allocation_stats().alloc)
    finally:
        _nrt_python.memsys_disable_stats()
    assert counts[1] == counts[0]
    assert counts[2] > counts[1]


def race(v_peak, real=None, noise=None, **control):
    trajectory = lemniscate(v_peak)
    controller = MpcController(believing(Lags(), **control))
    rows, references, _ = fly(controller, at_start(real or Lags(), trajectory), trajectory, trajectory.duration, noise)
    assert not controller.fallbacks
    return rmse(rows, references)


@pytest.mark.parametrize(("v_peak", "bound"), [(3.0, 0.001), (7.0, 0.003)])
def test_the_vehicle_it_believes_in_is_tracked_to_millimetres(v_peak, bound):
    assert race(v_peak) < bound


@pytest.mark.parametrize(
    "real", [Lags(thrust_factor=0.9), Lags(gust=0.3), Lags(rate_lag=0.06), Lags(delay=0.03)], ids=str
)
def test_a_vehicle_that_is_not_as_believed_stays_on_the_line(real):
    assert race(6.0, real=real) < 0.06


def test_noise_of_a_tracking_camera_does_not_shake_it():
    assert race(5.0, noise=Noise(0.01, 0.05, 0.01, age=5)) < 0.015


def settle(plant, seconds=4.0, **control):
    controller = MpcController(believing(plant.lags, **control))
    rows, references, commands = fly(controller, plant, hover(0.0, REST, 0.0), seconds)
    return np.linalg.norm(rows[:, 0:3] - references, axis=1), rows, commands


@pytest.mark.parametrize("roll", [0.5 * np.pi, np.pi], ids=["on its side", "upside down"])
def test_it_recovers_from_a_tumble(roll):
    plant = LagPlant(Lags(), REST + np.array([0.0, 0.0, 5.0]), quat_from_euler(roll, 0.0, 0.0))
    error, rows, _ = settle(plant, 8.0)
    assert error[-1] < 0.05
    assert rows[:, 2].min() > 1.0


def test_a_jump_of_the_estimate_is_flown_off_without_overshoot():
    error, rows, _ = settle(LagPlant(Lags(), REST + np.array([0.3, 0.0, 0.0])))
    assert error[-250:].max() < 0.01
    assert rows[:, 0].min() > -0.03


def test_wrong_thrust_and_a_steady_push_leave_no_error():
    error, _, commands = settle(LagPlant(Lags(thrust_factor=0.85), REST.copy()), 12.0)
    assert error[-1] < 0.005
    assert commands[-1].thrust == pytest.approx(GRAVITY / 0.85, rel=0.01)
