"""What every planner that is installed must do."""

import math
from importlib.metadata import entry_points

import numpy as np
import pytest
from crowded_tracks import framed, hall, slalom
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_tracks import FIVE_GATES, at_rest, gate, lap_request, lemniscate, motion_at, request_for

from flightapp.config import Config, Vehicle
from flightapp.interfaces import Limits, PlanningError, PlanRequest
from flightapp.planning.clearance import touched
from flightapp.planning.obstacles import Margins
from flightapp.trajectory import Trajectory

OFFLINE = {"optimal"}
"""Planners that take minutes, or an extra: their own tests hold them to this."""
NAMES = sorted(point.name for point in entry_points(group="flightapp.planners") if point.name not in OFFLINE)
CONFIG = Config(vehicle=Vehicle(thrust_to_weight=2.8))
REACH = 0.5
"""m from a gate's centre within which it is flown through: its opening is 1.4 m wide, the vehicle 0.4 m."""
TOLERATED = 1.001


def load(name, config=CONFIG):
    (point,) = entry_points(group="flightapp.planners", name=name)
    return point.load()(config)


@pytest.fixture(params=NAMES)
def planner(request):
    return load(request.param)


PLANNERS = {name: load(name) for name in NAMES}


def keeps_all_limits(trajectory: Trajectory, limits: Limits, config=CONFIG):
    assert np.isfinite(trajectory.knots).all() and np.isfinite(trajectory.coefficients).all()
    assert np.isfinite(trajectory.yaw_knots).all() and np.isfinite(trajectory.yaw_coefficients).all()
    assert (np.diff(trajectory.knots) > 0.0).all()
    peaks = trajectory.limits()
    assert peaks.speed <= TOLERATED * limits.v_max
    assert peaks.acceleration <= TOLERATED * limits.a_max
    assert peaks.yaw_rate <= TOLERATED * limits.yaw_rate_max
    assert peaks.specific_force <= TOLERATED * config.planning.thrust_share * config.vehicle.thrust_max
    assert peaks.specific_force_min >= config.guard.thrust_min / TOLERATED
    assert peaks.body_rate <= TOLERATED * config.planning.rate_share * config.vehicle.rate_max


def is_smooth(trajectory: Trajectory, request: PlanRequest):
    """Position to acceleration are continuous, and as asked for at both ends."""
    c, spans = trajectory.coefficients, np.diff(trajectory.knots)
    powers = np.arange(8)
    for d in range(3):
        factor = np.array([math.perm(m, d) for m in range(8)], float)
        ends = [c[i] @ (factor * t ** np.maximum(powers - d, 0)) for i, t in enumerate(spans)]
        starts = c[:, :, d] * math.factorial(d)
        scale = max(1.0, np.abs(starts).max())
        np.testing.assert_allclose(np.array(ends)[:-1], starts[1:], atol=1e-6 * scale)
        wanted = (request.start.position, request.start.velocity, request.start.acceleration)[d]
        np.testing.assert_allclose(starts[0], wanted, atol=1e-9)
        np.testing.assert_allclose(ends[-1], request.end if d == 0 else np.zeros(3), atol=1e-6 * scale)


def passes_the_gates(trajectory: Trajectory, request: PlanRequest):
    assert trajectory.gate_ids == tuple(g.gate_id for g in request.gates)
    assert list(trajectory.gate_times) == sorted(trajectory.gate_times)
    for g, passed in zip(request.gates, trajectory.gate_times, strict=True):
        s = trajectory.sample(passed)
        assert np.linalg.norm(s.position - g.position) < REACH
        if 0.0 < passed < trajectory.duration:
            assert s.velocity[0] * math.cos(g.yaw) + s.velocity[1] * math.sin(g.yaw) > 0.0


