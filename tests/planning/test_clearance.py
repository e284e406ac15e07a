"""Keeping clear of frames."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.messages import GateEstimate
from flightapp.planning.clearance import touched_frame
from flightapp.track import GateShape
from flightapp.trajectory import Trajectory, hover

SHAPE = GateShape()
RADIUS = 0.2


def straight(start, velocity, duration=4.0):
    line = hover(0.0, np.array(start), 0.0, duration)
    line.coefficients[0, :, 1] = velocity
    return line


def gate(yaw=0.0, position=(0.0, 0.0, 1.5)):
    return GateEstimate(7, np.array(position), yaw, np.zeros((4, 4)), 9, 0.0)


def touched(line: Trajectory, *gates):
    found = touched_frame(line, gates, SHAPE, RADIUS)
    return None if found is None else found.gate_id


@pytest.mark.parametrize(("y", "expected"), [(0.0, None), (0.45, None), (0.55, 7), (0.9, 7), (1.25, 7), (1.35, None)])
def test_the_frame_lies_between_opening_and_outer_edge(y, expected):
    assert touched(straight((-2.0, y, 1.5), (1.0, 0.0, 0.0)), gate()) == expected
    assert touched(straight((-2.0, 0.0, 1.5 + y), (1.0, 0.0, 0.0)), gate()) == expected


def test_turning_off_right_behind_the_gate_touches_it():
    assert touched(straight((0.1, 0.0, 1.5), (0.0, 1.0, 0.0)), gate()) == 7
    assert touched(straight((0.5, 0.0, 1.5), (0.0, 1.0, 0.0)), gate()) is None


def test_a_start_in_the_frame_may_leave_it():
    assert touched(straight((0.0, 0.9, 1.5), (1.0, 0.0, 0.0)), gate()) is None


@given(st.floats(-math.pi, math.pi), st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_straight_through_the_middle_is_clear_wherever_the_gate_stands(yaw, x, y):
    along = np.array((math.cos(yaw), math.sin(yaw), 0.0))
    centre = np.array((x, y, 2.0))
    assert touched(straight(centre - 2.0 * along, along), gate(yaw, centre)) is None
