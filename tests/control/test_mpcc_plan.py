"""Plans of the contouring controller, against slower ways to the same, and the bounds of its progress."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planned import CALM, CONFIG, GRID, REST, P, a_state, at_hover, changed

from flightapp.control.mpc_solver import PLANNED
from flightapp.control.mpcc import carry_on, gained
from flightapp.control.mpcc_cost import REFERENCE, add_state_cost, state_cost
from flightapp.control.mpcc_horizon import rate_bounds, stiffness
from flightapp.control.mpcc_solver import RATE, plan
from flightapp.control.mpcc_work import TANGENT, Contour, contour_of, room
from flightapp.control.parameters import unpacked
from flightapp.control.riccati import WIDE
from flightapp.frames import GRAVITY
from flightapp.jit import kernel

NUMBERS = np.array(P)
C = contour_of(CONFIG.mpcc, P.kp_xy, 1.0)
TOP, SPEED = 8.0, 4.0


@kernel
def cost_of(numbers, x, r, duration, last):
    return state_cost(unpacked(numbers), x, r, duration, last)


@kernel
def cost_derivatives(numbers, x, r, duration, last, value):
    add_state_cost(unpacked(numbers), x, r, duration, last, value)


@kernel
def bounds_of(c, top, speed, lead, over):
    return rate_bounds(Contour(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9]), top, speed, lead, over)


@kernel
def stiffness_of(c, line, first, t, speed):
    return stiffness(Contour(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9]), line, first, t, speed)


def along_x(t, speed=SPEED, stiff=1.3):
    """A reference row: along x at a constant speed, level."""
    row = np.zeros(REFERENCE)
    row[:14] = at_hover(None)
    row[0], row[3], row[17], row[18], row[19] = speed * t, speed, t, stiff, 1.0
    return row


@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_the_costs_slope_is_that_of_differences(last, seed):
    rng, h = np.random.default_rng(seed), 1e-6
    r = along_x(1.0)
    r[3:6], r[14:17] = 4.0 * rng.standard_normal(3), 8.0 * rng.standard_normal(3)
    r[19:22] = r[3:6] / np.linalg.norm(r[3:6])
    x = np.concatenate(([1.05, 0.9], a_state(seed)))
    value, slope = np.zeros((TANGENT, WIDE)), np.zeros(TANGENT)
    cost_derivatives(NUMBERS, x, r, 0.02, last, value.ravel())
    for i in range(TANGENT):
        ends = []
        for sign in (-h, h):
            e = np.zeros(TANGENT)
            e[i] = sign
            ends.append(cost_of(NUMBERS, np.concatenate((x[:2] + e[:2], changed(x[2:], e[2:]))), r, 0.02, last))
        slope[i] = (ends[1] - ends[0]) / (2.0 * h)
    assert value[:, TANGENT] == pytest.approx(slope, rel=1e-4, abs=1e-4)
    assert value[:, :TANGENT] == pytest.approx(value[:, :TANGENT].T)
    assert np.linalg.eigvalsh(value[:, :TANGENT]).min() > -1e-7


def on_the_way(lag=0.0, low=0.7, high=1.2):
    """A horizon along x at the line's own rate, with the vehicle ``lag`` m behind."""
    work = room(P._replace(tilt_cotangent=-1e3, drag_x=0.0, drag_y=0.0, drag_z=0.0), C, GRID)
    work.bounds[:, 0, :4], work.bounds[:, 1, :4] = -30.0, 30.0
    work.bounds[:, 0, RATE], work.bounds[:, 1, RATE] = low, high
    work.asked[:, 3] = GRAVITY
    for k, end in enumerate(np.cumsum(GRID[:, 0])):
        work.reference[k + 1] = along_x(end)
    work.x[0, 1:9] = 1.0, -lag, 0.0, REST[2], SPEED, 0.0, 0.0, 1.0
    work.x[0, 15] = GRAVITY
    return work


def test_the_progress_of_a_plan_keeps_to_its_bounds_and_meets_them():
    work = on_the_way(high=1.05)
    for _ in range(30):
        assert plan(work, CALM, 1) == PLANNED
        assert (work.u[:, RATE] >= 0.7).all()
        assert (work.u[:, RATE] <= 1.05).all()
    assert work.u[-1, RATE] > 1.04
    assert work.x[-1, 0] == pytest.approx(0.5 * GRID[:, 0] @ (work.x[:-1, 1] + work.x[1:, 1]))
    assert work.x[-1, 5] > SPEED


def test_the_progress_waits_for_a_vehicle_that_is_behind():
    behind, beside = on_the_way(lag=0.5, high=1.0), on_the_way(high=1.0)
    for _ in range(30):
        plan(behind, CALM, 1)
        plan(beside, CALM, 1)
    assert behind.rates[1:].min() < 0.97
    assert beside.rates[1:] == pytest.approx(np.ones(len(GRID)), abs=1e-3)


def test_plans_come_to_an_end_at_one_whatever_they_begin_with():
    one, other = on_the_way(0.2), on_the_way(0.2)
    rng = np.random.default_rng(0)
    other.off[:] = rng.uniform(-1.0, 1.0, other.off.shape)
    other.rates[1:] = rng.uniform(0.8, 1.1, len(GRID))
    for work in (one, other):
        assert plan(work, CALM, 200) == PLANNED
    assert other.rates == pytest.approx(one.rates, abs=0.01)
    assert other.x[:, 2:8] == pytest.approx(one.x[:, 2:8], abs=0.01)


@given(st.floats(0.0, 12.0), st.floats(-3.0, 3.0), st.booleans())
def test_the_progress_is_never_too_fast_and_comes_back_from_far(speed, lead, over):
    low, high = bounds_of(np.array(C), TOP, speed, lead, over)
    assert C.rate_min <= low <= high <= C.rate_max
    if not over and speed <= TOP:
        assert high * speed <= TOP + 1e-9
    far = min(C.ahead, C.reach / max(speed, 0.3))
    if lead > max(far, 0.0):
        assert high <= 1.0
    if over and lead < 0.0:
        assert low >= 1.0


def test_bandwidths_are_greatest_in_the_gates():
    line = np.array((TOP, 1.0, 3.0))
    shares = [stiffness_of(np.array(C), line, 1, t, SPEED)[0] for t in (-9.0, 0.8, 1.0, 2.0, 3.0, 12.0)]
    assert shares[0] == pytest.approx(C.away, abs=1e-3)
    assert shares[2] == shares[4] == pytest.approx(C.near)
    assert C.away < shares[3] < shares[1] < C.near
    assert shares[5] == pytest.approx(C.away, abs=1e-3)
    assert stiffness_of(np.array(C), line[:1], 1, 1.0, SPEED)[0] == C.away


@pytest.mark.parametrize("elapsed", [0.0, 0.004, 0.1, 0.9])
def test_progress_carried_on_is_that_planned(elapsed):
    ends = np.append(0.0, np.cumsum(GRID[:, 0]))
    work = room(P, C, GRID)
    work.rates[:] = 1.0 - 0.3 * ends
    expected = 0.15 * min(elapsed, 0.6) ** 2 + max(elapsed - 0.6, 0.0) * 0.18
    assert gained(work.rates, GRID, elapsed) == pytest.approx(-expected, abs=1e-9)
    carry_on(work, elapsed)
    assert work.rates == pytest.approx(1.0 - 0.3 * np.minimum(ends + elapsed, 0.6))
    assert math.isclose(work.rates[-1], 0.82)
