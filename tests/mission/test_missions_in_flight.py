"""What missions do beside flying, and how they can be ended."""

import asyncio

from supervised import fly

from flightapp.messages import Outcome, Phase
from flightapp.mission.drone import BehaviorFailedError
from flightapp.safety.faults import Fault, FaultKind


def test_a_check_beside_the_flight_ends_it_by_raising():
    async def check():
        await asyncio.sleep(6.0)
        raise ValueError("dark")

    async def mission(drone):
        await drone.takeoff()
        async with drone.beside(check()):
            await drone.hover(60.0)

    ending, _, autopilot = fly(mission)
    assert ending.outcome is Outcome.PROCESS_FAILURE
    assert "ValueError: dark" in ending.reason
    assert not autopilot.status.latest.armed


def test_a_check_beside_the_flight_is_over_with_it():
    ended = []

    async def check():
        try:
            await asyncio.sleep(1000.0)
        finally:
            ended.append(True)

    async def mission(drone):
        await drone.takeoff()
        async with drone.beside(check()):
            await drone.hover(2.0)
        await drone.land()

    ending, _, _ = fly(mission)
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert ended == [True]


def test_a_mission_branches_on_a_result_and_on_a_timeout_of_its_own():
    results = []

    async def mission(drone):
        await drone.takeoff()
        results.append(await drone.follow([[1.0, 0.0, 1.5]], timeout=2.0, check=False))
        try:
            async with asyncio.timeout(1.0):
                await drone.hover(60.0)
        except TimeoutError:
            results.append(await drone.hover(1.0))
        await drone.land()

    ending, _, _ = fly(mission)
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert [result.outcome for result in results] == [Outcome.TIME_OUT, Outcome.GOAL_ACHIEVED]


def test_a_mission_that_does_not_let_itself_be_ended_is_landed_all_the_same():
    async def mission(drone):
        await drone.takeoff()
        while True:
            try:
                await drone.hover(5.0)
            except (BehaviorFailedError, asyncio.CancelledError):
                await asyncio.sleep(0.1)

    async def fault(context):
        await asyncio.sleep(4.0)
        context.bus.fault.publish(Fault(context.now(), FaultKind.OFF_THE_LINE, "test"))

    ending, context, autopilot = fly(mission, during=fault)
    assert ending.reason == "off the line: test"
    assert context.machine.phase is Phase.ABORTED
    assert not autopilot.status.latest.armed


def test_what_a_mission_leaves_behind_has_no_say_any_more():
    left = []

    async def mission(drone):
        left.append(asyncio.create_task(drone.goto(1.0, 0.0, 1.5, check=False)))
        await asyncio.sleep(1.0)

    ending, context, autopilot = fly(mission)
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert not autopilot.status.latest.armed
    assert context.machine.phase is Phase.ABORTED
