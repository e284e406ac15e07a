"""Keeping clear of frames and obstacles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.messages import GateEstimate
from flightapp.planning.clearance import STEP, TOLERANCE, touched
from flightapp.planning.obstacles import Margins, distance, packed
from flightapp.track import FRAME_THICKNESS, Box, Cylinder, GateShape
from flightapp.trajectory import hover

SHAPE = GateShape()
RADIUS = 0.2
BARE = Margins(RADIUS, 0.0, 0.0)
WANTED = Margins(RADIUS, 0.3, 0.05)
PILLAR = Cylinder(name="pillar", base=(0.0, 0.0, 0.0), radius=0.4, height=4.0)
WALL = Box(name="wall", centre=(4.0, 0.0, 1.0), size=(0.2, 4.0, 2.0))


def straight(start, velocity, duration=4.0):
    line = hover(0.0, np.array(start), 0.0, duration)
    line.coefficients[0, :, 1] = velocity
    return line


def gate(yaw=0.0, position=(0.0, 0.0, 1.5)):
    return GateEstimate(7, np.array(position), yaw, np.zeros((4, 4)), 9, 0.0)


def frame_touched(line, *gates):
    found = touched(line, gates, SHAPE, (), BARE)
    return None if found is None else found.name


FRAME = "the frame of gate 7"


@pytest.mark.parametrize(
    ("y", "expected"), [(0.0, None), (0.45, None), (0.55, FRAME), (0.9, FRAME), (1.25, FRAME), (1.35, None)]
)
def test_the_frame_lies_between_opening_and_outer_edge(y, expected):
    assert frame_touched(straight((-2.0, y, 1.5), (1.0, 0.0, 0.0)), gate()) == expected
    assert frame_touched(straight((-2.0, 0.0, 1.5 + y), (1.0, 0.0, 0.0)), gate()) == expected


def test_turning_off_right_behind_the_gate_touches_it():
    assert frame_touched(straight((0.1, 0.0, 1.5), (0.0, 1.0, 0.0)), gate()) == FRAME
    assert frame_touched(straight((0.5, 0.0, 1.5), (0.0, 1.0, 0.0)), gate()) is None


def test_a_start_in_the_frame_may_leave_it():
    assert frame_touched(straight((0.0, 0.9, 1.5), (1.0, 0.0, 0.0)), gate()) is None


@given(st.floats(-math.pi, math.pi), st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_straight_through_the_middle_is_clear_wherever_the_gate_stands(yaw, x, y):
    along = np.array((math.cos(yaw), math.sin(yaw), 0.0))
    centre = np.array((x, y, 2.0))
    assert frame_touched(straight(centre - 2.0 * along, along), gate(yaw, centre)) is None


@pytest.mark.parametrize("speed", [0.5, 2.0, 20.0])
def test_the_closest_approach_is_told_with_time_distance_and_what_is_wanted(speed):
    line = straight((-2.0, 0.7, 1.5), (speed, 0.0, 0.0), 8.0 / speed)
    found = touched(line, (), None, (PILLAR,), WANTED)
    assert found is not None
    assert found.name == "'pillar'"
    assert found.time == pytest.approx(2.0 / speed, abs=STEP / speed)
    assert found.gap == pytest.approx(0.1, abs=2e-3)
    assert str(found) == f"comes within 0.10 m of 'pillar' at {found.time:.1f} s, 0.30 m are wanted"


def test_what_is_flown_into_is_told_so():
    found = touched(straight((-2.0, 0.5, 1.5), (1.0, 0.0, 0.0)), (), None, (PILLAR, WALL), WANTED)
    assert str(found) == "leads into 'pillar' at 2.0 s"
    over_it = straight((-2.0, 0.0, 4.6), (2.0, 0.0, 0.0))
    assert touched(over_it, (), None, (PILLAR, WALL), WANTED) is None
    assert touched(over_it, (), None, (PILLAR, WALL), Margins(RADIUS, 0.45, 0.0)) is not None


def test_the_first_thing_on_the_way_is_told_not_the_worst():
    line = straight((-2.0, 0.85, 1.5), (2.0, 0.0, 0.0))
    found = touched(line, (), None, (WALL, PILLAR), WANTED)
    assert found is not None
    assert found.name == "'pillar'"
    found = touched(line, (), None, (WALL,), WANTED)
    assert str(found) == f"leads into 'wall' at {found.time:.1f} s"


def test_frames_and_obstacles_have_clearances_of_their_own():
    beside = straight((-2.0, 0.47, 1.5), (1.0, 0.0, 0.0))
    found = touched(beside, (gate(),), SHAPE, (), WANTED)
    assert str(found) == f"comes within 0.03 m of {FRAME} at {found.time:.1f} s, 0.05 m are wanted"
    assert touched(beside, (gate(),), SHAPE, (), BARE) is None
    assert touched(beside, (gate(),), None, (), WANTED) is None


def test_a_start_that_is_too_close_may_leave_but_not_touch_nor_come_back():
    start = (-0.7, 0.0, 1.5)
    assert touched(straight(start, (-1.0, 0.0, 0.0)), (), None, (PILLAR,), WANTED) is None
    into = touched(straight(start, (1.0, 0.0, 0.0)), (), None, (PILLAR,), WANTED)
    assert str(into).startswith("leads into 'pillar'")
    loop = straight(start, (-2.0, 0.0, 0.0), 2.0)
    loop.coefficients[0, 0, 2] = 1.0
    assert str(touched(loop, (), None, (PILLAR,), WANTED)).startswith("comes within 0.10 m of 'pillar'")


@given(st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 1.5), st.floats(0.5, 4.5), st.floats(0.2, 15.0))
def test_verdict_is_that_of_a_dense_look(angle, aside, height, speed):
    c, s = math.cos(angle), math.sin(angle)
    line = straight((-4 * c - aside * s, -4 * s + aside * c, height), (speed * c, speed * s, 0.0), 8.0 / speed)
    rows = packed((PILLAR,), (), None, WANTED)
    gradient = np.empty(3)
    path = line.sample(np.linspace(0.0, line.duration, 2001)).position
    gap = min(distance(p, rows, 0, gradient) for p in path) - RADIUS
    found = touched(line, (), None, (PILLAR,), WANTED)
    if gap > WANTED.obstacle - TOLERANCE:
        assert found is None
    elif gap < WANTED.obstacle - TOLERANCE - 2e-3:
        assert found is not None
        assert found.gap == pytest.approx(gap, abs=4e-3 if gap > 0.0 else 0.05)


def test_thin_frames_are_not_jumped_over_at_speed():
    line = straight((-3.0, 0.9, 1.5), (40.0, 0.0, 0.0), 0.15)
    assert FRAME_THICKNESS < 40.0 * 0.02
    assert frame_touched(line, gate()) == FRAME
