import math
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from planning_tracks import at_rest, gate

from flightapp.config import Config, Planning, Vehicle
from flightapp.evaluation.plan_table import yardsticks
from flightapp.frames import GRAVITY, quat_multiply, quat_to_matrix
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.planning import time_optimal
from flightapp.planning.time_optimal import OptimalPlanner
from flightapp.planning.time_optimal_rotors import SIGNS, Airframe
from flightapp.planning.time_optimal_spline import peaks_of
from flightapp.track import Box, GateShape
from flightapp.trajectory_files import load_trajectory

CONFIG = Config(
    vehicle=Vehicle(thrust_to_weight=2.8),
    planning=Planning(thrust_share=1.0, rate_share=1.0, waypoint_radius=0.3),
)
AIRFRAME = Airframe.of(CONFIG.vehicle)
ROTOR_MAX = CONFIG.vehicle.thrust_max / 4.0
STORED = Path(__file__).parents[2] / "missions" / "tracks" / "optimal"
FREE = Limits(math.inf, math.inf, 3.0)
TOLERATED = 1.001


def request(end, limits=FREE, start=(0.0, 0.0, 2.0), **others):
    return PlanRequest(0.0, at_rest(start), (), np.array(end, float), limits, **others)


def keeps_to_the_limits(trajectory, limits):
    peaks = trajectory.limits()
    assert peaks.speed <= TOLERATED * limits.v_max
    assert peaks.acceleration <= TOLERATED * limits.a_max
    assert peaks.specific_force <= TOLERATED * CONFIG.vehicle.thrust_max
    assert peaks.specific_force_min >= CONFIG.guard.thrust_min - 1e-3 * CONFIG.vehicle.thrust_max
    assert peaks.body_rate <= TOLERATED * CONFIG.vehicle.rate_max
    rotors = peaks_of(trajectory.knots, trajectory.coefficients, AIRFRAME)
    assert rotors[:, 4].max() <= TOLERATED * ROTOR_MAX
    assert rotors[:, 6].min() >= -1e-3 * ROTOR_MAX


