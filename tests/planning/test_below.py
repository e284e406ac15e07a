"""What stands below a place."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.interfaces import Limits, Motion, PlanRequest
from flightapp.messages import GateEstimate
from flightapp.planning.below import ASIDE, Below
from flightapp.planning.braking import Brakes
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.track import Box, Cylinder, Gate, GateShape, Start, Track

CONFIG = load_config()
BRAKES = Brakes(CONFIG)
SHAPE = GateShape(opening=1.4, border=0.4, layout="top")
TRACK = Track(
    name="below",
    start=Start(position=(0.0, 0.0, 0.0)),
    finish=(20.0, 0.0, 1.5),
    gate=SHAPE,
    gates=(Gate(id=1, position=(6.0, 0.0, 1.5), yaw_deg=0.0, markers=(0,)),),
    obstacles=(
        Box(name="table", centre=(12.0, 0.0, 0.5), size=(1.0, 2.0, 1.0)),
        Cylinder(name="lamp", base=(15.0, 0.0, 4.0), radius=0.3, height=1.0),
        Cylinder(name="post", base=(0.0, 5.0, 0.0), radius=0.3, height=1.0),
    ),
)
WIDE = CONFIG.vehicle.radius + ASIDE
FRAME = WIDE + CONFIG.planning.frame_clearance
OBSTACLE = WIDE + CONFIG.planning.clearance


def gate(sigma=1e-6, yaw=0.0, sightings=9):
    return GateEstimate(1, np.array((6.0, 0.0, 1.5)), yaw, sigma**2 * np.eye(4), sightings, 0.0)


def what(place, *gates):
    return Below(CONFIG, TRACK, gates).what(np.array(place, float))


def test_in_a_gates_opening_its_frame_is_below_and_beside_it_nothing():
    assert what((6.0, 0.0, 1.5), gate()) == "the frame of gate 1"
    assert what((6.0 + 0.9 * FRAME, 0.0, 1.5), gate()) == "the frame of gate 1"
    assert what((6.1 + FRAME, 0.0, 1.5), gate()) == ""
    assert what((6.0, 1.2 + FRAME, 1.5), gate()) == ""
    assert what((6.0, 0.0, 1.5)) == ""


def test_what_is_not_known_of_a_gate_makes_it_wider_but_one_that_may_be_anywhere_counts_for_nothing():
    place = (6.2 + FRAME, 0.0, 1.5)
    assert what(place, gate()) == ""
    assert what(place, gate(sigma=0.2)) == "the frame of gate 1"
    assert what((6.0, 0.0, 1.5), gate(sigma=5.0)) == ""


def test_obstacles_count_where_they_stand_below_and_not_where_they_hang_above():
    assert what((12.0, 0.0, 3.0)) == "'table'"
    assert what((12.4 + OBSTACLE, 0.0, 3.0)) == "'table'"
    assert what((12.6 + OBSTACLE, 0.0, 3.0)) == ""
    assert what((15.0, 0.0, 1.5)) == ""
    assert what((15.0, 0.0, 6.0)) == "'lamp'"
    assert what((0.0, 5.0 + 0.2 + OBSTACLE, 2.0)) == "'post'"
    assert what((0.0, 5.0 + 0.4 + OBSTACLE, 2.0)) == ""


@settings(deadline=None, max_examples=50)
@given(st.floats(-math.pi, math.pi), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_a_turned_gate_is_a_gate_seen_from_elsewhere(yaw, along, across):
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    place = np.array((6.0, 0.0)) + turn @ (along, across)
    straight = Below(CONFIG, TRACK, (gate(),)).free(np.array([[6.0 + along, across, 1.5]]))
    turned = Below(CONFIG, TRACK.model_copy(update={"obstacles": ()}), (gate(yaw=yaw),)).free(np.array([[*place, 1.5]]))
    if abs(abs(along) - 0.025 - FRAME) > 1e-6 and abs(abs(across) - 1.1 - FRAME) > 1e-6:
        assert straight[0] == turned[0]


def flight():
    """Straight through the gate and over the table to rest behind them."""
    rest = Motion(np.array((0.0, 0.0, 1.5)), *np.zeros((3, 3)), 0.0, 0.0)
    limits = Limits(4.0, 8.0, 3.0)
    end = np.array((20.0, 0.0, 1.5))
    return PolynomialPlanner(CONFIG).through(np.array([end]), PlanRequest(10.0, rest, (), end, limits)), limits


LINE, LIMITS = flight()
BELOW = Below(CONFIG, TRACK, (gate(),))


@pytest.mark.parametrize("share", np.linspace(0.02, 0.98, 25).tolist())
def test_braking_ends_where_nothing_stands_below_and_as_soon_as_it_can(share):
    stamp = LINE.stamp + share * LINE.duration
    plain, clear = BRAKES.brake(LINE, stamp, LIMITS), BRAKES.brake(LINE, stamp, LIMITS, BELOW.free)
    if plain is None or clear is None:
        assert plain is clear
        return
    place, over = (braked.sample(braked.duration).position for braked in (clear, plain))
    assert BELOW.what(place) == ""
    if BELOW.what(over) == "":
        np.testing.assert_allclose(place, over)
    else:
        assert clear.stamp >= stamp
        assert BELOW.what(place - (0.25, 0.0, 0.0)) != ""
        assert clear.limits().acceleration <= 1.02 * LIMITS.a_max


def test_where_nothing_is_free_any_more_it_stops_as_it_would_otherwise():
    nowhere = lambda places: np.zeros(len(places), bool)  # noqa: E731
    stamp = LINE.stamp + 0.4 * LINE.duration
    plain, clear = BRAKES.brake(LINE, stamp, LIMITS), BRAKES.brake(LINE, stamp, LIMITS, nowhere)
    assert (plain.stamp, plain.duration) == (clear.stamp, clear.duration)


def test_where_only_the_lines_end_is_free_it_is_flown_to_its_end():
    only_there = lambda places: places[:, 0] >= LINE.sample(LINE.duration).position[0]  # noqa: E731
    assert BRAKES.brake(LINE, LINE.stamp + 0.4 * LINE.duration, LIMITS, only_there) is None
