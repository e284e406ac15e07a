"""Activations: their constraints, what is watched over, and that the vehicle is left in safety whenever they end."""

import asyncio
from typing import ClassVar

import numpy as np
import pytest
from fakes import FakeAutopilot, make_context, stream_states, virtually
from pydantic import Field

from flightapp.behaviors.base import Behavior, Parameters, Result
from flightapp.behaviors.coordinator import Activation, Coordinator
from flightapp.behaviors.motion import Follow, Goto, Hover
from flightapp.behaviors.vertical import Land
from flightapp.inputs import BadInputError
from flightapp.interfaces import PlanRequest
from flightapp.messages import Outcome, Phase, Setpoint
from flightapp.planning.goal import Goal
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.trajectory import hover

START = np.array((0.0, 0.0, 1.5))


def airborne(**settings):
    """A context in flight, hovering."""
    context = make_context(FakeAutopilot(), **settings)
    for phase in (Phase.PREFLIGHT, Phase.ARMED, Phase.TAKEOFF, Phase.FLYING):
        context.machine.go(phase, 0.0, "test")
    context.line.accept(hover(0.0, START, 0.0))
    context.autopilot._set(armed=True, landed=False)
    return context


async def answered(context):
    """A planning task that answers every goal at once."""
    planner = PolynomialPlanner(context.config)
    while True:
        goal = await context.bus.goal.next()
        if isinstance(goal, Goal) and goal.waypoints is not None and context.line.latest is not None:
            stamp = context.now() + 0.05
            request = PlanRequest(stamp, context.line.motion(stamp), (), goal.end, goal.limits)
            context.line.accept(planner.through(goal.waypoints, request))


def on_the_line(context):
    """Where a vehicle is that follows the line perfectly."""

    def position(t):
        return tuple(context.line.motion(t).position) if context.line.latest is not None else tuple(START)

    return position


def during(context, main, position=None):
    """What ``main(coordinator)`` returns, while states come and goals are answered."""

    async def run():
        coordinator = Coordinator(context)
        work = [stream_states(context, position or on_the_line(context)), answered(context)]
        tasks = [asyncio.create_task(one) for one in work]
        await asyncio.sleep(0.05)
        try:
            return await main(coordinator)
        finally:
            for task in tasks:
                task.cancel()

    return virtually(run())


class Still(Behavior[Parameters]):
    """Does not move the vehicle, and goes on until it is stopped."""

    name = "still"
    moves = False
    excludes: ClassVar[frozenset[str]] = frozenset()

    async def run(self):
        await asyncio.Event().wait()


class Lonely(Still):
    name = "lonely"
    excludes: ClassVar[frozenset[str]] = frozenset({"still"})


class Broken(Behavior[Parameters]):
    name = "broken"

    async def run(self):
        raise ZeroDivisionError("test")


def test_only_one_behavior_holds_the_motion_command():
    context = airborne()

    async def main(coordinator):
        first = asyncio.create_task(coordinator.run(Goto(context, point=(9.0, 0.0, 1.5))))
        await asyncio.sleep(0.5)
        second = await coordinator.run(Goto(context, point=(0.0, 9.0, 1.5)))
        assert coordinator.holder.parameters.point == (9.0, 0.0, 1.5)
        return await first, second

    first, second = during(context, main)
    assert first.outcome is Outcome.GOAL_ACHIEVED
    assert second == Result(Outcome.PROCESS_FAILURE, "refused: goto is active")


def test_a_higher_priority_stops_the_lower_first():
    context = airborne()

    async def main(coordinator):
        hovering = asyncio.create_task(coordinator.run(Hover(context, seconds=30.0)))
        await asyncio.sleep(0.5)
        going = asyncio.create_task(coordinator.run(Goto(context, point=(9.0, 0.0, 1.5))))
        await asyncio.sleep(1.0)
        return await coordinator.run(Land(context)), await going, await hovering

    landed, going, hovering = during(context, main)
    assert landed.achieved
    assert going == Result(Outcome.INTERRUPTED, "land has taken over")
    assert hovering == Result(Outcome.INTERRUPTED, "goto has taken over")


