"""When to plan anew, and from what."""

from dataclasses import replace

import numpy as np
import pytest

from flightapp.config import load_config
from flightapp.interfaces import Limits
from flightapp.messages import Drift, GateEstimate, GateMap
from flightapp.planning.course import EXIT_RUN
from flightapp.planning.goal import Goal
from flightapp.planning.line import Line
from flightapp.planning.navigator import FROZEN, Navigator
from flightapp.planning.pacer import Paced
from flightapp.planning.pacing import STEADY, Pace, paced
from flightapp.track import Cylinder, Start, Track
from flightapp.trajectory import hover

LIMITS = Limits(4.0, 8.0, 3.0)
FINISH = np.array((30.0, 0.0, 1.0))
CONFIG = load_config()
PILLAR = Cylinder(name="pillar", base=(12.0, 0.0, 0.0), radius=0.3, height=3.0)
TRACK = Track(name="two", start=Start(position=(0.0, 0.0, 0.0)), waypoints=((1.0, 0.0, 1.0),), obstacles=(PILLAR,))


def gate(gate_id, x, y=0.0, sigma=0.05):
    P = np.diag((sigma**2, sigma**2, sigma**2, 0.01))
    return GateEstimate(gate_id, np.array((x, y, 1.5)), 0.0, P, 10, 0.0)


def gate_map(*gates):
    return GateMap(0.0, 1, gates, Drift(0.0, np.zeros(3), 0.0, np.zeros((4, 4))))


def straight(stamp, gate_ids, gate_times, length=30.0, duration=10.0):
    """From rest to rest along x."""
    line = hover(stamp, np.array((0.0, 0.0, 1.5)), 0.0, duration)
    powers = length / duration ** np.arange(4.0, 8.0)
    line.coefficients[0, 0, 4:] = np.array((35.0, -84.0, 70.0, -20.0)) * powers
    return replace(line, gate_ids=gate_ids, gate_times=gate_times)


def fly(navigator, line, goal, request, plan, pace=STEADY):
    """Have ``plan`` accepted as the answer to ``request``."""
    choice = Paced(plan, 0.0, pace, paced(plan, 0.0, pace, plan.stamp))
    line.accept(choice.flown)
    navigator.accepted(goal, request, choice)
    return choice


@pytest.fixture
def flying():
    """A navigator whose plan through gates 1 and 2 is being flown from stamp 0."""
    line = Line()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    navigator = Navigator(CONFIG, TRACK)
    goal = Goal(FINISH, LIMITS, gate_ids=(1, 2), serial=1)
    known = gate_map(gate(1, 8.0), gate(2, 16.0))
    request = navigator.request(0.0, goal, known, line)
    assert request is not None
    fly(navigator, line, goal, request, straight(request.stamp, (1, 2), (2.0, 4.0)))
    return navigator, goal, known, line, request


def test_nothing_is_planned_while_the_next_gate_is_nowhere_in_the_map():
    line = Line()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    navigator, goal = Navigator(CONFIG, TRACK), Goal(FINISH, LIMITS, gate_ids=(1, 2), serial=1)
    assert navigator.request(1.0, goal, None, line) is None
    assert navigator.request(1.0, goal, gate_map(), line) is None
    assert navigator.request(1.0, goal, gate_map(gate(2, 16.0)), line) is None


def test_a_gate_that_appears_in_the_map_is_planned_for():
    line = Line()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    navigator, goal = Navigator(CONFIG, TRACK), Goal(FINISH, LIMITS, gate_ids=(1, 2), serial=1)
    first = navigator.request(0.0, goal, gate_map(gate(1, 8.0)), line)
    assert first is not None
    assert first.end == pytest.approx((8.0 + EXIT_RUN, 0.0, 1.5))
    fly(navigator, line, goal, first, straight(first.stamp, (1,), (4.0,), first.end[0]))
    assert navigator.request(1.0, goal, gate_map(gate(1, 8.0)), line) is None
    both = navigator.request(2.0, goal, gate_map(gate(1, 8.0), gate(2, 16.0)), line)
    assert both is not None
    assert [g.gate_id for g in both.gates] == [1, 2]
    assert np.array_equal(both.end, FINISH)


