"""Behaviors: each ends with the right outcome for a real cause."""

import asyncio

import numpy as np
import pytest
from fakes import FakeAutopilot, make_context, stream_states, virtually

from flightapp.behaviors.coordinator import Coordinator
from flightapp.behaviors.motion import Follow, Goto, Hover
from flightapp.behaviors.race import Race
from flightapp.behaviors.vertical import Land, Takeoff
from flightapp.interfaces import Motion, PlanRequest
from flightapp.messages import Drift, GateEstimate, GateMap, Outcome, Phase, PlanReport
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.trajectory import hover


def fly(context, behavior, position=lambda t: (0.0, 0.0, 1.5), also=()):
    """The result of ``behavior`` while states stream."""

    async def main():
        tasks = [asyncio.create_task(stream_states(context, position)), *(asyncio.create_task(c) for c in also)]
        await asyncio.sleep(0.05)
        try:
            return await Coordinator(context).run(behavior)
        finally:
            for task in tasks:
                task.cancel()

    return virtually(main())


def airborne(**settings):
    context = make_context(FakeAutopilot(), **settings)
    for phase in (Phase.PREFLIGHT, Phase.ARMED, Phase.TAKEOFF, Phase.FLYING):
        context.machine.go(phase, 0.0, "test")
    context.line.accept(hover(0.0, np.array((0.0, 0.0, 1.5)), 0.0))
    return context


def test_takeoff_ends_in_offboard_on_a_hover_line():
    autopilot = FakeAutopilot()
    context = make_context(autopilot)
    result = fly(context, Takeoff(context, height=1.5))
    assert result.outcome is Outcome.GOAL_ACHIEVED
    assert autopilot.calls == ["takeoff", "arm", "start_offboard"]
    assert context.machine.phase is Phase.FLYING
    assert context.line.latest is not None


def test_takeoff_reports_why_arming_was_refused():
    context = make_context(FakeAutopilot(refuse="arm"))
    result = fly(context, Takeoff(context, height=1.5))
    assert result.outcome is Outcome.PROCESS_FAILURE
    assert "arm refused: test" in result.reason
    assert context.machine.phase is Phase.IDLE


def test_takeoff_gives_up_when_the_autopilot_never_becomes_ready():
    autopilot = FakeAutopilot()
    autopilot._set(ready=False)
    context = make_context(autopilot, mission__takeoff_timeout=5.0)
    result = fly(context, Takeoff(context, height=1.5))
    assert result.outcome is Outcome.TIME_OUT
    assert autopilot.calls == []


def test_takeoff_notices_a_climb_that_was_broken_off():
    autopilot = FakeAutopilot()
    context = make_context(autopilot)

    async def pilot():
        await asyncio.sleep(1.0)
        await autopilot.land()

    result = fly(context, Takeoff(context, height=1.5), also=[pilot()])
    assert result.outcome is Outcome.WRONG_PROGRESS


def test_land_waits_until_disarmed():
    context = airborne()
    context.autopilot._set(armed=True)
    result = fly(context, Land(context))
    assert result.outcome is Outcome.GOAL_ACHIEVED
    assert context.machine.phase is Phase.LANDED
    assert context.line.latest is None


def test_a_behavior_out_of_its_phase_is_refused_and_changes_nothing():
    context = make_context(FakeAutopilot())
    context.machine.go(Phase.ABORTED, 0.0, "test")
    result = fly(context, Hover(context, seconds=1.0))
    assert result.outcome is Outcome.PROCESS_FAILURE
    assert "hover needs the phase flying, but it is aborted" in result.reason
    assert context.autopilot.calls == []


def planned(context, end, delay=0.1, refuse=""):
    """A planning task that answers the first goal with a second of rest at ``end``, or refuses it."""

    async def plan():
        await context.bus.goal.next()
        await asyncio.sleep(delay)
        now = context.now()
        if not refuse:
            context.line.clear()
            context.line.accept(hover(now, np.array(end), 0.0, duration=1.0))
        context.bus.plan.publish(PlanReport(now, delay, not refuse, refuse))

    return plan()


END = (3.0, 0.0, 1.5)


def test_follow_arrives():
    context = airborne()
    follow = Follow(context, waypoints=[[1.0, 0.0, 1.5], END], timeout=20.0)
    result = fly(context, follow, lambda t: (min(t, 1.0) * 3.0, 0.0, 1.5), [planned(context, END)])
    assert result.outcome is Outcome.GOAL_ACHIEVED


def test_goto_asks_for_a_line_to_its_point():
    context = airborne()
    result = fly(context, Goto(context, point=END, timeout=20.0), lambda t: END, [planned(context, END)])
    assert result.outcome is Outcome.GOAL_ACHIEVED
    goal = context.bus.goal.latest
    request = PlanRequest(0.0, Motion(*np.zeros((4, 3)), 0.0, 0.0), (), goal.end, goal.limits)
    line = PolynomialPlanner(context.config).through(goal.waypoints, request)
    assert line.setpoint(line.end_stamp).position.tolist() == pytest.approx(END)


def test_follow_that_does_not_get_there_is_wrong_progress():
    context = airborne()
    follow = Follow(context, waypoints=[END], timeout=20.0)
    result = fly(context, follow, also=[planned(context, END)])
    assert result.outcome is Outcome.WRONG_PROGRESS


def test_follow_without_a_plan_is_a_process_failure():
    context = airborne()
    follow = Follow(context, waypoints=[END], timeout=20.0)
    result = fly(context, follow, also=[planned(context, END, refuse="contradiction")])
    assert result.outcome is Outcome.PROCESS_FAILURE
    assert "contradiction" in result.reason


def test_follow_times_out():
    context = airborne()
    result = fly(context, Follow(context, waypoints=[END], timeout=2.0))
    assert result.outcome is Outcome.TIME_OUT


def gate_map(sigma=0.05, sightings=10):
    P = np.diag((sigma**2, sigma**2, sigma**2, 0.01))
    gates = tuple(GateEstimate(i, np.array((x, 0.0, 1.5)), 0.0, P, sightings, 0.0) for i, x in ((1, 8.0), (2, 16.0)))
    return GateMap(0.0, 1, gates, Drift(0.0, np.zeros(3), 0.0, np.zeros((4, 4))))


FINISH = (24.0, 0.0, 1.5)


def a_race(context):
    """One lap."""
    return Race(context, laps=1, finish=FINISH)


def test_race_counts_gates_and_ends_at_the_finish():
    context = airborne()
    context.bus.gate_map.publish(gate_map())
    result = fly(
        context,
        a_race(context),
        lambda t: (min(4.0 * t, 24.0), 0.0, 1.5),
        [planned(context, FINISH)],
    )
    assert result.outcome is Outcome.GOAL_ACHIEVED
    assert "2 gates" in result.reason


def test_race_notices_a_gate_that_was_missed():
    context = airborne(race__attempts=1)
    context.bus.gate_map.publish(gate_map())
    result = fly(context, a_race(context), lambda t: (4.0 * t, 1.2, 1.5), [planned(context, FINISH)])
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "gate 1 missed by 1.20 m" in result.reason


def test_race_looks_around_for_a_gate_and_gives_up_in_the_end():
    context = airborne(race__search_timeout=6.0)
    context.bus.gate_map.publish(gate_map(sigma=1.5, sightings=0))
    lines = []
    context.bus.trajectory.tap(lines.append)
    result = fly(context, a_race(context))
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "gate 1 was not found" in result.reason
    turned = np.ptp(np.concatenate([line.sample(np.linspace(0.0, line.duration, 50)).yaw for line in lines]))
    assert turned > np.radians(100.0)
