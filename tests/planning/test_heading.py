"""Where the camera looks."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planning_tracks import (
    FIVE_GATES,
    FOUR_GATES,
    TRACKS,
    at_rest,
    gate,
    lap_request,
    lemniscate,
    replan_request,
    request_for,
)
from scipy.interpolate import CubicSpline

from flightapp.config import Config, load_config
from flightapp.frames import wrap_angle
from flightapp.interfaces import Limits, Motion, PlanRequest
from flightapp.planning.facing import Heading
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.trajectory import ORDER

PLANNER = PolynomialPlanner(Config())
HALF_VIEW = math.atan(0.5 * Config().camera.width / Config().camera.focal[0])
"""rad, half the camera's horizontal field of view."""
NEAR = 1.5
"""m from a gate within which it need not be looked at."""


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


def legs(request, trajectory):
    """Of each leg to a gate: the times since the one before was passed at which it should be looked at; the gate."""
    before = 0.0
    for g, passed in zip(request.gates, trajectory.gate_times, strict=True):
        times = np.arange(before, passed, 2e-3)
        away = np.linalg.norm(trajectory.sample(times).position - g.position, axis=1) > NEAR
        yield times[away], times[away] - before, g
        before = passed


@pytest.mark.parametrize("v_max", [1.0, 4.0, 10.0])
@pytest.mark.parametrize("track", TRACKS)
def test_the_next_gate_is_in_view_a_tenth_of_a_second_after_the_last(track, v_max):
    request = request_for(TRACKS[track], v_max=v_max, a_max=20.0)
    trajectory = PLANNER.plan(request)
    pieces_join(trajectory)
    for times, since, g in legs(request, trajectory):
        late = since > 0.1
        assert late.any()
        assert bearing_errors(trajectory, times[late], g.position).max() < HALF_VIEW


@pytest.mark.parametrize("rate_max", [0.6, 1.0, 1.5])
def test_while_the_next_gate_is_out_of_view_the_drone_turns_as_fast_as_it_may(rate_max):
    request = request_for(FOUR_GATES, v_max=6.0, a_max=20.0, yaw_rate_max=rate_max)
    trajectory = PLANNER.plan(request)
    seen_late = 0
    for times, since, g in legs(request, trajectory):
        errors = bearing_errors(trajectory, times, g.position)
        out = (errors > HALF_VIEW) & (since > 2.0 * rate_max / Config().planning.yaw_acceleration)
        rates = np.abs(trajectory.sample(times[out]).yaw_rate)
        np.testing.assert_allclose(rates, rate_max)
        seen_late += out.sum()
    assert seen_late > 0


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


def curve(seed, duration):
    """Knots and coefficients of a random smooth path, and the gates at its inner knots."""
    rng = np.random.default_rng(seed)
    knots = np.concatenate(((0.0,), np.sort(rng.uniform(0.1, 1.0, rng.integers(1, 6))), (1.1,))) * duration
    points = rng.normal(0.0, 6.0, (knots.size, 3))
    coefficients = np.zeros((knots.size - 1, 3, ORDER))
    coefficients[:, :, :4] = CubicSpline(knots, points, bc_type="clamped").c[::-1].transpose(1, 2, 0)
    gates = tuple(gate(i, *point, 0.0) for i, point in enumerate(points[1:-1]))
    return knots, coefficients, gates, points


@given(
    st.integers(0, 10_000),
    st.sampled_from(["gates", "path", "fixed"]),
    st.floats(0.5, 30.0),
    st.floats(0.2, 15.0),
    st.floats(0.2, 100.0),
    st.floats(-10.0, 10.0),
    st.floats(-4.0, 4.0),
    st.booleans(),
)
def test_every_heading_is_smooth_and_keeps_its_limits(seed, mode, duration, rate, acceleration, yaw, yaw_rate, watch):
    heading = Heading(load_config(None, {"planning.yaw": mode, "planning.yaw_acceleration": acceleration}))
    knots, coefficients, gates, points = curve(seed, duration)
    zero = np.zeros(3)
    start = Motion(points[0], zero, zero, zero, yaw, yaw_rate)
    look_at = points[0] + 3.0 if watch else None
    request = PlanRequest(5.0, start, gates, points[-1], Limits(9.0, 9.0, rate), look_at)
    trajectory = heading.complete(knots, coefficients, tuple(knots[1:-1]), request)
    assert trajectory.stamp == 5.0
    assert trajectory.gate_ids == tuple(g.gate_id for g in gates)
    assert np.all(np.isfinite(trajectory.yaw_coefficients))
    assert np.diff(trajectory.yaw_knots).min() > 0.0
    assert trajectory.yaw_knots[-1] >= knots[-1]
    pieces_join(trajectory)
    first, last = trajectory.sample(0.0), trajectory.sample(float(trajectory.yaw_knots[-1]))
    assert (first.yaw, first.yaw_rate) == (yaw, yaw_rate)
    assert abs(last.yaw_rate) < 1e-9
    peaks = trajectory.limits()
    assert peaks.yaw_rate <= max(rate, abs(yaw_rate)) * (1.0 + 1e-9)
    assert peaks.yaw_acceleration <= acceleration * (1.0 + 1e-9)


@pytest.mark.parametrize("mode", ["gates", "path", "fixed"])
def test_dense_samples_keep_the_limits_too(mode):
    planner = PolynomialPlanner(load_config(None, {"planning.yaw": mode, "planning.yaw_acceleration": 4.0}))
    trajectory = planner.plan(request_for(FIVE_GATES, v_max=6.0, yaw_rate_max=1.0))
    step = 1e-3
    rates = trajectory.sample(np.arange(0.0, trajectory.yaw_knots[-1], step)).yaw_rate
    assert np.abs(rates).max() <= 1.0 + 1e-9
    assert np.abs(np.diff(rates)).max() <= 4.0 * step * (1.0 + 1e-9)
    assert (np.abs(rates).max() > 0.99) == (mode != "fixed")


def test_fixed_keeps_the_heading_and_first_stops_a_turn():
    planner = PolynomialPlanner(load_config(None, {"planning.yaw": "fixed", "planning.yaw_acceleration": 4.0}))
    request = request_for(FIVE_GATES)
    held = planner.plan(dataclasses.replace(request, start=at_rest(FIVE_GATES[0], 0.7)))
    assert set(held.sample(np.linspace(0.0, held.duration, 50)).yaw) == {0.7}
    turning = dataclasses.replace(request, start=dataclasses.replace(at_rest(FIVE_GATES[0], 0.7), yaw_rate=-2.0))
    samples = planner.plan(turning).sample(np.array([0.25, 0.5, 3.0]))
    np.testing.assert_allclose(samples.yaw_rate, [-1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(samples.yaw[1:], 0.7 - 0.5, atol=1e-12)


def test_path_looks_along_the_velocity_through_gates_as_well():
    planner = PolynomialPlanner(load_config(None, {"planning.yaw": "path"}))
    trajectory = planner.plan(request_for(FIVE_GATES))
    samples = trajectory.sample(np.linspace(1.0, trajectory.duration - 1.0, 200))
    path = np.arctan2(samples.velocity[:, 1], samples.velocity[:, 0])
    errors = [abs(wrap_angle(float(e))) for e in samples.yaw - path]
    assert np.degrees(np.max(errors)) < 6.0
    assert len(trajectory.gate_times) == 5


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
