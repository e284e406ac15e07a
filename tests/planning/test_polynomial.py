"""What every plan must keep to: gates, limits, continuity."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_tracks import (
    FIVE_GATES,
    FIVE_GATES_LOOP,
    FOUR_GATES,
    TRACKS,
    ZERO,
    at_rest,
    crossing_angles,
    gate,
    lap_request,
    lemniscate,
    motion_at,
    replan_request,
    request_for,
)

from flightapp.config import Config, Planning, Vehicle
from flightapp.evaluation.plan_table import yardsticks
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.planning.polynomial import PolynomialPlanner

PLANNER = PolynomialPlanner(Config())
AGILE = PolynomialPlanner(Config(vehicle=Vehicle(thrust_to_weight=8.0, rate_max=20.0)))


def keeps_limits(trajectory, limits):
    peaks = trajectory.limits()
    assert peaks.speed <= 1.001 * limits.v_max
    assert peaks.acceleration <= 1.001 * limits.a_max
    assert peaks.yaw_rate <= limits.yaw_rate_max * (1.0 + 1e-9)
    assert np.isfinite(trajectory.coefficients).all()


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    gates=st.integers(2, 12),
    v_max=st.floats(0.5, 12.0),
    a_max=st.floats(2.0, 20.0),
)
def test_plans_from_rest_keep_to_the_limits(seed, gates, v_max, a_max):
    rng = np.random.default_rng(seed)
    position, yaw, track = np.array([0.0, 0.0, 1.5]), 0.0, []
    for number in range(gates):
        yaw += rng.uniform(-1.2, 1.2)
        position = position + rng.uniform(2.5, 12.0) * np.array([math.cos(yaw), math.sin(yaw), 0.0])
        position[2] = rng.uniform(1.0, 4.0)
        track.append(gate(number, *position, yaw))
    limits = Limits(v_max, a_max, 3.0)
    start = at_rest((0.0, 0.0, rng.uniform(0.5, 2.0)), rng.uniform(-4.0, 4.0))
    trajectory = PLANNER.plan(PlanRequest(5.0, start, tuple(track), position + np.array([3.0, 1.0, 0.0]), limits))
    keeps_limits(trajectory, limits)
    assert trajectory.stamp == 5.0
    for g, t in zip(track, trajectory.gate_times, strict=True):
        np.testing.assert_allclose(trajectory.sample(t).position, g.position, atol=1e-8)


@pytest.mark.parametrize("track", TRACKS)
@pytest.mark.parametrize("minimise", ["acceleration", "jerk", "snap"])
def test_a_race_goes_through_the_gates_in_their_direction(track, minimise):
    planner = PolynomialPlanner(Config(planning=Planning(minimise=minimise)))
    request = request_for(TRACKS[track])
    trajectory = planner.plan(request)
    keeps_limits(trajectory, request.limits)
    assert trajectory.gate_ids == tuple(g.gate_id for g in request.gates)
    assert list(trajectory.gate_times) == sorted(trajectory.gate_times)
    assert crossing_angles(trajectory, request).max() <= 35.0
    ends = trajectory.sample(np.array([0.0, trajectory.duration]))
    np.testing.assert_allclose(ends.position, [request.start.position, request.end], atol=1e-8)
    for derivative in (ends.velocity, ends.acceleration, ends.jerk):
        np.testing.assert_allclose(derivative, 0.0, atol=1e-7)


@pytest.mark.parametrize("track", ["five_gates", "five_gates_loop"])
def test_gates_far_from_their_prior_are_crossed_in_their_direction(track):
    rng = np.random.default_rng(7)
    for _ in range(10):
        request = request_for(TRACKS[track], shift=rng)
        trajectory = PLANNER.plan(request)
        keeps_limits(trajectory, request.limits)
        assert crossing_angles(trajectory, request).max() <= 65.0


def test_plans_keep_to_the_vehicles_thrust_and_rates():
    config = Config(vehicle=Vehicle(thrust_to_weight=2.8, rate_max=6.0))
    planner = PolynomialPlanner(config)
    for track in (FIVE_GATES, FIVE_GATES_LOOP, FOUR_GATES):
        peaks = planner.plan(request_for(track, v_max=30.0, a_max=50.0)).limits()
        assert peaks.specific_force <= 1.001 * 0.9 * config.vehicle.thrust_max
        assert peaks.body_rate <= 1.001 * 0.6 * config.vehicle.rate_max


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), track=st.sampled_from(sorted(TRACKS)), part=st.floats(0.0, 0.99))
def test_a_replan_takes_over_without_a_step(seed, track, part):
    rng = np.random.default_rng(seed)
    request = request_for(TRACKS[track])
    plan = PLANNER.plan(request)
    t = part * plan.duration
    after = PLANNER.plan(replan_request(request, plan, t, shift=rng))
    old, new = plan.sample(t), after.sample(0.0)
    for field in ("position", "velocity", "acceleration", "jerk", "yaw", "yaw_rate"):
        np.testing.assert_allclose(getattr(new, field), getattr(old, field), atol=1e-9)
    keeps_limits(after, request.limits)


def test_replans_of_an_unchanged_track_keep_to_the_limits_and_lose_little_time():
    request = request_for(FIVE_GATES)
    plan = PLANNER.plan(request)
    for t in np.linspace(0.3, 0.97, 12) * plan.duration:
        after = PLANNER.plan(replan_request(request, plan, t))
        peaks = after.limits()
        assert peaks.speed <= 1.001 * request.limits.v_max
        assert peaks.acceleration <= 1.001 * request.limits.a_max
        assert after.duration <= 1.1 * (plan.duration - t) + 0.3


@pytest.mark.parametrize("v_max, exact", [(3.0, 14.4), (5.0, 8.7), (7.0, 6.5)])
def test_a_lemniscate_is_flown_in_the_known_time(v_max, exact):
    waypoints = lemniscate(16)
    request = lap_request(waypoints, v_max, 25.0)
    trajectory = AGILE.through(waypoints, request)
    keeps_limits(trajectory, request.limits)
    assert trajectory.duration <= exact
    places = trajectory.sample(trajectory.knots).position
    away = np.linalg.norm(waypoints[1:-1, None] - places[None], axis=2)
    assert away.min(axis=1).max() < 1e-8
    assert list(away.argmin(axis=1)) == sorted(away.argmin(axis=1))
    assert trajectory.gate_ids == () and trajectory.gate_times == ()


EXACT = {
    "lemniscate": {3.0: 14.4, 5.0: 8.7, 7.0: 6.5, math.inf: 6.0},
    # At 10 m/s 7.0 s are possible: the planner's 7.11 s are a known shortfall, which must not grow.
    "five_gates": {1.0: 70.0, 2.0: 35.0, 3.0: 23.0, 4.0: 17.5, 10.0: 7.15, math.inf: 6.0},
    "five_gates_loop": {4.0: 22.5},
    "four_gates": {0.5: 43.0, 1.0: 22.0, 4.0: 5.4},
}
"""s that polynomials through the points are known to need, by course and greatest speed in m/s; but for one row."""


@pytest.mark.parametrize("course", yardsticks().courses, ids=lambda course: course.name)
def test_the_yardstick_courses_are_flown_in_the_known_times(course):
    planner = PolynomialPlanner(yardsticks().config())
    for v_max, _, _ in course.optimum:
        limits = Limits(v_max, math.inf, 3.0)
        request = PlanRequest(0.0, at_rest(course.start), (), course.finish, limits)
        trajectory = planner.through(course.points, request)
        keeps_limits(trajectory, limits)
        assert trajectory.duration <= EXACT[course.name][v_max]


def test_the_same_request_gives_the_same_plan():
    one, other = PLANNER.plan(request_for(FIVE_GATES)), PLANNER.plan(request_for(FIVE_GATES))
    np.testing.assert_array_equal(one.coefficients, other.coefficients)
    np.testing.assert_array_equal(one.yaw_coefficients, other.yaw_coefficients)


def test_a_single_leg_is_flown_at_speed():
    request = PlanRequest(0.0, at_rest((0, 0, 1)), (), np.array([20.0, 0.0, 1.0]), Limits(4.0, 8.0, 3.0))
    for trajectory in (PLANNER.plan(request), PLANNER.through(np.array([[20.0, 0.0, 1.0]]), request)):
        keeps_limits(trajectory, request.limits)
        assert trajectory.duration <= 20.0 / 4.0 + 4.0 / 8.0 + 1.2


def test_a_gate_to_be_crossed_backwards_is_led_up_to_or_refused():
    around = (gate(1, 5, 0, 2, math.pi), gate(2, 12, 0, 2, 0.0))
    request = PlanRequest(0.0, at_rest((0, 0, 2)), around, np.array([15.0, 0.0, 2.0]), Limits(4.0, 8.0, 3.0))
    try:
        trajectory = PLANNER.plan(request)
    except PlanningError as error:
        assert "gate 1 would be crossed at" in str(error)
    else:
        assert crossing_angles(trajectory, request).max() <= 65.0


def test_gates_that_bend_the_way_through_others_are_all_crossed_in_their_direction():
    """A chain of gates at random angles: runs through some of them make others askew that were not."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        yaw, position, track = 0.0, np.array([0.0, 0.0, 2.0]), []
        for number in range(25):
            turn = rng.uniform(-2.6, 2.6) if rng.uniform() < 0.4 else rng.uniform(-1.0, 1.0)
            way = yaw + 0.5 * turn
            yaw += turn
            position = position + rng.uniform(1.0, 8.0) * np.array([math.cos(way), math.sin(way), 0.0])
            position[2] = rng.uniform(1.0, 6.0)
            track.append(gate(number, *position, yaw))
        limits = Limits(5.0, 8.0, 3.0)
        request = PlanRequest(0.0, at_rest((-3, 0, 2)), tuple(track), position + np.array([3.0, 0.0, 0.0]), limits)
        trajectory = PLANNER.plan(request)
        keeps_limits(trajectory, limits)
        assert crossing_angles(trajectory, request).max() <= 65.0 + 1e-6, seed


