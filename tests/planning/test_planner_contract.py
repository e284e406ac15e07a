"""What every planner that is installed must do."""

from importlib.metadata import entry_points

import numpy as np
import pytest
from planning_tracks import FIVE_GATES, lap_request, lemniscate, request_for

from flightapp.config import Config
from flightapp.interfaces import PlanningError
from flightapp.planning.limits import trajectory_peaks


@pytest.fixture(params=[point.name for point in entry_points(group="flightapp.planners")])
def planner(request):
    (point,) = entry_points(group="flightapp.planners", name=request.param)
    return point.load()(Config())


def test_a_planner_flies_through_the_gates_within_the_limits(planner):
    request = request_for(FIVE_GATES)
    trajectory = planner.plan(request)
    assert trajectory.stamp == request.stamp
    assert trajectory.gate_ids == tuple(g.gate_id for g in request.gates)
    for g, passed in zip(request.gates, trajectory.gate_times, strict=True):
        assert np.linalg.norm(trajectory.sample(passed).position - g.position) < 0.3
    ends = trajectory.sample(np.array([0.0, trajectory.duration]))
    np.testing.assert_allclose(ends.position, [request.start.position, request.end], atol=1e-6)
    np.testing.assert_allclose(ends.velocity, 0.0, atol=1e-6)
    peaks = trajectory_peaks(trajectory)
    assert peaks.speed <= 1.001 * request.limits.v_max
    assert peaks.acceleration <= 1.001 * request.limits.a_max
    assert peaks.yaw_rate <= 1.001 * request.limits.yaw_rate_max


def test_a_planner_flies_through_waypoints(planner):
    waypoints = lemniscate(16)
    trajectory = planner.through(waypoints, lap_request(waypoints, 3.0, 8.0))
    line = trajectory.sample(np.linspace(0.0, trajectory.duration, 4000)).position
    for waypoint in waypoints:
        assert np.linalg.norm(line - waypoint, axis=1).min() < 0.05


def test_a_planner_refuses_what_it_cannot_plan(planner):
    with pytest.raises(PlanningError):
        planner.plan(request_for(FIVE_GATES, v_max=-1.0))
    with pytest.raises(PlanningError):
        planner.through(np.full((2, 3), np.nan), lap_request(lemniscate(8), 3.0, 8.0))


def test_a_planner_keeps_no_memory(planner):
    request = request_for(FIVE_GATES)
    first = planner.plan(request)
    planner.plan(request_for(FIVE_GATES, v_max=2.0))
    np.testing.assert_array_equal(planner.plan(request).coefficients, first.coefficients)
