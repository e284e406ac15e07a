"""The geofence: who is within, by how much not, and which plans lead out."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.planning.answer import Answerer
from flightapp.planning.geofence import Geofence
from flightapp.planning.goal import Goal
from flightapp.planning.pacer import Pacer
from flightapp.planning.polynomial import PolynomialPlanner

BOX = {"geofence.corners": ((-5.0, -4.0), (5.0, 4.0)), "geofence.floor": 0.0, "geofence.ceiling": 6.0}
ELL = {"geofence.corners": ((0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0))}
REST = np.zeros(3)
LIMITS = Limits(4.0, 8.0, 3.0)


def fence(settings):
    return Geofence.of(load_config(None, settings).geofence)


def flown(start, *points, velocity=REST):
    """A plan from ``start`` through ``points`` to rest."""
    way = np.array(points, float)
    begin = Motion(np.array(start, float), np.array(velocity, float), REST, REST, 0.0, 0.0)
    request = PlanRequest(0.0, begin, (), way[-1], LIMITS)
    return PolynomialPlanner(load_config()).through(way, request)


@given(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-3.0, 9.0))
def test_the_distance_from_a_box_is_that_of_its_faces(x, y, z):
    excess = np.array((abs(x) - 5.0, abs(y) - 4.0, abs(z - 3.0) - 3.0))
    expected = excess.max() if (excess <= 0.0).all() else np.linalg.norm(np.maximum(excess, 0.0))
    assert fence(BOX).outside(np.array((x, y, z))) == pytest.approx(expected, abs=1e-9)


@settings(max_examples=200)
@given(st.floats(-3.0, 13.0), st.floats(-3.0, 13.0))
def test_an_outline_may_have_a_corner_that_points_inwards(x, y):
    within = 0.0 < x < 10.0 and 0.0 < y < 10.0 and (x < 4.0 or y < 4.0)
    outside = fence(ELL).outside(np.array((x, y, 1.0)))
    assert (outside < 0.0) == within or abs(outside) < 1e-9


def test_the_direction_of_the_corners_does_not_matter():
    turned = {"geofence.corners": tuple(reversed(ELL["geofence.corners"]))}
    for point in ((1.0, 1.0, 1.0), (6.0, 6.0, 1.0), (-1.0, 2.0, 1.0)):
        assert fence(ELL).outside(np.array(point)) == pytest.approx(fence(turned).outside(np.array(point)))


@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-5.0, 20.0))
def test_the_nearest_place_within_a_box_is_the_clipped_one(x, y, z):
    place = fence(BOX).within(np.array((x, y, z)), 0.7)
    assert place == pytest.approx(np.clip((x, y, z), (-4.3, -3.3, 0.7), (4.3, 3.3, 5.3)), abs=1e-6)


@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_a_place_within_a_polygon_keeps_its_margin(x, y):
    ell = fence(ELL)
    assert ell.outside(ell.within(np.array((x, y, 1.0)), 0.7)) <= -0.7 + 1e-6


def test_a_plan_within_is_accepted_and_one_that_leads_out_says_where_and_by_how_much():
    box = fence(BOX)
    assert box.exit(flown((-4.0, 0.0, 1.5), (4.0, 0.0, 1.5))) is None
    out = box.exit(flown((0.0, 0.0, 1.5), (0.0, 6.0, 1.5), (0.0, 0.0, 1.5)))
    assert out is not None
    assert out.distance == pytest.approx(2.0, abs=0.2)
    assert out.position[1] == pytest.approx(4.0, abs=0.1)
    assert "leaves the geofence at" in str(out)
    above = box.exit(flown((0.0, 0.0, 1.5), (0.0, 0.0, 7.0)))
    assert above is not None
    assert above.distance == pytest.approx(1.0, abs=0.01)


def test_across_the_inward_corner_is_outside_though_both_ends_are_within():
    assert fence(ELL).exit(flown((9.0, 2.0, 1.0), (2.0, 9.0, 1.0))) is not None
    assert fence(ELL).exit(flown((9.0, 2.0, 1.0), (2.0, 2.0, 1.0))) is None


def test_from_outside_a_plan_may_lead_back_in_but_not_further_out():
    box = fence(BOX)
    assert box.exit(flown((0.0, 4.8, 1.5), (0.0, 0.0, 1.5))) is None
    assert box.exit(flown((0.0, 4.8, 1.5), (0.0, 0.0, 1.5), velocity=(0.0, 1.0, 0.0))) is None
    assert box.exit(flown((0.0, 4.8, 1.5), (0.0, 8.0, 1.5), (0.0, 0.0, 1.5))) is not None
    assert box.exit(flown((0.0, 4.8, 1.5), (0.0, 4.5, 1.5))) is not None
    assert box.exit(flown((0.0, 4.8, 1.5), (0.0, 0.0, 1.5), (0.0, 5.0, 1.5), (0.0, 0.0, 1.5))) is not None


@settings(max_examples=50)
@given(st.floats(-math.pi, math.pi), st.floats(0.1, 20.0))
def test_what_is_accepted_is_within_at_every_moment(bearing, way):
    box = fence(BOX)
    plan = flown((0.0, 0.0, 1.5), (way * math.cos(bearing), way * math.sin(bearing), 1.5))
    worst = max(box.outside(p) for p in plan.sample(np.linspace(0.0, plan.duration, 2000)).position)
    out = box.exit(plan)
    assert (out is None) == (worst <= 1e-3) or abs(worst) < 5e-3
    assert out is None or out.distance == pytest.approx(worst, abs=5e-3)


def test_the_answer_to_a_request_never_leads_out():
    config = load_config(None, BOX)
    rest = Motion(np.array((0.0, 0.0, 1.5)), REST, REST, REST, 0.0, 0.0)
    answerer = Answerer(config, PolynomialPlanner(config), Pacer(config))
    end = np.array((0.0, 9.0, 1.5))
    goal = Goal(end, LIMITS, waypoints=end[None])
    with pytest.raises(PlanningError, match=r"leaves the geofence at .* by 5.00 m"):
        answerer.answer(goal, PlanRequest(0.0, rest, (), end, LIMITS), (), 1.0, False)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"geofence.corners": ((0.0, 0.0), (5.0, -0.5))}, "at least 1 m wide along each axis"),
        ({"geofence.corners": ((0.0, 0.0),)}, "two opposite corners"),
        ({"geofence.corners": ((0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 4.0))}, "crosses or touches itself"),
        ({"geofence.corners": ((0.0, 0.0), (4.0, 0.0), (4.0, 0.0), (0.0, 4.0))}, "crosses or touches itself"),
        ({"geofence.floor": 2.0, "geofence.ceiling": 2.5}, "at least 1 m above the floor"),
        ({"mission.geofence": (0.0, 0.0, 0.0, 9.0, 9.0, 9.0)}, "unknown key 'mission.geofence'"),
    ],
)
def test_a_geofence_that_cannot_be_is_refused(settings, text):
    with pytest.raises(BadInputError, match=text):
        load_config(None, settings)
