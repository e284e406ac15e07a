"""How long plans take; run with --benchmark-enable."""

import numpy as np
import pytest
from planning_tracks import FIVE_GATES, at_rest, motion_at, replan_request, request_for

from flightapp.config import Config
from flightapp.interfaces import Limits, PlanRequest
from flightapp.planning.polynomial import PolynomialPlanner

PLANNER = PolynomialPlanner(Config())


def winding(points):
    """Waypoints (points, 3) along a winding way, 4 m apart on average."""
    rng = np.random.default_rng(points)
    k = np.arange(points)
    return np.column_stack((4.0 * k, 3.0 * np.sin(0.9 * k), 1.5 + 0.3 * rng.uniform(size=points)))


@pytest.mark.parametrize("points", [6, 14, 26])
def test_plan_through_points(benchmark, points):
    way = winding(points)
    request = PlanRequest(0.0, at_rest(way[0]), (), way[-1], Limits(4.0, 8.0, 3.0))
    trajectory = benchmark(PLANNER.through, way, request)
    np.testing.assert_allclose(trajectory.sample(trajectory.duration).position, way[-1], atol=1e-6)


@pytest.mark.parametrize("points", [6, 14, 26])
def test_replan_through_points(benchmark, points):
    way = winding(points)
    request = PlanRequest(0.0, at_rest(way[0]), (), way[-1], Limits(4.0, 8.0, 3.0))
    plan = PLANNER.through(way, request)
    t = 0.5 * (plan.knots[2] + plan.knots[3])
    again = PlanRequest(t, motion_at(plan, t), (), way[-1], request.limits)
    trajectory = benchmark(PLANNER.through, way[2:], again)
    np.testing.assert_allclose(trajectory.sample(trajectory.duration).position, way[-1], atol=1e-6)


@pytest.mark.parametrize("points", [250, 500, 1000])
def test_time_grows_linearly_with_points(benchmark, points):
    way = winding(points)
    request = PlanRequest(0.0, at_rest(way[0]), (), way[-1], Limits(4.0, 8.0, 3.0))
    trajectory = benchmark(PLANNER.through, way, request)
    if benchmark.stats is not None:
        benchmark.extra_info["µs per point"] = 1e6 * benchmark.stats.stats.median / points
    assert trajectory.limits(0.05).speed <= 4.004


def test_plan_a_race(benchmark):
    trajectory = benchmark(PLANNER.plan, request_for(FIVE_GATES))
    assert len(trajectory.gate_times) == 5


def test_replan_a_race(benchmark):
    request = request_for(FIVE_GATES)
    plan = PLANNER.plan(request)
    trajectory = benchmark(PLANNER.plan, replan_request(request, plan, 0.3 * plan.duration))
    assert len(trajectory.gate_times) == 4
