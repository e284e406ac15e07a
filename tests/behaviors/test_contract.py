"""What every behavior keeps to: each way to end is reached for a cause that happens, and then the vehicle is safe."""

import asyncio

import numpy as np
import pytest
from fakes import TRACK, FakeAutopilot
from light_world import LightWorld, after

from flightapp.behaviors.coordinator import Activation
from flightapp.behaviors.emergency import Emergency
from flightapp.behaviors.motion import Follow, Goto, Hover
from flightapp.behaviors.race import Race
from flightapp.behaviors.search import Search
from flightapp.behaviors.swaying import Swaying
from flightapp.behaviors.vertical import Land, Takeoff
from flightapp.interfaces import AutopilotError
from flightapp.messages import FlightMode, Outcome
from flightapp.modules import find
from flightapp.track import Box

POINT = (6.0, 0.0, 1.5)
FLOWN = {
    "hover": (Hover, {"seconds": 8.0}),
    "goto": (Goto, {"point": POINT}),
    "follow": (Follow, {"waypoints": ((3.0, 1.0, 1.5), POINT)}),
    "sway": (Swaying, {"seconds": 8.0, "ahead": ((0.3, 0.4),)}),
    "race": (Race, {"laps": 1, "finish": (24.0, 0.0, 1.5)}),
    "search": (Search, {"gate_id": 2, "seconds": 15.0}),
}
"""Behaviors that fly along a line of ours, with parameters."""
GROUND = {"takeoff": Takeoff, "land": Land, "emergency": Emergency}
EXPECTED = {"land": "land", "emergency": "emergency", "takeoff": "takeoff"}


class Deaf(FakeAutopilot):
    """Takes what it is asked for, and does not do it."""

    async def land(self):
        self._called("land")
        self._set(mode=FlightMode.LAND)


def ready(name, autopilot=None, track=TRACK, **settings):
    """A world in which ``name`` can be activated."""
    world = LightWorld(autopilot, track, **settings)
    if name == "search":
        world.gates = world.gates[:1]
    return world if name == "takeoff" else world.airborne()


def made(name, world, **more):
    """The behavior, in ``world``."""
    kind, parameters = FLOWN[name] if name in FLOWN else (GROUND[name], {})
    return kind(world.context, **(parameters | more))


def run(world, behavior, disturbance=None):
    """How ``behavior`` ends, with a disturbance beside it."""

    async def main(coordinator):
        beside = asyncio.create_task(disturbance) if disturbance is not None else None
        result = await coordinator.run(behavior)
        if beside is not None:
            beside.cancel()
        assert coordinator.active == ()
        return result

    return world.fly(main)


def pushed_away(world):
    """Two metres to the side, before long."""
    return after(1.5, lambda: world.push.__iadd__((0.0, 1.8, 0.0)))


@pytest.mark.parametrize("name", [*FLOWN, *GROUND])
def test_it_achieves_its_goal(name):
    world = ready(name)
    appears = after(4.0, lambda: setattr(world, "gates", LightWorld().gates)) if name == "search" else None
    result = run(world, made(name, world), appears)
    assert result.outcome is Outcome.GOAL_ACHIEVED, result


@pytest.mark.parametrize("name", FLOWN)
def test_off_its_line_it_makes_wrong_progress(name):
    world = ready(name)
    result = run(world, made(name, world), pushed_away(world))
    assert result.outcome is Outcome.WRONG_PROGRESS, result
    assert "off the line" in result.reason


def test_a_flight_that_stands_still_makes_wrong_progress():
    world = ready("goto")
    world.stuck = (0.0, 0.0, 1.5)
    result = run(world, Goto(world.context, point=(1.0, 0.0, 1.5)))
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "1.00 m from the end" in result.reason


def test_a_gate_missed_is_wrong_progress():
    world = ready("race", race__attempts=1)
    world.push[1] = 1.2
    result = run(world, made("race", world))
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "gate 1 missed by 1.20 m" in result.reason


def test_a_gate_not_found_is_wrong_progress():
    world = ready("search")
    result = run(world, made("search", world))
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "gate 2 was not found within" in result.reason


@pytest.mark.parametrize("name", GROUND)
def test_a_pilot_s_mode_is_wrong_progress(name):
    world = ready(name)
    disturbance = after(1.0, lambda: world.autopilot._set(mode=FlightMode.POSITION))
    result = run(world, made(name, world), disturbance)
    assert result.outcome is Outcome.WRONG_PROGRESS, result
    assert "position" in result.reason


@pytest.mark.parametrize("name", FLOWN)
def test_without_a_state_it_fails(name):
    world = ready(name)
    result = run(world, made(name, world), after(1.5, lambda: setattr(world, "silent", True)))
    assert result.outcome is Outcome.PROCESS_FAILURE, result


@pytest.mark.parametrize(("name", "call"), [("takeoff", "arm"), ("takeoff", "start_offboard"), ("land", "land")])
def test_what_the_autopilot_refuses_is_a_failure(name, call):
    world = ready(name, FakeAutopilot(refuse=call))
    result = run(world, made(name, world))
    assert result.outcome is Outcome.PROCESS_FAILURE
    assert f"{AutopilotError.__name__}: {call} refused: test" in result.reason


def test_an_emergency_asks_again_where_the_autopilot_refuses():
    autopilot = FakeAutopilot(refuse="land")
    world = ready("emergency", autopilot)
    result = run(world, made("emergency", world), after(3.0, lambda: setattr(autopilot, "refuse", "")))
    assert result.achieved
    assert autopilot.calls.count("land") >= 3


