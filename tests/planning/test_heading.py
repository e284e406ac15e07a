"""Where the camera looks."""

import dataclasses
import math

import numpy as np
import pytest
from planning_tracks import FIVE_GATES, TRACKS, at_rest, lap_request, lemniscate, replan_request, request_for

from flightapp.config import Config
from flightapp.frames import wrap_angle
from flightapp.interfaces import Limits, Motion, PlanRequest
from flightapp.planning.polynomial import PolynomialPlanner

PLANNER = PolynomialPlanner(Config())


def bearing_errors(trajectory, times, target):
    samples = trajectory.sample(times)
    rows = np.asarray(target) - samples.position
    bearings = np.arctan2(rows[:, 1], rows[:, 0])
    return np.array([abs(wrap_angle(float(e))) for e in samples.yaw - bearings])


def pieces_join(trajectory):
    steps = np.diff(trajectory.yaw_knots)[:-1]
    c0, c1, c2, c3 = trajectory.yaw_coefficients[:-1].T
    ends = c0 + steps * (c1 + steps * (c2 + steps * c3))
    rates = c1 + steps * (2.0 * c2 + 3.0 * steps * c3)
    np.testing.assert_allclose(ends, trajectory.yaw_coefficients[1:, 0], atol=1e-9)
    np.testing.assert_allclose(rates, trajectory.yaw_coefficients[1:, 1], atol=1e-9)


@pytest.mark.parametrize("track", TRACKS)
def test_the_next_gate_is_in_view_from_soon_after_the_last(track):
    request = request_for(TRACKS[track])
    trajectory = PLANNER.plan(request)
    pieces_join(trajectory)
    before = 0.0
    for g, passed in zip(request.gates, trajectory.gate_times, strict=True):
        times = np.linspace(before + 0.6, passed, 60)
        away = np.linalg.norm(trajectory.sample(times).position - g.position, axis=1) > 1.5
        if before > 0.0 and away.any():
            assert np.degrees(bearing_errors(trajectory, times[away], g.position)).max() < 30.0
        before = passed


def test_the_heading_starts_as_asked_and_does_not_jump_by_a_turn():
    request = request_for(FIVE_GATES)
    start = dataclasses.replace(request.start, yaw=3.0 * math.pi, yaw_rate=-1.0)
    trajectory = PLANNER.plan(dataclasses.replace(request, start=start))
    first = trajectory.sample(0.0)
    assert first.yaw == pytest.approx(3.0 * math.pi, abs=1e-12)
    assert first.yaw_rate == pytest.approx(-1.0, abs=1e-12)
    yaws = trajectory.sample(np.arange(0.0, trajectory.duration, 1e-3)).yaw
    assert np.abs(np.diff(yaws)).max() <= 1.001 * 3.0e-3
    pieces_join(trajectory)


def test_after_the_last_gate_it_looks_where_it_is_told():
    watched = np.array([-10.0, -10.0, 1.0])
    trajectory = PLANNER.plan(request_for(FIVE_GATES, look_at=watched))
    last = trajectory.gate_times[-1]
    times = np.linspace(last + 1.5, trajectory.duration, 40)
    assert np.degrees(bearing_errors(trajectory, times, watched)).max() < 5.0


def test_along_waypoints_it_looks_along_the_path_and_rests_with_the_last_heading():
    waypoints = lemniscate(16)
    trajectory = PLANNER.through(waypoints, lap_request(waypoints, 3.0, 8.0))
    times = np.linspace(1.5, trajectory.duration - 1.0, 100)
    samples = trajectory.sample(times)
    path = np.arctan2(samples.velocity[:, 1], samples.velocity[:, 0])
    errors = [abs(wrap_angle(float(e))) for e in samples.yaw - path]
    assert np.degrees(np.max(errors)) < 6.0
    end = trajectory.sample(float(trajectory.yaw_knots[-1]))
    assert abs(end.yaw_rate) < 1e-9
    assert abs(wrap_angle(float(end.yaw - path[-1]))) < 0.5


@pytest.mark.parametrize("rate_max", [0.3, 1.0, 3.0])
def test_the_heading_turns_no_faster_than_allowed(rate_max):
    trajectory = PLANNER.plan(request_for(FIVE_GATES, yaw_rate_max=rate_max))
    times = np.arange(0.0, trajectory.yaw_knots[-1], 1e-3)
    assert np.abs(trajectory.sample(times).yaw_rate).max() <= rate_max * (1.0 + 1e-9)


def test_a_replan_in_a_turn_goes_on_turning():
    request = request_for(FIVE_GATES)
    plan = PLANNER.plan(request)
    t = plan.gate_times[1] + 0.1
    after = PLANNER.plan(replan_request(request, plan, t))
    assert after.sample(0.0).yaw_rate == pytest.approx(float(plan.sample(t).yaw_rate), abs=1e-9)


def test_a_turn_on_the_spot_settles_after_the_end():
    start = Motion(*([np.array([1.0, 1.0, 1.0])] + [np.zeros(3)] * 3), 0.0, 0.0)
    request = PlanRequest(0.0, start, (), start.position, Limits(4.0, 8.0, 2.0), np.array([-5.0, 1.0, 1.0]))
    trajectory = PLANNER.plan(request)
    end = trajectory.sample(float(trajectory.yaw_knots[-1]))
    assert abs(wrap_angle(float(end.yaw) - math.pi)) < 0.02
    assert abs(end.yaw_rate) < 1e-9


def test_a_target_overhead_does_not_turn_the_drone():
    request = PlanRequest(
        0.0, at_rest((0, 0, 1), 0.4), (), np.array([0.0, 0.0, 3.0]), Limits(2.0, 8.0, 2.0), np.array([0.0, 0.0, 6.0])
    )
    trajectory = PLANNER.plan(request)
    np.testing.assert_allclose(trajectory.sample(np.linspace(0.0, trajectory.duration, 20)).yaw, 0.4)
