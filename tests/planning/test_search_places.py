"""Where to look for a gate from, and how to get round one."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.messages import GateEstimate
from flightapp.planning.search import LEAST_HEIGHT, SIDESTEP, Room, front, viewpoints, way_round
from flightapp.track import Box, Cylinder, GateShape, Start, Track

FENCE = (-12.0, -8.0, -1.0, 12.0, 8.0, 6.0)
CONFIG = load_config(
    None, {"geofence.corners": (FENCE[0:2], FENCE[3:5]), "geofence.floor": FENCE[2], "geofence.ceiling": FENCE[5]}
)
PILLAR = Cylinder(name="pillar", base=(5.0, 0.0, 0.0), radius=0.5, height=9.0)
WALL = Box(name="wall", centre=(-5.0, 0.0, 2.0), size=(0.2, 8.0, 4.0))
TRACK = Track(name="t", start=Start(position=(0.0, 0.0, 0.0)), waypoints=((1.0, 0.0, 1.0),), obstacles=(PILLAR, WALL))
EMPTY = TRACK.model_copy(update={"obstacles": ()})
SHAPE = GateShape()


def gate(x=0.0, y=0.0, yaw=0.0, z=1.5):
    return GateEstimate(1, np.array((x, y, z)), yaw, 0.01 * np.eye(4), 10, 0.0)


def room(track=EMPTY, *gates):
    return Room.of(CONFIG, track, gates)


@settings(max_examples=30)
@given(st.floats(-10.0, 10.0), st.floats(-6.0, 6.0), st.floats(-math.pi, math.pi), st.floats(2.0, 6.0))
def test_places_keep_within_the_geofence_and_clear_of_what_is_known(x, y, ahead, step):
    here = room(TRACK, gate(0.0, 3.0))
    for p in viewpoints(np.array((x, y, 1.5)), ahead, step, here):
        assert (np.array(FENCE[:3]) < p).all()
        assert (p < np.array(FENCE[3:])).all()
        assert p[2] >= LEAST_HEIGHT
        assert math.hypot(p[0] - 5.0, p[1]) > 0.5 + CONFIG.vehicle.radius
        assert abs(p[0] + 5.0) > 0.3 or abs(p[1]) > 4.3
        assert abs(p[0]) > 0.3 or not 0.7 < max(abs(p[1] - 3.0), abs(p[2] - 1.5)) < 1.1


def test_places_widen_and_come_near_every_part_of_the_geofence():
    places = np.array(list(viewpoints(np.array((2.0, 1.0, 1.5)), 0.3, 4.0, room())))
    far = np.hypot(places[:, 0] - 2.0, places[:, 1] - 1.0)
    assert far[:6] == pytest.approx(np.full(6, 4.0))
    assert (far[6:] > 4.0 + 1e-9).all()
    for corner in itertools.product((-11.0, 0.0, 11.0), (-7.0, 0.0, 7.0)):
        assert np.hypot(*(places[:, :2] - corner).T).min() < 4.0
    assert np.ptp(places[:, 2]) > 1.0


def test_the_first_places_are_ahead():
    ahead = math.pi / 2
    places = list(itertools.islice(viewpoints(np.zeros(3), ahead, 4.0, room()), 3))
    assert all(p[1] > 1.9 for p in places)


def test_a_search_ends_at_the_geofence():
    assert len(list(viewpoints(np.zeros(3), 0.0, 4.0, room()))) < 60


def test_the_front_of_a_gate_is_before_it_and_within_the_geofence():
    assert front(gate(2.0, 0.0, 0.0), 3.0, room()) == pytest.approx((-1.0, 0.0, 1.5))
    assert front(gate(-11.0, 0.0, 0.0), 3.0, room())[0] > FENCE[0]


def test_from_the_front_the_way_is_straight():
    assert way_round(np.array((-4.0, 1.0, 1.5)), gate(), SHAPE, 3.0, room()) == pytest.approx(
        np.array([(-3.0, 0.0, 1.5)])
    )


@given(st.floats(-0.4, 6.0), st.floats(-4.0, 4.0), st.floats(-math.pi, math.pi))
def test_from_behind_the_way_leads_round_the_frame(along, across, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    start = np.array((c * along - s * across, s * along + c * across, 1.5))
    way = np.vstack((start, way_round(start, gate(yaw=yaw), SHAPE, 3.0, room())))
    assert len(way) == 3
    for a, b in itertools.pairwise(way):
        points = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
        x, y = c * points[:, 0] + s * points[:, 1], c * points[:, 1] - s * points[:, 0]
        near = (np.abs(x) < 0.3) & (np.abs(x - along) > 0.3)
        assert (np.abs(y[near]) > 1.1 + CONFIG.vehicle.radius).all()


def test_the_way_round_takes_the_side_that_is_within_the_geofence():
    beside_the_fence = gate(0.0, 7.0)
    way = way_round(np.array((2.0, 7.2, 1.5)), beside_the_fence, SHAPE, 3.0, room())
    assert way[0, 1] == pytest.approx(7.0 - (0.7 + 0.4 + SIDESTEP))