def test_an_arrival_with_motion_is_met_and_jerk_is_continuous():
    arrival = np.array([[2.0, 1.0, 0.0], [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]])
    request = dataclasses.replace(GOOD, arrival=arrival)
    trajectory = PLANNER.plan(request)
    keeps_limits(trajectory, request.limits)
    end = trajectory.sample(trajectory.duration)
    np.testing.assert_allclose([end.velocity, end.acceleration, end.jerk], arrival, atol=1e-6)
    inner = trajectory.knots[1:-1]
    before, after = trajectory.sample(inner - 1e-9), trajectory.sample(inner + 1e-9)
    np.testing.assert_allclose(before.jerk, after.jerk, atol=1e-4)


def test_a_vehicle_that_cannot_lift_itself_is_refused_with_the_mend():
    weak = PolynomialPlanner(Config(planning=Planning(thrust_share=0.3)))
    with pytest.raises(PlanningError, match=r"raise planning\.thrust_share"):
        weak.plan(GOOD)


def test_staying_is_a_short_plan_at_rest():
    request = PlanRequest(3.0, at_rest((1, 2, 3), 0.7), (), np.array([1.0, 2.0, 3.0]), Limits(4.0, 8.0, 3.0))
    trajectory = PLANNER.plan(request)
    assert 0.0 < trajectory.duration < 1.0
    samples = trajectory.sample(np.linspace(0.0, trajectory.duration, 5))
    np.testing.assert_allclose(samples.position, np.tile([1.0, 2.0, 3.0], (5, 1)))
    np.testing.assert_allclose(samples.yaw, 0.7)


