"""What race lines must keep to, and how fast they are."""

import math
from dataclasses import replace

import numpy as np
import pytest
from planning_tracks import (
    FIVE_GATES,
    FIVE_GATES_LOOP,
    FOUR_GATES,
    ZERO,
    at_rest,
    crossing_angles,
    gate,
    lemniscate,
    replan_request,
    request_for,
)

from flightapp.config import Config, Planning, Vehicle
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.planning import race
from flightapp.planning.clearance import touched
from flightapp.planning.obstacles import Margins
from flightapp.planning.race import RacePlanner
from flightapp.track import Cylinder, GateShape

YARDSTICK = Config(
    vehicle=Vehicle(thrust_to_weight=2.8, rate_max=6.0, drag=(0.0, 0.0, 0.0)),
    planning=Planning(thrust_share=1.0, rate_share=1.0, waypoint_radius=0.3, tilt_max_deg=180.0),
)
SURE = 1e-6 * np.eye(4)
LAP = (-0.5, -2.0, 1.0)
LEMNISCATE = lemniscate(8)
ROWS = [
    (LEMNISCATE, 3.0, 10.23),
    (LEMNISCATE, 7.0, 4.94),
    (LEMNISCATE, math.inf, 4.33),
    (FIVE_GATES, 2.0, 24.98),
    (FIVE_GATES, 4.0, 12.72),
    (FIVE_GATES, 10.0, 5.63),
    (FIVE_GATES, math.inf, 4.25),
    (FIVE_GATES_LOOP, 4.0, 17.42),
    ((LAP, FOUR_GATES[1], LAP), 1.0, 11.89),
    ((LAP, FOUR_GATES[1], LAP), 4.0, 3.33),
]
PLANNER, FREE = RacePlanner(YARDSTICK), RacePlanner(Config())


def points_of(track):
    if isinstance(track, np.ndarray):
        return track
    start, rows, end = track
    return np.array([start, *(row[:3] for row in rows), end], float)


def with_shape(request, **others):
    gates = tuple(replace(g, covariance=SURE) for g in request.gates)
    return replace(request, gates=gates, shape=GateShape(), **others)


def keeps(trajectory, request, config):
    peaks = trajectory.limits()
    assert peaks.speed <= 1.001 * request.limits.v_max
    assert peaks.acceleration <= 1.001 * request.limits.a_max
    assert peaks.specific_force <= 1.001 * config.planning.thrust_share * config.vehicle.thrust_max
    assert peaks.specific_force_min >= config.guard.thrust_min / 1.001
    assert peaks.body_rate <= 1.001 * config.planning.rate_share * config.vehicle.rate_max


@pytest.mark.parametrize("track, v_max, optimum", ROWS)
def test_race_lines_take_little_more_than_the_optimum(track, v_max, optimum):
    points = points_of(track)
    limits = Limits(v_max, math.inf, 3.0)
    request = PlanRequest(0.0, at_rest(points[0]), (), points[-1], limits)
    trajectory = PLANNER.through(points[1:-1], request)
    assert trajectory.duration <= (1.06 if math.isinf(v_max) else 1.03) * optimum
    keeps(trajectory, request, YARDSTICK)
    line = trajectory.sample(np.linspace(0.0, trajectory.duration, 20_000)).position
    for point in points[1:-1]:
        assert np.linalg.norm(line - point, axis=1).min() <= 0.301


@pytest.mark.parametrize("track", [FIVE_GATES, FIVE_GATES_LOOP])
def test_gates_with_a_shape_are_crossed_within_their_area_and_direction(track):
    request = with_shape(request_for(track, v_max=6.0))
    trajectory = FREE.plan(request)
    keeps(trajectory, request, Config())
    offsets = []
    for g, passed in zip(request.gates, trajectory.gate_times, strict=True):
        offset = trajectory.sample(passed).position - g.position
        assert abs(offset[0] * math.cos(g.yaw) + offset[1] * math.sin(g.yaw)) < 1e-4
        offsets.append(float(np.linalg.norm(offset)))
    assert 0.1 < max(offsets) <= 0.303
    assert crossing_angles(trajectory, request).max() <= 25.5
    assert trajectory.duration < FREE.plan(request_for(track, v_max=6.0)).duration