def test_the_same_asked_for_twice_is_one_activation():
    context = airborne()

    async def main(coordinator):
        both = [coordinator.run(Goto(context, point=(4.0, 0.0, 1.5))) for _ in range(2)]
        return await asyncio.gather(*both), context.bus.goal.count

    (first, second), goals = during(context, main)
    assert first is second
    assert first.achieved
    assert goals == 1


def test_it_goes_on_for_one_when_the_other_gives_it_up():
    context = airborne()

    async def main(coordinator):
        first, second = (asyncio.create_task(coordinator.run(Hover(context, seconds=3.0))) for _ in range(2))
        await asyncio.sleep(1.0)
        first.cancel()
        result = await second
        return result, coordinator.active

    result, active = during(context, main)
    assert result.achieved
    assert active == ()


def test_those_that_do_not_move_the_vehicle_are_beside_those_that_do():
    context = airborne()

    async def main(coordinator):
        async with coordinator.activate(Still(context)) as still:
            result = await coordinator.run(Hover(context, seconds=1.0))
            assert [behavior.name for behavior in coordinator.active] == ["still"]
        return result, await still.result()

    hovered, still = during(context, main)
    assert hovered.achieved
    assert still.outcome is Outcome.INTERRUPTED


@pytest.mark.parametrize(("first", "second"), [(Still, Lonely), (Lonely, Still)])
def test_what_one_excludes_is_refused_either_way(first, second):
    context = airborne()

    async def main(coordinator):
        async with coordinator.activate(first(context)):
            return await coordinator.run(second(context))

    assert during(context, main).reason == f"refused: {first.name} is active"


def test_what_is_needed_is_activated_for_it():
    context = make_context(FakeAutopilot())

    async def main(coordinator):
        return await coordinator.run(Goto(context, point=(4.0, 0.0, 1.5)))

    assert during(context, main).achieved
    assert context.autopilot.calls == ["takeoff", "arm", "start_offboard"]
    assert context.machine.phase is Phase.FLYING


def test_where_what_is_needed_fails_it_is_refused_with_the_reason():
    context = make_context(FakeAutopilot(refuse="takeoff"))

    async def main(coordinator):
        return await coordinator.run(Goto(context, point=(4.0, 0.0, 1.5)))

    result = during(context, main)
    assert result.outcome is Outcome.PROCESS_FAILURE
    assert result.reason == "it needs takeoff, which ended: AutopilotError: takeoff refused: test"
    assert context.machine.phase is Phase.IDLE


def test_an_exception_becomes_a_process_failure():
    context = airborne()
    result = during(context, lambda coordinator: coordinator.run(Broken(context)))
    assert result == Result(Outcome.PROCESS_FAILURE, "ZeroDivisionError: test")


def test_it_ends_when_its_time_is_over_and_the_vehicle_stops():
    context = airborne()

    async def main(coordinator):
        result = await coordinator.run(Goto(context, point=(90.0, 0.0, 1.5), timeout=2.0))
        await asyncio.sleep(3.0)
        return result, context.line.at_rest(context.now()), context.line.motion(context.now()).position

    result, resting, place = during(context, main)
    assert result == Result(Outcome.TIME_OUT, "not done within 2 s")
    assert resting
    assert place[0] < 10.0


def test_without_a_state_it_fails():
    context = airborne()

    async def main(coordinator):
        silent = asyncio.create_task(coordinator.run(Hover(context, seconds=30.0)))
        await asyncio.sleep(1.0)
        context.bus.state.publish = lambda state: None
        begun = context.now()
        return await silent, context.now() - begun

    result, took = during(context, main)
    assert result.outcome is Outcome.PROCESS_FAILURE
    assert "hover needs a vehicle state, but the newest is" in result.reason
    assert took < 1.0