def test_a_new_goal_is_planned_from_the_line_a_lead_ahead(flying):
    *_, request = flying
    assert request.stamp == CONFIG.planning.lead
    assert request.start.position == pytest.approx((0.0, 0.0, 1.5))
    assert [g.gate_id for g in request.gates] == [1, 2]
    assert np.array_equal(request.end, FINISH)
    assert (request.shape, request.obstacles) == (TRACK.gate, (PILLAR,))


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
    navigator = Navigator(CONFIG, TRACK)
    goal = Goal(FINISH, LIMITS, gate_ids=(1, 2), serial=1)
    half = gate_map(gate(1, 8.0), gate(2, 16.0, sigma=1.5))
    request = navigator.request(0.0, goal, half, line)
    assert request is not None
    assert request.look_at is not None
    assert navigator.waiting_for is not None
    fly(navigator, line, goal, request, straight(request.stamp, (1,), (2.0,)))
    request = navigator.request(1.0, goal, gate_map(gate(1, 8.0), gate(2, 17.0)), line)
    assert request is not None
    assert [g.gate_id for g in request.gates] == [1, 2]
    assert request.look_at is None


def test_as_gates_are_passed_the_course_goes_on():
    line = Line()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    navigator = Navigator(load_config(None, {"planning.horizon": 2}), TRACK)
    goal = Goal(FINISH, LIMITS, gate_ids=(1, 2, 1, 2), serial=1)
    known = gate_map(gate(1, 8.0), gate(2, 16.0))
    request = navigator.request(0.0, goal, known, line)
    assert [g.gate_id for g in request.gates] == [1, 2]
    assert request.look_at == pytest.approx((8.0, 0.0, 1.5))
    assert navigator.waiting_for is None
    fly(navigator, line, goal, request, straight(request.stamp, (1, 2), (2.0, 4.0)))
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


def test_a_new_goal_that_is_refused_is_asked_for_again_but_not_too_often(flying):
    navigator, goal, known, line, _ = flying
    fresh = replace(goal, serial=2)
    assert navigator.request(0.01, fresh, known, line) is not None
    assert navigator.request(0.05, fresh, known, line) is None
    assert navigator.request(0.05, replace(goal, serial=3), known, line) is not None
    assert navigator.request(0.06 + CONFIG.planning.replan_interval, fresh, known, line) is not None


def test_waypoints_are_planned_once():
    line = Line()
    line.accept(hover(0.0, np.zeros(3), 0.0))
    navigator = Navigator(CONFIG, TRACK)
    goal = Goal(FINISH, LIMITS, waypoints=np.ones((3, 3)), serial=7)
    request = navigator.request(0.0, goal, None, line)
    assert request is not None
    fly(navigator, line, goal, request, hover(request.stamp, np.zeros(3), 0.0))
    assert navigator.request(5.0, goal, None, line) is None


def test_a_gate_that_a_plan_left_behind_stays_behind(flying):
    navigator, goal, _, line, first = flying
    moved = gate_map(gate(1, 8.0), gate(2, 16.0, 0.5))
    request = navigator.request(first.stamp + 2.0, goal, moved, line)
    assert [g.gate_id for g in request.gates] == [2]
    at = line.motion(request.stamp)
    plan = from_motion(request.stamp, at, (2,), (1.9,))
    fly(navigator, line, goal, request, plan)
    further = gate_map(gate(1, 8.0), gate(2, 16.0, 0.7))
    again = navigator.request(request.stamp + 0.2, replace(goal, passed=0), further, line)
    assert [g.gate_id for g in again.gates] == [2]