def test_stopping_returns_to_the_end():
    start = Motion(np.array([0.0, 0.0, 2.0]), np.array([3.0, 0.0, 0.0]), ZERO, ZERO, 0.0, 0.0)
    limits = Limits(4.0, 8.0, 3.0)
    trajectory = PLANNER.plan(PlanRequest(0.0, start, (), start.position, limits))
    keeps_limits(trajectory, limits)
    np.testing.assert_allclose(trajectory.sample(trajectory.duration).position, start.position, atol=1e-8)


@pytest.mark.parametrize("gap", [1e-4, 0.02, 0.2])
def test_a_start_close_to_the_gate(gap):
    limits = Limits(4.0, 8.0, 3.0)
    gates = (gate(3, gap, 0, 1.5, 0.0), gate(4, 6, 2, 1.5, 0.5))
    for speed in (0.0, 3.0):
        start = Motion(np.array([0.0, 0.0, 1.5]), np.array([speed, 0.0, 0.0]), ZERO, ZERO, 0.0, 0.0)
        trajectory = PLANNER.plan(PlanRequest(0.0, start, gates, np.array([9.0, 4.0, 1.5]), limits))
        keeps_limits(trajectory, limits)
        assert trajectory.gate_ids == (3, 4)
        assert (trajectory.gate_times[0] == 0.0) == (gap < 1e-3)