def test_without_a_state_it_does_not_begin():
    context = airborne()

    async def main():
        return await Coordinator(context).run(Hover(context, seconds=1.0))

    assert virtually(main()).reason == "hover needs a vehicle state, but there is none yet"


def test_far_off_the_line_is_wrong_progress():
    context = airborne()

    async def main(coordinator):
        zero = np.zeros(3)

        async def setpoints():
            while True:
                context.bus.setpoint.publish(Setpoint(context.now(), START, zero, zero, zero, 0.0, 0.0))
                await asyncio.sleep(0.01)

        task = asyncio.create_task(setpoints())
        result = await coordinator.run(Hover(context, seconds=30.0))
        task.cancel()
        return result

    result = during(context, main, lambda t: (0.0, min(t, 1.8), 1.5))
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "off the line, at most 1.5 m" in result.reason


def test_a_suspended_behavior_stops_and_goes_on_later():
    context = airborne()

    async def main(coordinator):
        points = ((6.0, 0.0, 1.5), (12.0, 0.0, 1.5), (12.0, 6.0, 1.5))
        following = asyncio.create_task(coordinator.run(Follow(context, waypoints=points)))
        await asyncio.sleep(2.5)
        assert coordinator.suspend("test")
        await asyncio.sleep(4.0)
        place, resting = context.line.motion(context.now()).position, context.line.at_rest(context.now())
        assert coordinator.resume("test")
        return await following, place, resting, context.line.latest

    result, place, resting, last = during(context, main)
    assert result.achieved
    assert resting
    assert 1.0 < place[0] < 11.0
    assert np.abs(last.sample(last.duration).position - (12.0, 6.0, 1.5)).max() < 1e-6
    assert last.sample(0.0).position[0] >= place[0] - 1e-6


def test_nothing_is_suspended_where_nothing_moves():
    context = airborne()

    async def main(coordinator):
        return coordinator.suspend("test")

    assert during(context, main) is False


@pytest.mark.parametrize(
    ("kind", "parameters", "words"),
    [
        (Goto, {"point": (0.0, float("nan"), 1.0)}, "point"),
        (Goto, {}, "'point' is missing"),
        (Hover, {"seconds": -1.0}, "'seconds' = -1.0"),
        (Hover, {"second": 1.0}, "unknown key 'second'; did you mean 'seconds'?"),
        (Follow, {"waypoints": ()}, "waypoints"),
        (Land, {"timeout": 0.0}, "'timeout' = 0.0"),
    ],
)
def test_parameters_out_of_their_bounds_are_named(kind, parameters, words):
    with pytest.raises(BadInputError, match=f"behavior {kind.name}: .*{words}"):
        kind(airborne(), **parameters)


class Circle(Behavior[Parameters]):
    """Somebody else's, with a parameter of its own."""

    name = "circle"

    class Accepts(Parameters):
        radius: float = Field(1.0, gt=0.0)

    accepts = Accepts

    async def run(self):
        return Result(Outcome.GOAL_ACHIEVED, f"{self.parameters.radius:g} m")


def test_behaviors_of_others_have_their_own_parameters():
    context = airborne()
    result = during(context, lambda coordinator: coordinator.run(Circle(context, radius=2.0)))
    assert result.reason == "2 m"


def test_stopped_before_it_has_begun_it_still_leaves_the_vehicle_in_safety():
    context = airborne()

    async def main(coordinator):
        async with coordinator.activate(Goto(context, point=(9.0, 0.0, 1.5))) as activation:
            assert isinstance(activation, Activation)
        return await activation.result(), context.bus.goal.latest, coordinator.active

    result, goal, active = during(context, main)
    assert result.outcome is Outcome.INTERRUPTED
    assert goal is None
    assert active == ()
