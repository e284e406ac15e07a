from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.runtime import _nrt_python, rtsys

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.attitude import limited
from flightapp.control.flatness import ControllerError, FlatnessController, control_memory, flatness_command
from flightapp.control.parameters import parameters_of
from flightapp.messages import VehicleState
from flightapp.trajectory import hover

UPRIGHT, REST = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
CONFIG = Config()
CONTROLLER = FlatnessController(CONFIG)


def state(position=REST, orientation=UPRIGHT, velocity=REST, rates=REST, stamp=0.0):
    arrays = (np.array(value, float) for value in (position, orientation, velocity, rates))
    return VehicleState(stamp, *arrays, np.zeros((9, 9)))


def triples(size):
    return st.tuples(*[st.floats(-size, size)] * 3)


@given(
    triples(1e4),
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.01),
    triples(200.0),
    triples(60.0),
    triples(1e4),
    st.floats(-20.0, 20.0),
    st.floats(0.0, 0.2),
)
def test_whatever_the_state_the_command_is_finite_and_bounded(position, q, velocity, rates, goal, yaw, age):
    seen = state(position, q, velocity, rates)
    command = CONTROLLER.command(age, seen, hover(0.0, np.array(goal), yaw))
    vehicle = CONFIG.vehicle
    assert np.hypot(*command.rates[:2]) <= vehicle.rate_max * (1.0 + 1e-12)
    assert abs(command.rates[2]) <= vehicle.yaw_rate_max
    assert CONFIG.guard.thrust_min <= command.thrust <= vehicle.thrust_max
    assert command.stamp == age


@given(st.sampled_from(["position", "orientation", "velocity", "rates"]), st.data())
def test_a_state_that_is_not_finite_never_becomes_a_command(part, data):
    values = {"position": [0.0] * 3, "orientation": [1.0, 0.0, 0.0, 0.0], "velocity": [0.0] * 3, "rates": [0.0] * 3}
    bad = data.draw(st.sampled_from([np.nan, np.inf, -np.inf]))
    values[part][data.draw(st.integers(0, len(values[part]) - 1))] = bad
    with pytest.raises(ControllerError, match="not finite"):
        CONTROLLER.command(0.0, state(**values), hover(0.0, REST, 0.0))


def test_an_attitude_without_direction_is_refused():
    with pytest.raises(ControllerError):
        CONTROLLER.command(0.0, state(orientation=np.zeros(4)), hover(0.0, REST, 0.0))


@pytest.mark.parametrize("stamp", [0.3, -0.3, np.nan, np.inf])
def test_a_state_too_old_to_be_bridged_is_refused(stamp):
    with pytest.raises(ControllerError, match="s old"):
        CONTROLLER.command(stamp, state(), hover(0.0, REST, 0.0))


@pytest.mark.parametrize("part", ["knots", "coefficients", "yaw_knots", "yaw_coefficients"])
def test_a_trajectory_that_is_not_finite_is_refused_and_the_next_one_flown(part):
    good = hover(0.0, REST, 0.0)
    broken = getattr(good, part).copy()
    broken.flat[-1] = np.nan
    with pytest.raises(ControllerError, match="trajectory"):
        CONTROLLER.command(0.0, state(), replace(good, **{part: broken}))
    assert np.isfinite(CONTROLLER.command(0.0, state(), good).thrust)


@given(st.floats(11.0, 80.0), triples(100.0))
def test_no_thrust_limit_leaves_less_than_nothing_across(most, force):
    parameters = parameters_of(CONFIG)._replace(thrust_max=most)
    kept, share = limited(parameters, (force[0], force[1], 2.0 * most), 1.0)
    assert 0.0 <= share <= 1.0
    assert np.linalg.norm(kept) <= most * (1.0 + 1e-12)


def test_numbers_that_turn_out_not_finite_are_not_remembered():
    m = control_memory(parameters_of(CONFIG), hover(0.0, np.array([0.0, 0.0, 1.0]), 0.0))
    flatness_command(m)
    count = m[at.COUNT]
    m[at.LINE + 2] = np.nan
    assert np.isnan(flatness_command(m))
    assert m[at.COUNT] == count
    m[at.LINE + 2] = 0.0
    assert np.isfinite(flatness_command(m))


def test_a_refused_state_leaves_no_trace():
    clean, troubled = FlatnessController(CONFIG), FlatnessController(CONFIG)
    line = hover(0.0, np.array([0.5, 0.0, 1.0]), 0.0)
    for tick in range(20):
        stamp = 0.004 * tick
        if tick % 3 == 0:
            with pytest.raises(ControllerError):
                troubled.command(stamp, state(velocity=[np.nan, 0.0, 0.0], stamp=stamp), line)
        expected, found = (c.command(stamp, state(stamp=stamp), line) for c in (clean, troubled))
        assert np.array_equal(expected.rates, found.rates)
        assert expected.thrust == found.thrust


def test_no_array_layout_makes_it_compile_in_flight():
    compiled = len(flatness_command.signatures)
    line = hover(0.0, REST, 0.0)
    frozen = line.coefficients.copy()
    frozen.setflags(write=False)
    strided = np.zeros((1, 3, 16))[:, :, ::2]
    for coefficients in (frozen, strided, np.asfortranarray(line.coefficients), line.coefficients.astype(np.float32)):
        odd = VehicleState(0.0, np.zeros(6)[::2], UPRIGHT.astype(np.float32), REST, REST, np.zeros((9, 9)))
        CONTROLLER.command(0.0, odd, replace(line, coefficients=coefficients))
    assert len(flatness_command.signatures) == compiled


def test_commands_do_not_share_memory():
    line = hover(0.0, np.array([1.0, 2.0, 3.0]), 0.0)
    first = CONTROLLER.command(0.0, state(), line)
    kept = first.rates.copy()
    CONTROLLER.command(0.004, state([5.0, -5.0, 2.0]), line)
    assert np.array_equal(first.rates, kept)


def test_a_tick_allocates_nothing():
    line = hover(0.0, REST, 0.0)
    memory = control_memory(parameters_of(CONFIG), line)
    flatness_command(memory)
    line.sample(0.0)
    _nrt_python.memsys_enable_stats()
    try:
        counts = [rtsys.get_allocation_stats().alloc]
        for call in (lambda: flatness_command(memory), lambda: line.sample(0.0)):
            call()
            counts.append(rtsys.get_allocation_stats().alloc)
    finally:
        _nrt_python.memsys_disable_stats()
    assert counts[1] == counts[0]
    assert counts[2] > counts[1]