@pytest.fixture(autouse=True, scope="module")
def coarse():
    """Fewer nodes make these tests quick."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time_optimal, "MOST", 12)
        yield


@pytest.fixture(scope="module")
def turn(coarse):
    """Past a waypoint and back: a sharp turn, with no limit of the speed."""
    pytest.importorskip("casadi")
    waypoints = np.array([(8.0, 1.0, 3.0)])
    return OptimalPlanner(CONFIG).solve(request((0.0, 3.0, 2.0)), waypoints), waypoints


def test_straight_up_takes_what_full_and_least_thrust_allow():
    pytest.importorskip("casadi")
    up, brake = CONFIG.vehicle.thrust_max - GRAVITY, GRAVITY - CONFIG.guard.thrust_min
    shortest = math.sqrt(2.0 * 12.0 * (1.0 / up + 1.0 / brake))
    found = OptimalPlanner(CONFIG).yardstick(request((0.0, 0.0, 14.0)), np.array([(0.0, 0.0, 8.0)]))
    assert found.duration == pytest.approx(shortest, rel=0.01)


def test_straight_up_with_a_limit_of_the_speed():
    pytest.importorskip("casadi")
    up, brake, v_max = CONFIG.vehicle.thrust_max - GRAVITY, GRAVITY - CONFIG.guard.thrust_min, 4.0
    shortest = 12.0 / v_max + 0.5 * v_max * (1.0 / up + 1.0 / brake)
    limits = replace(FREE, v_max=v_max)
    found = OptimalPlanner(CONFIG).yardstick(request((0.0, 0.0, 14.0), limits), np.array([(0.0, 0.0, 8.0)]))
    assert found.duration == pytest.approx(shortest, rel=0.01)


def test_a_plan_keeps_to_all_limits_and_passes_its_areas(turn):
    found, waypoints = turn
    trajectory = found.trajectory
    keeps_to_the_limits(trajectory, FREE)
    assert found.yardstick.duration <= trajectory.duration < 1.06 * found.yardstick.duration
    path = trajectory.sample(np.arange(0.0, trajectory.duration, 1e-3)).position
    for waypoint in waypoints:
        assert np.linalg.norm(path - waypoint, axis=1).min() <= 0.301
    ends = trajectory.sample(np.array([0.0, trajectory.duration]))
    np.testing.assert_allclose(ends.position, [(0.0, 0.0, 2.0), (0.0, 3.0, 2.0)], atol=1e-9)
    for derivative in (ends.velocity, ends.acceleration, ends.jerk):
        np.testing.assert_allclose(derivative, 0.0, atol=1e-6)


def test_a_plan_uses_all_thrust_and_all_rate(turn):
    peaks = turn[0].trajectory.limits()
    assert peaks.specific_force > 0.95 * CONFIG.vehicle.thrust_max
    assert peaks.body_rate > 0.95 * CONFIG.vehicle.rate_max


def test_position_to_jerk_are_continuous(turn):
    trajectory = turn[0].trajectory
    after, h = trajectory.coefficients[1:], np.diff(trajectory.knots)[:-1]
    for d, tolerance in enumerate((1e-9, 1e-9, 1e-7, 1e-5)):
        factors = np.array([math.perm(m, d) for m in range(8)])
        powers = h[:, None] ** np.maximum(np.arange(8) - d, 0)
        before = np.einsum("nam,nm->na", trajectory.coefficients[:-1], factors * powers)
        np.testing.assert_allclose(before, math.factorial(d) * after[:, :, d], atol=tolerance)


def test_a_rigid_body_driven_by_the_four_rotors_flies_the_plan(turn):
    """Newton and Euler for a body, a mixer of its own, and nothing that corrects where it is."""
    trajectory, vehicle = turn[0].trajectory, CONFIG.vehicle
    (ahead, beside), (s, t) = vehicle.rotor, SIGNS.T
    inertia, thrusts = np.array(vehicle.inertia) / vehicle.mass, []

    def motion(x, time):
        body, rates = quat_to_matrix(x[6:10] / np.linalg.norm(x[6:10])), x[10:13]
        sample = trajectory.sample(time)
        force = sample.acceleration + np.array([0.0, 0.0, GRAVITY])
        thrust = np.linalg.norm(force)
        z = force / thrust
        growth = sample.jerk @ z
        turning = (sample.jerk - growth * z) / thrust
        bend = (sample.snap - 2.0 * growth * turning) / thrust
        wanted, spin_up = body.T @ np.cross(z, turning), body.T @ np.cross(z, bend)
        f = AIRFRAME.thrusts(np.array([thrust]), wanted[None, :2], spin_up[None, :2])[0]
        thrusts.append(f)
        torque = np.array([beside * t @ f, -ahead * s @ f, vehicle.torque_ratio * (s * t) @ f])
        turn_rate = 0.5 * quat_multiply(x[6:10], np.append(0.0, rates))
        pull = body[:, 2] * f.sum() - (0.0, 0.0, GRAVITY)
        return np.concatenate((x[3:6], pull, turn_rate, (torque - np.cross(rates, inertia * rates)) / inertia))

    x = np.zeros(13)
    x[:3], x[6] = trajectory.sample(0.0).position, 1.0
    for begin, end in pairwise(trajectory.knots):
        steps = math.ceil((end - begin) / 4e-3)
        h = (end - begin) / steps
        for time in begin + h * np.arange(steps):
            last = min(time + h, end - 1e-9)  # the snap jumps at knots
            k1 = motion(x, time)
            k2 = motion(x + 0.5 * h * k1, time + 0.5 * h)
            k3 = motion(x + 0.5 * h * k2, time + 0.5 * h)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + motion(x + h * k3, last))
            assert np.linalg.norm(trajectory.sample(last).position - x[:3]) < 1e-3
    assert np.min(thrusts) >= -1e-3 * ROTOR_MAX
    assert np.max(thrusts) <= TOLERATED * ROTOR_MAX
    assert np.max(thrusts) > 0.95 * ROTOR_MAX


def test_a_gate_is_passed_in_its_plane_within_its_opening_from_and_to_any_motion():
    pytest.importorskip("casadi")
    start = Motion(
        np.array((0.0, 0.0, 2.0)), np.array((3.0, 0.0, 0.0)), np.array((0.0, 1.0, 0.0)), np.zeros(3), 0.0, 0.0
    )
    g = replace(gate(7, 5.0, 1.0, 2.5, 0.3), covariance=np.zeros((4, 4)))
    arrival = np.array([(2.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
    limits = Limits(6.0, 15.0, 3.0)
    asked = PlanRequest(1.0, start, (g,), np.array((10.0, 0.0, 2.0)), limits, arrival=arrival, shape=GateShape())
    plan = OptimalPlanner(CONFIG).plan(asked)
    keeps_to_the_limits(plan, limits)
    first, last = plan.sample(0.0), plan.sample(plan.duration)
    np.testing.assert_allclose([first.velocity, first.acceleration], [start.velocity, start.acceleration], atol=1e-9)
    np.testing.assert_allclose([last.velocity, last.acceleration], arrival[:2], atol=1e-6)
    passage = plan.sample(plan.gate_times[0])
    normal = np.array([math.cos(g.yaw), math.sin(g.yaw), 0.0])
    assert plan.gate_ids == (7,)
    assert abs(normal @ (passage.position - g.position)) < 0.011
    assert np.linalg.norm(passage.position - g.position) < 0.301
    along = normal @ passage.velocity / np.linalg.norm(passage.velocity)
    assert along > math.cos(math.radians(CONFIG.planning.crossing_deg)) - 1e-3


def test_without_casadi_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(PlanningError, match=r"pip install 'flightapp\[optimal\]'"):
        OptimalPlanner(CONFIG).plan(request((5.0, 0.0, 2.0)))


def test_what_cannot_be_planned_is_refused_with_the_reason():
    pytest.importorskip("casadi")
    planner = OptimalPlanner(CONFIG)
    with pytest.raises(PlanningError, match="nothing to fly"):
        planner.plan(request((0.0, 0.0, 2.0)))
    with pytest.raises(PlanningError, match="v_max must be positive"):
        planner.plan(request((5.0, 0.0, 2.0), Limits(0.0, 8.0, 3.0)))
    wall = Box(name="wall", centre=(3.0, 0.0, 2.0), size=(0.2, 4.0, 4.0))
    with pytest.raises(PlanningError, match="wall"):
        planner.plan(request((6.0, 0.0, 2.0), Limits(5.0, 10.0, 3.0), obstacles=(wall,)))


def _stored():
    for course in yardsticks().courses:
        for v_max, optimum, full in course.optimum:
            yield (
                course,
                v_max,
                (optimum, full),
                STORED / f"{course.name}_{f'{v_max:g}' if v_max < math.inf else 'none'}.csv",
            )


def test_every_yardstick_course_has_its_stored_plan_and_no_other():
    assert sorted(path for *_, path in _stored()) == sorted(STORED.glob("*.csv"))


@pytest.mark.parametrize(
    ("course", "v_max", "times", "path"), [pytest.param(*row, id=row[3].stem) for row in _stored()]
)
def test_stored_plans_keep_to_the_limits_and_are_near_the_least_time(course, v_max, times, path):
    plan = load_trajectory(path)
    keeps_to_the_limits(plan, replace(FREE, v_max=v_max))
    optimum, full = times
    assert plan.duration == pytest.approx(full, abs=6e-4)
    assert 0.995 * optimum < plan.duration < 1.05 * optimum
    path_points = plan.sample(np.arange(0.0, plan.duration, 1e-3)).position
    np.testing.assert_allclose(
        [path_points[0], plan.sample(plan.duration).position], [course.start, course.finish], atol=1e-6
    )
    for point in course.points:
        assert np.linalg.norm(path_points - point, axis=1).min() <= 0.301