def from_motion(stamp, motion, gate_ids, gate_times):
    """A trajectory that starts with ``motion`` and brakes to rest."""
    plan = hover(stamp, motion.position, motion.yaw, 4.0)
    c = plan.coefficients[0]
    c[:, 0], c[:, 1], c[:, 2], c[:, 3] = motion.position, motion.velocity, motion.acceleration / 2, motion.jerk / 6
    t = 4.0
    ends = np.array([[t**k for k in range(4, 8)], [k * t ** (k - 1) for k in range(4, 8)],
                     [k * (k - 1) * t ** (k - 2) for k in range(4, 8)],
                     [k * (k - 1) * (k - 2) * t ** (k - 3) for k in range(4, 8)]])  # fmt: skip
    a, j = motion.acceleration, motion.jerk
    left = np.array([0.5 * t * motion.velocity, np.zeros(3), np.zeros(3), np.zeros(3)])
    left -= np.array([t * motion.velocity + t**2 / 2 * a + t**3 / 6 * j, motion.velocity + t * a + t**2 / 2 * j,
                      a + t * j, j])  # fmt: skip
    c[:, 4:] = np.linalg.solve(ends, left).T
    return replace(plan, gate_ids=gate_ids, gate_times=gate_times)


def test_a_plan_never_begins_before_one_that_is_still_to_take_over(flying):
    navigator, goal, _, line, _ = flying
    fresh = replace(goal, serial=2)
    request = navigator.request(0.01, fresh, gate_map(gate(1, 8.0), gate(2, 16.0)), line)
    assert request.stamp == 0.01 + CONFIG.planning.lead
    navigator.took(0.5)
    late = navigator.request(0.2, fresh, gate_map(gate(1, 8.0), gate(2, 16.0)), line)
    fly(navigator, line, fresh, late, from_motion(late.stamp, late.start, (1, 2), (2.0, 4.0)))
    navigator.took(0.0)
    after = navigator.request(0.3, replace(goal, serial=3), gate_map(gate(1, 8.0), gate(2, 16.0)), line)
    assert after.stamp == late.stamp


def test_a_detour_to_a_gate_that_is_met_anyway_is_not_flown(flying):
    navigator, goal, _, line, first = flying
    moved = gate_map(gate(1, 8.0, 0.2), gate(2, 16.0))
    request = navigator.request(1.0, goal, moved, line)
    around = from_motion(request.stamp, request.start, (1, 2), (3.5, 3.9))
    text = navigator.detour(goal, request, Paced(around, 0.0, STEADY, around), line)
    assert "gate 1" in text
    assert "detour" in text
    assert f"{request.stamp + 3.5 - first.stamp - 2.0:.1f} s later" in text
    direct = from_motion(request.stamp, request.start, (1, 2), (1.1, 3.0))
    assert navigator.detour(goal, request, Paced(direct, 0.0, STEADY, direct), line) == ""
    far = navigator.request(2.0 - 0.2 - 0.3, goal, gate_map(gate(1, 8.0, 1.5), gate(2, 16.0)), line)
    around = from_motion(far.stamp, far.start, (1, 2), (3.5, 3.9))
    assert navigator.detour(goal, far, Paced(around, 0.0, STEADY, around), line) == ""


def test_a_request_starts_from_the_plan_at_its_full_pace(flying):
    navigator, goal, known, line, _ = flying
    fresh = replace(goal, serial=2)
    request = navigator.request(0.2, fresh, known, line)
    plan = straight(request.stamp, (1, 2), (2.0, 4.0))
    line.clear()
    line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    fly(navigator, line, fresh, request, plan, Pace(request.stamp, 0.5, 0.5, 0.0))
    next_one = navigator.request(3.0, replace(goal, serial=3), known, line)
    place = 0.5 * (next_one.stamp - request.stamp)
    np.testing.assert_allclose(next_one.start.velocity, plan.sample(place).velocity, atol=1e-9)
    np.testing.assert_allclose(next_one.start.jerk, plan.sample(place).jerk, atol=1e-9)


def test_only_with_time_left_is_a_plan_flown_in_a_simulation_before(flying):
    navigator, *_ = flying
    navigator.took(0.002)
    assert navigator.has_time
    navigator.took(1.999)
    assert not navigator.has_time


def test_frames_of_gates_that_were_passed_are_kept_clear_of_but_not_those_hardly_known(flying):
    navigator, goal, _, line, _ = flying
    moved = gate_map(gate(1, 8.0), gate(2, 16.3), gate(3, 20.0, 4.0, sigma=3.0))
    request = navigator.request(2.5, goal, moved, line)
    assert [g.gate_id for g in request.gates] == [2]
    assert [g.gate_id for g in request.frames] == [1, 2]