def test_an_unsure_gate_is_crossed_nearer_to_its_centre():
    request = with_shape(request_for(FIVE_GATES, v_max=6.0))
    vague = replace(request, gates=tuple(replace(g, covariance=0.16**2 * np.eye(4)) for g in request.gates))
    trajectory = FREE.plan(vague)
    for g, passed in zip(vague.gates, trajectory.gate_times, strict=True):
        assert np.linalg.norm(trajectory.sample(passed).position - g.position) <= 0.14


@pytest.mark.parametrize("v_max", [4.0, 10.0])
@pytest.mark.parametrize("moved", [0.0, 0.05, 0.2])
def test_replans_take_over_and_lose_little(v_max, moved):
    rng = np.random.default_rng(3)
    request = with_shape(request_for(FIVE_GATES, v_max=v_max))
    lost, refused = [], 0
    for part in (0.05, 0.2, 0.35, 0.5, 0.65):
        plan = FREE.plan(request)
        t = part * plan.duration
        after = min((passed - t for passed in plan.gate_times if passed > t), default=1.0)
        t = t if after > 0.8 else t + after + 0.01
        again = with_shape(replan_request(request, plan, t))
        again = replace(
            again, gates=tuple(replace(g, position=g.position + moved * rng.normal(size=3)) for g in again.gates)
        )
        try:
            trajectory = FREE.plan(again)
        except PlanningError:
            refused += 1
            continue
        keeps(trajectory, again, Config())
        begun = trajectory.sample(0.0)
        for name in ("position", "velocity", "acceleration", "jerk"):
            np.testing.assert_allclose(getattr(begun, name), getattr(again.start, name), atol=1e-9)
        lost.append(trajectory.duration - (plan.duration - t))
    assert refused <= 1
    assert np.mean(lost) <= 0.02 + 2.0 * moved


def test_a_plan_in_flight_does_not_need_the_plan_before():
    request = with_shape(request_for(FIVE_GATES, v_max=4.0))
    plan = FREE.plan(request)
    again = with_shape(replan_request(request, plan, 0.3 * plan.duration))
    trajectory = RacePlanner(Config()).plan(again)
    keeps(trajectory, again, Config())
    assert trajectory.duration <= 0.7 * plan.duration + 0.5


def test_a_plan_may_arrive_in_motion():
    arrival = np.array([[2.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.0]])
    request = replace(with_shape(request_for(FIVE_GATES)), end=np.array([-12.0, 8.0, 1.0]), arrival=-arrival)
    trajectory = FREE.plan(request)
    ended = trajectory.sample(trajectory.duration)
    np.testing.assert_allclose(ended.velocity, request.arrival[0], atol=1e-6)
    np.testing.assert_allclose(ended.acceleration, request.arrival[1], atol=1e-5)
    keeps(trajectory, request, Config())


def test_a_pillar_in_the_way_is_flown_around():
    pillar = Cylinder(name="pillar", base=(5.0, 0.1, 0.0), radius=0.3, height=5.0)
    limits = Limits(4.0, 8.0, 3.0)
    request = PlanRequest(0.0, at_rest((0, 0, 1.5)), (gate(1, 10, 0, 1.5, 0.0),), np.array([13.0, 0.0, 1.5]), limits)
    straight, around = FREE.plan(request), FREE.plan(replace(request, obstacles=(pillar,)))
    line = around.sample(np.linspace(0.0, around.duration, 2000)).position
    planning, radius = Config().planning, Config().vehicle.radius
    assert np.hypot(line[:, 0] - 5.0, line[:, 1] - 0.1).min() >= 0.3 + planning.clearance + radius - 0.01
    assert straight.duration < around.duration <= straight.duration + 1.0


def test_the_frame_of_a_gate_that_is_not_flown_through_is_kept_clear_of():
    behind, side = replace(gate(7, 5, 1.0, 1.5, 0.0), covariance=SURE), GateShape()
    gates = (replace(gate(1, 10, 0, 1.5, 0.0), covariance=SURE),)
    limits, margins = Limits(4.0, 8.0, 3.0), Margins.of(Config())
    request = PlanRequest(0.0, at_rest((0, 0, 1.5)), gates, np.array([13.0, 0.0, 1.5]), limits, shape=side)
    without, around = FREE.plan(request), FREE.plan(replace(request, frames=(behind,)))
    assert touched(without, (behind,), side, (), margins) is not None
    assert touched(around, (behind,), side, (), margins) is None
    assert around.duration <= without.duration + 1.0
    keeps(around, request, Config())


