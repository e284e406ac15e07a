"""Ways around what stands in the way."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.messages import GateEstimate
from flightapp.planning import corridor
from flightapp.planning.corridor import Places, Solids, detour, room
from flightapp.planning.legs import nearer
from flightapp.planning.obstacles import MARGIN, Margins, distance, names, packed
from flightapp.planning.request import gate_route, point_route
from flightapp.track import Box, Cylinder, GateShape

MARGINS = Margins(0.2, 0.3, 0.05)
SHAPE = GateShape()
PILLAR = Cylinder(name="pillar", base=(5.0, 0.0, 0.0), radius=0.4, height=4.0)
LEFT = Box(name="left", centre=(5.0, 10.7, 5.0), size=(0.3, 20.0, 12.0))
RIGHT = Box(name="right", centre=(5.0, -10.7, 5.0), size=(0.3, 20.0, 12.0))
CLOSED = Box(name="wall", centre=(5.0, 0.0, 5.0), size=(0.3, 40.0, 12.0))
AHEAD, ANY = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)


def gate(gate_id, x, y, z=1.5, yaw=0.0):
    return GateEstimate(gate_id, np.array((x, y, z)), yaw, np.zeros((4, 4)), 9, 0.0)


def solids(*obstacles, gates=()):
    return Solids(packed(obstacles, gates, SHAPE, MARGINS), names(obstacles, gates))


def places(*points, directions=None, openings=0.0):
    called = ("the start", *(f"gate {i}" for i in range(1, len(points) - 1)), "the end")
    toward = np.zeros((len(points), 3)) if directions is None else np.array(directions)
    return Places(np.array(points, float), toward, called, openings)


def closest(a, b, rows, i):
    """The least distance from row ``i`` among many points of a leg."""
    gradient, s = np.empty(3), np.linspace(0.0, 1.0, 401)[:, None]
    return min(distance(p, rows, i, gradient) for p in a + s * (b - a))


def least_margin(points, rows):
    """How much farther than wanted the legs between ``points`` keep from every row."""
    return min(closest(a, b, rows, i) - rows[i, MARGIN] for a, b in pairwise(points) for i in range(len(rows)))


def length(points):
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


near = st.floats(-4.0, 4.0)
points = st.tuples(near, near, near).map(np.array)


@given(points, points, st.integers(0, 5), st.floats(0.0, 0.5))
@example(np.array((-1.0, 2.0, 1.0)), np.array((-2.0, 0.0, 0.0)), 0, 0.0)
def test_a_leg_is_nearer_than_its_closest_point_and_what_is_farther(a, b, i, more):
    rows = solids(
        Cylinder(name="pillar", base=(-1.0, 2.0, 0.0), radius=0.4, height=2.0),
        Box(name="wall", centre=(1.0, -2.0, 1.0), size=(0.4, 3.0, 2.0)),
        gates=(gate(1, 0.0, 0.0, yaw=0.6),),
    ).rows
    least = closest(a, b, rows, i)
    assert nearer(a, b, rows, i, least + more + 1e-6)
    assert not nearer(a, b, rows, i, least - more - 1e-6 - np.linalg.norm(b - a) / 800.0)


def test_clear_legs_stay_as_they_are():
    course = places((0, 3, 1.5), (10, 3, 1.5), (10, 9, 1.5))
    for around in (solids(PILLAR), solids()):
        way = detour(course, around)
        assert np.array_equal(way.points, course.points)
        assert not way.inserted.any()


def test_only_the_blocked_leg_goes_around_and_says_what_was_added():
    course = places((0, 3, 1.5), (0, 0, 1.5), (10, 0, 1.5), (10, 5, 1.5))
    around = solids(PILLAR)
    way = detour(course, around)
    assert np.array_equal(way.points[~way.inserted], course.points)
    assert way.inserted.tolist() == [False, False, *[True] * (len(way.points) - 4), False, False]
    assert least_margin(way.points, around.rows) > -2e-3
    # Straight to the tangents of a circle of 0.9 m and around it would be 10.16 m.
    assert 10.16 < length(way.points[1:-1]) < 10.5


def test_over_a_low_wall():
    low = Box(name="low", centre=(5.0, 0.0, 1.0), size=(0.2, 30.0, 2.0))
    way = detour(places((0, 0, 1.5), (10, 0, 1.5)), solids(low))
    assert way.points[way.inserted][:, 2].max() > 2.45
    assert length(way.points) < 1.1 * 2.0 * math.hypot(5.1, 1.0)


def test_a_narrow_gap_is_found():
    way = detour(places((0, 3.3, 1.5), (10, 3.3, 1.5)), solids(LEFT, RIGHT))
    assert least_margin(way.points, solids(LEFT, RIGHT).rows) > -2e-3
    assert np.abs(way.points[way.inserted][:, 1]).min() < 0.2


def test_what_blocks_the_leg_is_named_and_what_does_not_is_not():
    course = places((0, 0, 1.5), (3, 0, 1.5), (8, 0, 1.5), (12, 0, 1.5))
    elsewhere = Cylinder(name="elsewhere", base=(4.0, 3.0, 0.0), radius=0.3, height=3.0)
    with pytest.raises(PlanningError, match=r"^the way from gate 1 to gate 2 is blocked by 'wall': there is no other"):
        detour(course, solids(elsewhere, CLOSED))
    post = Box(name="post", centre=(5.0, 0.0, 5.0), size=(0.3, 0.5, 12.0))
    thick = Box(name="left", centre=(5.0, 10.7, 5.0), size=(2.0, 20.0, 12.0))
    thicker = Box(name="right", centre=(5.0, -10.7, 5.0), size=(2.0, 20.0, 12.0))
    with pytest.raises(
        PlanningError, match="gate 1 to gate 2 is blocked by 'post': there is no other within"
    ) as caught:
        detour(course, solids(thick, thicker, post))
    assert "z 0.3 .. 4.5 m" in str(caught.value)


def test_every_way_takes_effort_and_without_any_left_the_leg_is_named(monkeypatch):
    points = [(0.0, 0.0, 1.5), (10.0, 0.0, 1.5), (0.0, 0.1, 1.5)]
    once, twice = (detour(places(*points[:n]), solids(PILLAR)) for n in (2, 3))
    assert detour(places((0, 3, 1.5), (10, 3, 1.5)), solids(PILLAR)).effort == 0.0
    assert 0.0 < 1.5 * once.effort < twice.effort
    monkeypatch.setattr(corridor, "EFFORT", once.effort + 1.0)
    assert np.array_equal(detour(places(*points[:2]), solids(PILLAR)).points, once.points)
    with pytest.raises(PlanningError, match=r"^the way from gate 1 to the end was not found in the time there is"):
        detour(places(*points), solids(PILLAR))


def test_the_room_can_be_given():
    low = Box(name="low", centre=(5.0, 0.0, 1.0), size=(0.2, 30.0, 2.0))
    course = places((0, 0, 1.5), (10, 0, 1.5))
    bounds = room(course.points)
    assert bounds.tolist() == [[-5.0, -5.0, 0.3], [15.0, 5.0, 4.5]]
    bounds[1, 2] = 2.4
    with pytest.raises(PlanningError, match=r"blocked by 'low': .* z 0\.3 \.\. 2\.4 m"):
        detour(course, solids(low), bounds)


def test_an_end_may_be_as_close_to_something_as_the_start():
    beside = solids(PILLAR)
    assert not detour(places((5.0, 0.7, 1.5), (5.0, 0.8, 1.5)), beside).inserted.any()
    with pytest.raises(PlanningError, match=r"^the end is 0\.20 m from 'pillar', 0\.30 m"):
        detour(places((5.0, 0.7, 1.5), (5.0, 0.6, 1.5)), beside)


def test_places_inside_something_are_named():
    gates = np.array((ANY, AHEAD, ANY))
    with pytest.raises(PlanningError, match=r"^the centre of gate 1 is inside 'pillar'; move one of them$"):
        detour(places((0, 0, 1.5), (5, 0.2, 1.5), (10, 0, 1.5), directions=gates), solids(PILLAR))
    with pytest.raises(
        PlanningError, match=r"^the end is 0\.20 m from 'pillar', 0\.50 m with the vehicle's radius are wanted"
    ):
        detour(places((0, 0, 1.5), (5, 0.6, 1.5)), solids(PILLAR))
    passing = places((0, 0, 1.5), (5, 0.6, 1.5), (10, 0, 1.5), directions=gates)
    way = detour(passing, solids(PILLAR))
    assert np.array_equal(way.points[~way.inserted], passing.points)
    assert least_margin(way.points, solids(PILLAR).rows) > -0.302


def test_a_start_that_is_too_close_gets_away():
    around = solids(PILLAR)
    way = detour(places((4.3, 0, 1.5), (10, 0, 1.5)), around)
    gradient = np.empty(3)
    path = [a + s * (b - a) for a, b in pairwise(way.points) for s in np.linspace(0, 1, 200)]
    assert min(distance(p, around.rows, 0, gradient) for p in path) > 0.29
    assert not detour(places((4.3, 0, 1.5), (0, 0, 1.5)), around).inserted.any()


def test_a_gate_is_left_forwards_and_entered_from_the_front():
    """Two gates that look away from each other, flown through in the wrong order for a straight line."""
    first, second = gate(1, 0.0, 0.0), gate(2, -4.0, 0.5, yaw=math.pi)
    around = solids(gates=(first, second))
    course = places(
        (-5, 0, 1.5),
        (0, 0, 1.5),
        (-4, 0.5, 1.5),
        (-9, 0.5, 1.5),
        directions=(ANY, AHEAD, (-1, 0, 0), ANY),
        openings=1.4,
    )
    way = detour(course, around)
    assert least_margin(way.points, around.rows) > -2e-3
    for at, toward in (((0, 0, 1.5), 1.0), ((-4, 0.5, 1.5), -1.0)):
        k = int(np.flatnonzero((way.points == at).all(axis=1))[0])
        assert toward * (way.points[k + 1, 0] - way.points[k, 0]) > 0.25
        assert toward * (way.points[k, 0] - way.points[k - 1, 0]) > 0.25
    free = detour(course, solids())
    assert not free.inserted.any()


def test_what_stands_right_behind_a_gate_is_told():
    near = Box(name="crate", centre=(0.4, 0.0, 1.5), size=(0.2, 1.0, 1.0))
    course = places((-5, 0, 1.5), (0, 0, 1.5), (8, 0, 1.5), directions=(ANY, AHEAD, ANY), openings=1.4)
    with pytest.raises(PlanningError, match=r"^'crate' is less than 0\.3 m behind gate 1; move one of them$"):
        detour(course, solids(near, gates=(gate(1, 0.0, 0.0),)))


coordinate = st.floats(-6.0, 6.0)


@settings(max_examples=40)
@given(st.lists(st.tuples(coordinate, coordinate, st.floats(0.1, 1.0)), min_size=1, max_size=6), st.integers(0, 100))
def test_any_way_keeps_clear_and_ends_where_it_should(pillars, seed):
    """In a forest with room beside it there is always a way, unless an end is too near something."""
    trees = [Cylinder(name=f"tree {i}", base=(x, y, 0.0), radius=r, height=10.0) for i, (x, y, r) in enumerate(pillars)]
    low = Box(name="low", centre=(0.0, 0.0, 0.5), size=(1.0, 5.0, 1.0))
    around = solids(*trees, low)
    rng = np.random.default_rng(seed)
    course = places((-9, rng.uniform(-6, 6), 1.0), (rng.uniform(-6, 6), 8.0, 1.5), (9, rng.uniform(-6, 6), 2.0))
    way = detour(course, around)
    assert np.array_equal(way.points[~way.inserted], course.points)
    assert least_margin(way.points, around.rows) > -2e-3
    assert length(way.points) < 1.8 * length(course.points)


def test_a_request_gives_its_places_and_solids():
    rest = np.zeros(3)
    start = Motion(np.array((0.0, 3.0, 1.5)), rest, rest, rest, 0.0, 0.0)
    gates = (gate(7, 3.0, 0.0), gate(9, 9.0, 0.0))
    request = PlanRequest(0.0, start, gates, np.array((12.0, 0.0, 1.5)), Limits(4.0, 8.0, 3.0))
    request = replace(request, obstacles=(CLOSED,), shape=SHAPE)
    course, around = Places.of(gate_route(request), request), Solids.of(request, MARGINS)
    assert course.names == ("the start", "gate 7", "gate 9", "the end")
    assert course.openings == SHAPE.opening
    assert around.names == ("'wall'", "the frame of gate 7", "the frame of gate 9")
    with pytest.raises(PlanningError, match="the way from gate 7 to gate 9 is blocked by 'wall'"):
        detour(course, around)
    bare = replace(request, shape=None, obstacles=())
    assert len(Solids.of(bare, MARGINS).rows) == 0
    assert not detour(Places.of(gate_route(bare), bare), Solids.of(bare, MARGINS)).inserted.any()
    points = point_route(np.array(((1.0, 0.0, 1.0), (2.0, 0.0, 1.0))), bare)
    assert Places.of(points, bare).names == ("the start", "waypoint 0", "waypoint 1", "the end")