def test_the_end_may_be_in_the_last_gate():
    limits = Limits(4.0, 8.0, 3.0)
    request = PlanRequest(0.0, at_rest((0, 0, 1)), (gate(1, 5, 0, 1, 0.0),), np.array([5.0, 0.0, 1.0]), limits)
    trajectory = PLANNER.plan(request)
    assert trajectory.gate_times == (trajectory.duration,)


def test_neighbouring_waypoints_that_are_one_are_flown_once():
    waypoints = np.array([[2.0, 0, 1], [2.0, 0, 1.0000001], [4.0, 1, 1], [4.0, 1, 1]])
    request = PlanRequest(0.0, at_rest((0, 0, 1)), (), np.array([4.0, 1.0, 1.0]), Limits(2.0, 8.0, 3.0))
    trajectory = PLANNER.through(waypoints, request)
    places = trajectory.sample(trajectory.knots).position
    assert np.sum(np.linalg.norm(places - [2.0, 0.0, 1.0], axis=1) < 1e-9) == 1
    assert trajectory.duration < 5.0


GOOD = request_for(FIVE_GATES)
NAN = np.array([0.0, math.nan, 1.0])
FAST = Motion(ZERO, np.array([5.0, 0.0, 0.0]), ZERO, ZERO, 0.0, 0.0)
TWICE = (gate(1, 1, 0, 1, 0.0), gate(2, 1, 0, 1, 0.0))


@pytest.mark.parametrize(
    "change, words",
    [
        ({"limits": Limits(0.0, 8.0, 3.0)}, "v_max must be positive"),
        ({"limits": Limits(4.0, math.nan, 3.0)}, "a_max must be positive"),
        ({"limits": Limits(4.0, 8.0, -1.0)}, "yaw_rate_max must be positive"),
        ({"start": dataclasses.replace(GOOD.start, position=NAN)}, "the start is not finite"),
        ({"start": dataclasses.replace(GOOD.start, jerk=NAN)}, "the start's jerk is not finite"),
        ({"start": dataclasses.replace(GOOD.start, yaw=math.inf)}, "heading is not finite"),
        ({"start": FAST}, "5.00 m/s, faster than v_max = 4"),
        ({"end": np.array([1.0, 2.0])}, "the end must have three coordinates"),
        ({"look_at": NAN}, "the point to look at is not finite"),
        ({"gates": (gate(8, 1, 0, math.inf, 0.0),)}, "gate 8 is not finite"),
        ({"gates": (gate(8, 1, 0, 1, math.nan),)}, "gate 8: its yaw"),
        ({"gates": TWICE}, "gate 1 and gate 2 are at the same point"),
        ({"stamp": math.nan}, "start time"),
        ({"limits": Limits(4.0, 8.0, math.inf)}, "yaw_rate_max must be finite"),
        ({"arrival": np.zeros(3)}, "the arrival must be velocity, acceleration and jerk"),
        ({"arrival": np.array([[9.0, 0.0, 0.0], ZERO, ZERO])}, "the arrival is flown at 9.00 m/s"),
    ],
)
def test_bad_requests_are_refused_in_clear_words(change, words):
    with pytest.raises(PlanningError, match=words):
        PLANNER.plan(dataclasses.replace(GOOD, **change))


@pytest.mark.parametrize(
    "waypoints, words",
    [
        (np.empty((0, 3)), "no waypoints"),
        (np.ones((3, 2)), "three coordinates"),
        (np.array([[1.0, 2.0, 3.0], NAN]), "waypoint 1 is not finite"),
    ],
)
def test_bad_waypoints_are_refused_in_clear_words(waypoints, words):
    with pytest.raises(PlanningError, match=words):
        PLANNER.through(waypoints, GOOD)


def test_a_start_that_no_plan_can_obey_is_refused_with_its_excess():
    start = dataclasses.replace(motion_at(PLANNER.plan(GOOD), 3.0), acceleration=np.array([20.0, 0.0, 0.0]))
    with pytest.raises(PlanningError, match=r"20.00 m/s² of acceleration, a_max = 8"):
        PLANNER.plan(dataclasses.replace(GOOD, start=start))
