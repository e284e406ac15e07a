"""When to plan anew, and from what."""

from dataclasses import replace

import numpy as np
import pytest

from flightapp.config import load_config
from flightapp.interfaces import Limits
from flightapp.messages import Drift, GateEstimate, GateMap
from flightapp.planning.goal import Goal
from flightapp.planning.line import Line
from flightapp.planning.navigator import FROZEN, Navigator
from flightapp.trajectory import Trajectory, hover

LIMITS = Limits(4.0, 8.0, 3.0)
FINISH = np.array((30.0, 0.0, 1.0))
CONFIG = load_config()


def gate(gate_id, x, y=0.0, sigma=0.05):
    P = np.diag((sigma**2, sigma**2, sigma**2, 0.01))
    return GateEstimate(gate_id, np.array((x, y, 1.5)), 0.0, P, 10, 0.0)


def gate_map(*gates):
    return GateMap(0.0, 1, gates, Drift(0.0, np.zeros(3), 0.0, np.zeros((4, 4))))


def straight(stamp, gate_ids, gate_times, speed=4.0, duration=10.0):
    line = hover(stamp, np.array((0.0, 0.0, 1.5)), 0.0, duration)
    line.coefficients[0, 0, 1] = speed
    return replace(line, gate_ids=gate_ids, gate_times=gate_times)


@pytest.fixture
def flying():
    """A navigator whose plan through gates 1 and 2 is being flown from stamp 0."""
    line = Line()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    navigator = Navigator(CONFIG)
    goal = Goal(FINISH, LIMITS, gate_ids=(1, 2), serial=1)
    known = gate_map(gate(1, 8.0), gate(2, 16.0))
    request = navigator.request(0.0, goal, known, line)
    assert request is not None
    navigator.accepted(goal, request)
    plan: Trajectory = straight(request.stamp, (1, 2), (2.0, 4.0))
    line.accept(plan)
    return navigator, goal, known, line, request


def test_a_new_goal_is_planned_from_the_line_a_lead_ahead(flying):
    *_, request = flying
    assert request.stamp == CONFIG.planning.lead
    assert request.start.position == pytest.approx((0.0, 0.0, 1.5))
    assert [g.gate_id for g in request.gates] == [1, 2]
    assert np.array_equal(request.end, FINISH)


def test_the_same_map_is_not_planned_again(flying):
    navigator, goal, known, line, _ = flying
    assert navigator.request(1.0, goal, known, line) is None


def test_a_gate_that_moved_is_planned_anew_but_not_too_often(flying):
    navigator, goal, _, line, _ = flying
    moved = gate_map(gate(1, 8.0, 0.2), gate(2, 16.0))
    assert navigator.request(0.05, goal, moved, line) is None
    request = navigator.request(0.5, goal, moved, line)
    assert request is not None
    assert request.gates[0].position[1] == 0.2


def test_gates_that_will_be_behind_when_the_plan_begins_are_left_out(flying):
    navigator, goal, _, line, first = flying
    line.at(first.stamp)
    moved = gate_map(gate(1, 8.0), gate(2, 16.0, 0.5))
    request = navigator.request(first.stamp + 2.0 - 0.5 * CONFIG.planning.lead, goal, moved, line)
    assert request is not None
    assert [g.gate_id for g in request.gates] == [2]


def test_a_gate_that_is_near_is_flown_through_as_planned(flying):
    navigator, goal, _, line, first = flying
    line.at(first.stamp)
    moved = gate_map(gate(1, 8.0, 0.4), gate(2, 16.0, 0.5))
    gate_stamp = first.stamp + 2.0
    assert navigator.request(gate_stamp - CONFIG.planning.lead - 0.5 * FROZEN, goal, moved, line) is None
    behind = navigator.request(gate_stamp - CONFIG.planning.lead + 0.01, goal, moved, line)
    assert behind is not None
    assert [g.gate_id for g in behind.gates] == [2]


def test_a_gate_that_became_known_extends_the_course():
    line = Line()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    navigator = Navigator(CONFIG)
    goal = Goal(FINISH, LIMITS, gate_ids=(1, 2), serial=1)
    half = gate_map(gate(1, 8.0), gate(2, 16.0, sigma=1.5))
    request = navigator.request(0.0, goal, half, line)
    assert request is not None
    assert request.look_at is not None
    assert navigator.waiting_for is not None
    navigator.accepted(goal, request)
    line.accept(straight(request.stamp, (1,), (2.0,)))
    request = navigator.request(1.0, goal, gate_map(gate(1, 8.0), gate(2, 17.0)), line)
    assert request is not None
    assert [g.gate_id for g in request.gates] == [1, 2]
    assert request.look_at is None


def test_as_gates_are_passed_the_course_goes_on():
    line = Line()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    navigator = Navigator(load_config(None, {"planning.horizon": 2}))
    goal = Goal(FINISH, LIMITS, gate_ids=(1, 2, 1, 2), serial=1)
    known = gate_map(gate(1, 8.0), gate(2, 16.0))
    request = navigator.request(0.0, goal, known, line)
    assert [g.gate_id for g in request.gates] == [1, 2]
    assert request.look_at == pytest.approx((8.0, 0.0, 1.5))
    assert navigator.waiting_for is None
    navigator.accepted(goal, request)
    line.accept(straight(request.stamp, (1, 2), (2.0, 4.0)))
    assert navigator.request(1.0, goal, known, line) is None
    on = navigator.request(2.1, goal, known, line)
    assert [g.gate_id for g in on.gates] == [2, 1]


def test_after_a_slow_plan_the_next_begins_later(flying):
    navigator, goal, _, line, _ = flying
    moved = gate_map(gate(1, 8.0, 0.2), gate(2, 16.0))
    navigator.took(0.2)
    assert navigator.request(0.5, goal, moved, line).stamp == pytest.approx(0.5 + 1.5 * 0.2)
    navigator.took(0.001)
    assert navigator.request(1.0, goal, moved, line).stamp == pytest.approx(1.0 + CONFIG.planning.lead)


def test_a_refused_plan_is_asked_for_again(flying):
    navigator, goal, _, line, _ = flying
    moved = gate_map(gate(1, 8.0, 0.2), gate(2, 16.0))
    assert navigator.request(0.5, goal, moved, line) is not None
    assert navigator.request(0.5 + CONFIG.planning.replan_interval, goal, moved, line) is not None


def test_waypoints_are_planned_once():
    line = Line()
    line.accept(hover(0.0, np.zeros(3), 0.0))
    navigator = Navigator(CONFIG)
    goal = Goal(FINISH, LIMITS, waypoints=np.ones((3, 3)), serial=7)
    request = navigator.request(0.0, goal, None, line)
    assert request is not None
    navigator.accepted(goal, request)
    assert navigator.request(5.0, goal, None, line) is None