def test_where_the_search_fails_the_line_stops_at_corners_and_keeps_all_limits(monkeypatch):
    request = with_shape(request_for(FIVE_GATES, v_max=6.0))
    whole = FREE.plan(request)
    monkeypatch.setattr(race, "SLOWER", ())
    halting = FREE.plan(request)
    keeps(halting, request, Config())
    assert touched(halting, request.gates, request.shape, (), Margins.of(Config())) is None
    assert crossing_angles(halting, request).max() <= 0.1
    for g, passed in zip(request.gates, halting.gate_times, strict=True):
        np.testing.assert_allclose(halting.sample(passed).position, g.position, atol=1e-6)
    assert whole.duration < halting.duration < 4.0 * whole.duration


def test_drag_counts_as_thrust():
    windy = Config(vehicle=Vehicle(thrust_to_weight=2.8, drag=(0.4, 0.4, 0.4)), planning=Planning(drag_share=1.0))
    request = with_shape(request_for(FIVE_GATES, v_max=math.inf, a_max=math.inf))
    trajectory = RacePlanner(windy).plan(request)
    samples = trajectory.sample(np.linspace(0.0, trajectory.duration, 5000))
    force = samples.acceleration + 0.4 * samples.velocity + np.array([0.0, 0.0, 9.80665])
    assert np.linalg.norm(force, axis=1).max() <= 1.001 * windy.planning.thrust_share * windy.vehicle.thrust_max
    still = RacePlanner(windy.model_copy(update={"vehicle": Vehicle(thrust_to_weight=2.8, drag=(0.0, 0.0, 0.0))}))
    assert still.plan(request).duration < trajectory.duration


def test_tilt_is_limited():
    tilted = Config(planning=Planning(tilt_max_deg=35.0))
    request = with_shape(request_for(FIVE_GATES, v_max=8.0, a_max=20.0))
    assert math.degrees(RacePlanner(tilted).plan(request).limits().tilt) <= 36.5


def test_staying_is_a_short_plan_at_rest():
    request = PlanRequest(3.0, at_rest((1, 2, 3), 0.7), (), np.array([1.0, 2.0, 3.0]), Limits(4.0, 8.0, 3.0))
    trajectory = FREE.plan(request)
    assert 0.0 < trajectory.duration < 1.0
    samples = trajectory.sample(np.linspace(0.0, trajectory.duration, 5))
    np.testing.assert_allclose(samples.position, np.tile([1.0, 2.0, 3.0], (5, 1)))


def test_stopping_returns_to_the_end():
    start = Motion(np.array([0.0, 0.0, 2.0]), np.array([3.0, 0.0, 0.0]), ZERO, ZERO, 0.0, 0.0)
    request = PlanRequest(0.0, start, (), start.position, Limits(4.0, 8.0, 3.0))
    trajectory = FREE.plan(request)
    keeps(trajectory, request, Config())
    np.testing.assert_allclose(trajectory.sample(trajectory.duration).position, start.position, atol=1e-8)


def test_too_little_thrust_is_told():
    weak = Config(vehicle=Vehicle(thrust_to_weight=1.5), planning=Planning(thrust_share=0.5), race={"a_max": 3.0})
    with pytest.raises(PlanningError, match="does not lift the vehicle"):
        RacePlanner(weak).plan(request_for(FIVE_GATES))


def test_a_dive_that_cannot_be_ended_above_the_floor_is_refused():
    diving = Motion(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -4.0]), ZERO, ZERO, 0.0, 0.0)
    request = PlanRequest(0.0, diving, (gate(1, 5, 0, 1.0, 0.0),), np.array([8.0, 0.0, 1.0]), Limits(4.0, 4.0, 3.0))
    with pytest.raises(PlanningError, match="least height"):
        FREE.plan(request)
