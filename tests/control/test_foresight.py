"""The closed form against the same model from command to command."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_prediction import P, flown, motion

from flightapp.control import layout as at
from flightapp.control.flatness import control_memory
from flightapp.control.foresight import decays, foresee, lagged_at, newest, remember
from flightapp.control.prediction import predict
from flightapp.jit import lean_kernel
from flightapp.trajectory import hover

CALM = (0.0, 0.0, 0.0)


@lean_kernel
def replay(m, history, count):
    """Remember so many commands of a ``history`` (n, 6)."""
    for k in range(count):
        value = (0.0, 0.0, 0.0, 9.80665)
        total = (0.0, 0.0, 0.0, 0.0)
        if k:
            value, total = lagged_at(P, m, newest(m, history[k, 0]), history[k, 0])
        remember(m, history[k, 0], (history[k, 1], history[k, 2], history[k, 3], history[k, 4]), value, total)


@lean_kernel
def foreseen(m, start, end, position, velocity, q, rates):
    known = lagged_at(P, m, newest(m, start), start)
    return foresee(P, m, (position, velocity, q, rates), start, end, known, (P.drag_x, P.drag_y, P.drag_z), CALM)


def replayed(history, count):
    m = control_memory(P, hover(0.0, np.zeros(3), 0.0))
    replay(m, history, count)
    return m


@pytest.mark.parametrize("ahead", [0.001, 0.015, 0.033, 0.1])
def test_it_foresees_what_the_step_by_step_prediction_does(ahead):
    states, history = flown()
    start = 0.2
    first = motion(states[200])
    position, velocity, q, _, thrust = predict(P, first, start, start + ahead, history, 80)
    seen = foreseen(replayed(history, 80), start, start + ahead, *first[:4])
    assert seen[0] == pytest.approx(position, abs=1e-3)
    assert seen[1] == pytest.approx(velocity, abs=0.03)
    assert seen[2] == pytest.approx(q, abs=4e-3)
    assert seen[4][3] == pytest.approx(thrust, abs=0.02)


def test_before_the_oldest_command_all_stays_as_it_was():
    m = control_memory(P, hover(0.0, np.zeros(3), 0.0))
    told = np.array([[1.0, 0.0, 0.0, 0.5, 9.80665, 9.80665]])
    replay(m, told, 1)
    seen = foreseen(m, 0.9, 1.0, CALM, CALM, (1.0, 0.0, 0.0, 0.0), CALM)
    assert seen[2] == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-12)
    assert seen[4] == pytest.approx((0.0, 0.0, 0.0, 9.80665))


@given(st.tuples(*[st.floats(0.0, 60.0)] * 3))
def test_the_decays_are_nearly_the_exponential(x):
    near = np.array(x) / 60.0
    assert decays(*near) == pytest.approx(np.exp(-near), abs=1e-4)
    assert decays(*x) == pytest.approx(np.exp(-np.array(x)), abs=3e-3)
    assert all(0.0 < share < 1.0 + 1e-12 for share in decays(*x))


def test_a_ring_that_has_gone_round_is_read_in_order():
    _, history = flown(60)
    early = np.tile([0.0, 0.0, 0.0, 0.0, 9.80665, 9.80665], (at.ROWS + 20, 1))
    early[:, 0] = np.linspace(-2.0, -0.5, len(early))
    round_it = np.vstack((early, history[:60]))
    first = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    straight = foreseen(replayed(history, 60), 0.15, 0.2, *first)
    turned = foreseen(replayed(round_it, len(round_it)), 0.15, 0.2, *first)
    for a, b in zip(straight[:5], turned[:5], strict=True):
        assert a == pytest.approx(b, abs=1e-4)