def random_track(seed, gates, near):
    """Gates at all heights: sharp turns, some close together, some passed twice; perhaps a start inside the first."""
    rng = np.random.default_rng(seed)
    position, yaw, track = np.array([0.0, 0.0, 2.0]), rng.uniform(-math.pi, math.pi), []
    for number in range(gates):
        if track and rng.uniform() < 0.1 and number > 2:
            old = track[rng.integers(0, number - 1)]
            if np.linalg.norm(old.position - track[-1].position) > 0.5:
                track.append(old)
                position, yaw = old.position, old.yaw
                continue
        turn = rng.uniform(-2.6, 2.6) if rng.uniform() < 0.3 else rng.uniform(-1.0, 1.0)
        leg = rng.uniform(near, 1.0) if rng.uniform() < 0.1 else rng.uniform(2.0, 12.0)
        course = yaw + 0.5 * turn
        yaw += turn
        position = position + leg * np.array([math.cos(course), math.sin(course), 0.0])
        position = np.array([position[0], position[1], rng.uniform(1.0, 6.0) if leg > 2.0 else position[2]])
        track.append(gate(number, *position, yaw))
    first = track[0]
    ahead = np.array([math.cos(first.yaw), math.sin(first.yaw), 0.0])
    inside = rng.uniform() < 0.2
    start = first.position if inside else first.position - rng.uniform(1.0, 6.0) * ahead
    end = track[-1].position + 3.0 * np.array([math.cos(yaw), math.sin(yaw), 0.0])
    v_max = rng.choice([0.5, 2.0, 5.0, 12.0, math.inf])
    a_max = rng.choice([2.0, 8.0, 20.0, math.inf])
    return PlanRequest(3.0, at_rest(start, rng.uniform(-4.0, 4.0)), tuple(track), end, Limits(v_max, a_max, 3.0))


def planned_or_refused(name, request):
    """The plan, after it was looked at; None where it was refused in words."""
    try:
        trajectory = PLANNERS[name].plan(request)
    except PlanningError as error:
        assert len(str(error).split()) > 5
        return None
    keeps_all_limits(trajectory, request.limits)
    passes_the_gates(trajectory, request)
    is_smooth(trajectory, request)
    return trajectory


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 100_000), gates=st.integers(2, 40), near=st.sampled_from([0.02, 0.3]))
def test_random_tracks_give_a_valid_plan_or_a_clear_refusal(name, seed, gates, near):
    planned_or_refused(name, random_track(seed, gates, near))


CROWDED = {
    "slalom": slalom,
    "hall": lambda seed, gates: hall(seed, gates, 2 * gates),
    "framed": lambda seed, gates: framed(random_track(seed, gates, 1.0)),
}


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 100_000), gates=st.integers(2, 40), kind=st.sampled_from(sorted(CROWDED)))
def test_crowded_tracks_give_a_valid_plan_or_a_clear_refusal(name, seed, gates, kind):
    request = CROWDED[kind](seed, gates)
    trajectory = planned_or_refused(name, request)
    if (
        trajectory is not None and name == "race"
    ):  # the others leave it to whoever asks to refuse what touches something
        assert touched(trajectory, request.gates, request.shape, request.obstacles, Margins.of(CONFIG)) is None


@pytest.mark.parametrize("name", NAMES)
def test_most_random_tracks_are_planned(name):
    planned = 0
    for seed in range(40):
        try:
            PLANNERS[name].plan(random_track(seed, 6, 1.0))
            planned += 1
        except PlanningError:
            pass
    assert planned >= 28


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 100_000), part=st.floats(0.0, 0.95))
def test_random_replans_take_over_the_motion_or_are_refused(name, seed, part):
    rng = np.random.default_rng(seed)
    request = request_for(FIVE_GATES, v_max=float(rng.choice([2.0, 4.0, 10.0])))
    plan = PLANNERS[name].plan(request)
    t = part * plan.duration
    left = [g for g, passed in zip(request.gates, plan.gate_times, strict=True) if passed > t + 0.4]
    moved = tuple(gate(g.gate_id, *(g.position + rng.normal(0.0, 0.05, 3)), g.yaw) for g in left)
    again = PlanRequest(t, motion_at(plan, t), moved, request.end, request.limits)
    try:
        after = PLANNERS[name].plan(again)
    except PlanningError as error:
        assert len(str(error).split()) > 5
        return
    keeps_all_limits(after, again.limits)
    passes_the_gates(after, again)
    is_smooth(after, again)
    np.testing.assert_allclose(after.sample(0.0).jerk, again.start.jerk, atol=1e-6)


def test_a_planner_flies_through_the_gates_within_the_limits(planner):
    request = request_for(FIVE_GATES)
    trajectory = planner.plan(request)
    assert trajectory.stamp == request.stamp
    keeps_all_limits(trajectory, request.limits)
    passes_the_gates(trajectory, request)
    is_smooth(trajectory, request)


def test_a_planner_keeps_to_the_vehicle_where_nothing_else_limits_it(planner):
    request = request_for(FIVE_GATES, v_max=math.inf, a_max=math.inf)
    trajectory = planner.plan(request)
    keeps_all_limits(trajectory, request.limits)
    assert trajectory.duration < 9.0


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


def test_a_plan_from_rest_does_not_depend_on_the_plans_before(planner):
    request = request_for(FIVE_GATES)
    first = planner.plan(request)
    planner.plan(request_for(FIVE_GATES, v_max=2.0))
    np.testing.assert_array_equal(planner.plan(request).coefficients, first.coefficients)
