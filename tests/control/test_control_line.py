"""The packed trajectory and the heading's direction against the plain ones."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lag_plant import lemniscate

from flightapp.config import Config
from flightapp.control.flatness import control_memory
from flightapp.control.line import direction, heading, reference
from flightapp.control.parameters import parameters_of
from flightapp.jit import lean_kernel

LINE = lemniscate(5.0)
P = parameters_of(Config())


@lean_kernel
def read(m, t):
    return reference(m, t)


@lean_kernel
def read_heading(m, t, lead):
    return heading(m, t, lead)


@given(st.lists(st.floats(-1.0, LINE.duration + 1.0), min_size=1, max_size=5))
def test_the_packed_line_is_the_trajectory_wherever_it_was_read_before(times):
    memory = control_memory(P, LINE)
    for t in times:
        sample = LINE.sample(t)
        found = read(memory, t)
        parts = (sample.position, sample.velocity, sample.acceleration, sample.jerk, sample.snap)
        for part, tolerance, expected in zip(found, (1e-9, 1e-9, 1e-8, 1e-7, 1e-5), parts, strict=True):
            assert part == pytest.approx(expected, abs=tolerance, rel=1e-9)
        yaw, rate = read_heading(memory, t, 0.1)
        assert yaw == pytest.approx(sample.yaw)
        assert rate == pytest.approx(LINE.sample(t + 0.1).yaw_rate, abs=1e-9)


@given(st.floats(-50.0, 50.0))
def test_the_direction_of_an_angle(angle):
    assert direction(angle) == pytest.approx((math.cos(angle), math.sin(angle)), abs=1e-6)
