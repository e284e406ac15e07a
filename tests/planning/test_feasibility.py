"""Which plans fly, by the closed loop flown before."""

import math
from dataclasses import replace

import numpy as np
import pytest
from planning_tracks import FIVE_GATES, TRACKS, at_rest, lap_request, lemniscate, request_for

from flightapp.config import Config, load_config
from flightapp.control.flatness import control_memory
from flightapp.control.parameters import parameters_of
from flightapp.interfaces import PlanningError
from flightapp.planning.answer import Answerer
from flightapp.planning.feasibility import Screen, closed_loop
from flightapp.planning.goal import Goal
from flightapp.planning.pacer import Pacer
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.trajectory import hover

CONFIG = Config()
PLANNER = PolynomialPlanner(CONFIG)
SCREEN = Screen(CONFIG)
FOUR = PLANNER.plan(request_for(FIVE_GATES))


def squeezed(plan, factor):
    """``plan`` flown so many times as fast, whatever that takes."""
    powers = factor ** np.arange(8.0)
    return replace(
        plan,
        knots=plan.knots / factor,
        coefficients=plan.coefficients * powers,
        yaw_knots=plan.yaw_knots / factor,
        yaw_coefficients=plan.yaw_coefficients * powers[:4],
        gate_times=tuple(t / factor for t in plan.gate_times),
    )


@pytest.mark.parametrize("track", TRACKS)
@pytest.mark.parametrize(("v_max", "a_max"), [(0.5, 4.0), (1.0, 8.0), (4.0, 8.0), (10.0, 8.0)])
def test_plans_within_the_vehicles_limits_are_flown_to_the_centimetre(track, v_max, a_max):
    flown = SCREEN.check(PLANNER.plan(request_for(TRACKS[track], v_max=v_max, a_max=a_max)))
    assert flown.ok
    assert flown.why == ""
    assert flown.error < 0.03
    assert flown.thrust == flown.turning == 0.0


def test_the_lemniscate_is_flown():
    waypoints = lemniscate(16)
    flown = SCREEN.check(PLANNER.through(waypoints, lap_request(waypoints, 7.0, 12.0)))
    assert flown.ok
    assert flown.error < 0.03


def test_a_plan_far_beyond_the_vehicle_is_refused_with_the_reason():
    flown = SCREEN.check(squeezed(FOUR, 3.0))
    assert not flown.ok
    assert flown.error > CONFIG.planning.screen_error
    assert flown.why.startswith(f"would be off the line by {flown.error:.1f} m at {flown.when:.1f} s")
    assert "s" in flown.why.rsplit("for ", 1)[1]
    assert flown.tilt + flown.thrust + flown.turning > 0.0


def test_where_it_fails_is_told_by_the_nearest_gate():
    flown = SCREEN.check(squeezed(FOUR, 3.0))
    times = np.array(FOUR.gate_times) / 3.0
    nearest = FOUR.gate_ids[int(np.argmin(np.abs(times - flown.when)))]
    assert f"near gate {nearest}" in flown.why


def test_more_thrust_flies_what_less_cannot():
    weak = Screen(load_config(None, {"vehicle.thrust_to_weight": 1.4, "race.a_max": 5.0, "control.tilt_max_deg": 80.0}))
    strong = Screen(load_config(None, {"vehicle.thrust_to_weight": 6.0, "control.tilt_max_deg": 80.0}))
    plan = squeezed(FOUR, 2.0)
    assert strong.check(plan).ok
    assert not weak.check(plan).ok
    assert "thrust saturated" in weak.check(plan).why


def test_a_delay_that_is_predicted_away_changes_next_to_nothing():
    plan = PLANNER.plan(request_for(FIVE_GATES, v_max=8.0, a_max=12.0))
    pieces = (plan.knots, plan.coefficients, plan.yaw_knots, plan.yaw_coefficients)
    reports = []
    for delay in (0.0, CONFIG.vehicle.delay):
        report = np.zeros(5)
        memory = control_memory(parameters_of(CONFIG)._replace(delay=delay), plan)
        closed_loop(memory, *(np.array(piece) for piece in pieces), 0.004, 5.0, report)
        reports.append(report[0])
    assert abs(reports[0] - reports[1]) < 0.03


def test_from_a_moving_start_it_begins_on_the_line():
    request = request_for(FIVE_GATES, v_max=8.0, a_max=12.0)
    plan = PLANNER.plan(request)
    for t in np.linspace(0.5, plan.duration - 1.0, 9):
        s = plan.sample(float(t))
        start = replace(
            request.start,
            position=s.position,
            velocity=s.velocity,
            acceleration=s.acceleration,
            jerk=s.jerk,
            yaw=float(s.yaw),
            yaw_rate=float(s.yaw_rate),
        )
        left = tuple(g for g, passed in zip(request.gates, plan.gate_times, strict=True) if passed > t + 0.8)
        if not left:
            continue
        onward = PLANNER.plan(replace(request, stamp=float(t), start=start, gates=left))
        assert SCREEN.check(onward).error < 0.1


def test_a_hover_is_flown():
    flown = SCREEN.check(hover(0.0, np.array((1.0, 2.0, 3.0)), 1.0, 2.0))
    assert flown.ok
    assert flown.error < 1e-6


class Fixed:
    """A planner that always answers the same."""

    def __init__(self, answer):
        self.answer = answer

    def plan(self, request):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


REQUEST = request_for(FIVE_GATES)
GOAL = Goal(REQUEST.end, REQUEST.limits, gate_ids=tuple(g.gate_id for g in REQUEST.gates))


def answer(planner, config=CONFIG, has_time=True):
    return Answerer(config, planner, Pacer(config)).answer(GOAL, REQUEST, (), 1.0, has_time)


def test_what_flies_is_flown_as_planned():
    choice = answer(Fixed(FOUR))
    assert choice.flown is FOUR


def test_what_flies_slower_is_flown_slower():
    fast = next(plan for factor in np.arange(1.0, 4.0, 0.05) if not SCREEN.check(plan := squeezed(FOUR, factor)).ok)
    choice = answer(Fixed(fast))
    assert 0.6 <= choice.pace.after < 1.0
    assert SCREEN.check(choice.flown).ok


def test_what_does_not_fly_at_all_is_refused_with_the_reason():
    with pytest.raises(PlanningError, match="would be off the line by"):
        answer(Fixed(squeezed(FOUR, 4.0)))


def test_without_time_or_when_switched_off_nothing_is_flown_before():
    wild = squeezed(FOUR, 4.0)
    assert answer(Fixed(wild), has_time=False).flown is wild
    assert answer(Fixed(wild), load_config(None, {"planning.screen": False})).flown is wild


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (ZeroDivisionError("division by zero"), "the planner failed: ZeroDivisionError: division by zero"),
        (PlanningError("no way"), "no way"),
        (replace(FOUR, coefficients=np.full_like(FOUR.coefficients, math.nan)), "not finite"),
        (replace(FOUR, coefficients=FOUR.coefficients + 1e-4), "position jumps by"),
        (hover(0.0, at_rest(FIVE_GATES[0]).position, 1.0), "yaw jumps by 1 rad"),
    ],
)
def test_a_planner_that_misbehaves_is_refused_in_words(wrong, words):
    with pytest.raises(PlanningError, match=words):
        answer(Fixed(wrong))
