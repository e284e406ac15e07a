"""The commands of the model-predictive controller, and when another's are sent."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lag_plant import lemniscate
from numba.core.runtime import _nrt_python, rtsys
from planned import CONFIG, REST, P, state

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.errors import ControllerError
from flightapp.control.flatness import FlatnessController, flatness_command
from flightapp.control.mpc import Fallback, MpcController, mpc_command
from flightapp.jit import lean_kernel
from flightapp.trajectory import hover


@lean_kernel
def commands(m, work, n):
    total = 0.0
    for tick in range(1, n + 1):
        m[at.STAMP] = m[at.STATE] = 0.004 * tick
        total += flatness_command(m)
        ended, thrust = mpc_command(m, work, 0.004, 1)
        total += ended + thrust
    return total


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