def test_no_plan_is_a_failure():
    box = Box(name="box", centre=(6.0, 0.0, 1.5), size=(2.0, 2.0, 4.0))
    world = ready("goto", track=TRACK.model_copy(update={"obstacles": (box,)}))
    result = run(world, made("goto", world))
    assert result.outcome is Outcome.PROCESS_FAILURE, result
    assert "no plan" in result.reason


@pytest.mark.parametrize("name", ["goto", "follow", "sway"])
def test_a_way_out_of_the_geofence_is_a_failure(name):
    world = ready(name, geofence__corners=((-2.0, -5.0), (0.25, 5.0)))
    result = run(world, made(name, world))
    assert result.outcome is Outcome.PROCESS_FAILURE, result
    assert "geofence" in result.reason


@pytest.mark.parametrize("name", [*FLOWN, *GROUND])
def test_its_time_is_over(name):
    world = ready(name, Deaf())
    result = run(world, made(name, world, timeout=0.9))
    assert result == (type(result))(Outcome.TIME_OUT, "not done within 0.9 s")


@pytest.mark.parametrize("name", FLOWN)
def test_a_landing_interrupts_it(name):
    world = ready(name)

    async def main(coordinator):
        going = asyncio.create_task(coordinator.run(made(name, world)))
        await asyncio.sleep(1.0)
        landed = await coordinator.run(Land(world.context))
        return await going, landed

    result, landed = world.fly(main)
    assert result.outcome is Outcome.INTERRUPTED
    assert result.reason == "land has taken over"
    assert landed.achieved


@pytest.mark.parametrize("name", ["takeoff", "land"])
def test_an_emergency_interrupts_it(name):
    world = ready(name, Deaf())

    async def main(coordinator):
        going = asyncio.create_task(coordinator.run(made(name, world)))
        await asyncio.sleep(1.0)
        emergency = asyncio.create_task(coordinator.run(Emergency(world.context)))
        await asyncio.sleep(1.0)
        world.autopilot._set(armed=False)
        return await going, await emergency

    result, emergency = world.fly(main)
    assert result.reason == "emergency has taken over"
    assert emergency.achieved


@pytest.mark.parametrize("name", [*FLOWN, *GROUND])
def test_activated_twice_it_is_one(name):
    world = ready(name)

    async def main(coordinator):
        async with coordinator.activate(made(name, world)) as first, coordinator.activate(made(name, world)) as second:
            assert isinstance(first, Activation)
            assert len(coordinator.active) == 1
            return first is second

    assert world.fly(main)


@pytest.mark.parametrize("name", FLOWN)
@pytest.mark.parametrize("doubted", [False, True])
def test_without_what_it_needs_it_is_refused(name, doubted):
    world = ready(name)

    async def main(coordinator):
        world.silent = True
        await asyncio.sleep(0.5)
        return await coordinator.run(made(name, world))

    assert "needs a vehicle state" in world.fly(main).reason


@pytest.mark.parametrize("name", ["race", "search"])
def test_what_looks_for_gates_is_refused_without_a_camera(name):
    world = ready(name)

    async def main(coordinator):
        world.context.bus.frame.publish = lambda frame: None
        await asyncio.sleep(1.5)
        return await coordinator.run(made(name, world))

    assert "needs the camera's images, but the newest is" in world.fly(main).reason


def test_an_armed_vehicle_does_not_take_off():
    world = LightWorld()
    world.autopilot._set(armed=True)
    assert "takeoff needs a disarmed vehicle" in run(world, Takeoff(world.context)).reason


@pytest.mark.parametrize("name", [*FLOWN, *GROUND])
def test_it_tells_how_much_of_it_is_done(name):
    world = ready(name)
    told = []

    async def main(coordinator):
        async with coordinator.activate(made(name, world)) as activation:
            while not activation.done:
                told.append(activation.progress)
                await asyncio.sleep(0.1)

    world.fly(main)
    assert all(0.0 <= share <= 1.0 for share in told)
    if name != "emergency":
        assert max(told) > 0.2


@pytest.mark.parametrize("name", [*FLOWN, *GROUND])
def test_it_is_found_by_its_name(name):
    assert find("behaviors", name).name == name


@pytest.mark.parametrize("seed", [*range(5), *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(5, 25))])
def test_cancelled_at_any_moment_of_a_mission_it_leaves_the_vehicle_in_safety(seed):
    """Twenty moments of each of twenty-five missions."""
    random = np.random.default_rng(seed)
    for moment in random.uniform(0.0, 30.0, 20):
        world = LightWorld()

        async def main(coordinator, world=world, moment=moment):
            async def mission():
                for name in ("takeoff", "goto", "sway", "race", "land"):
                    await coordinator.run(made(name, world))

            flying = asyncio.create_task(mission())
            await asyncio.sleep(moment)
            flying.cancel()
            await asyncio.gather(flying, return_exceptions=True)
            assert coordinator.active == ()
            await asyncio.sleep(8.0)
            line, status = world.context.line, world.autopilot.status.latest
            assert line.latest is None or line.at_rest(world.context.now())
            if status.armed:
                landed = await coordinator.run(Land(world.context))
                assert landed.achieved, landed
            assert not world.autopilot.status.latest.armed

        world.fly(main)
