"""Whatever happens to a flight ends on the ground, or in the pilot's hands."""

import asyncio
import os
import signal
from types import SimpleNamespace

import pytest
from fakes import FakeAutopilot, make_context, stream_states, virtually

from flightapp.behaviors.coordinator import Coordinator
from flightapp.interfaces import AutopilotError
from flightapp.messages import FlightMode, Outcome, Phase
from flightapp.mission.drone import BehaviorFailedError, Drone
from flightapp.mission.supervisor import Supervisor
from flightapp.planning.caution import Caution
from flightapp.safety.faults import Fault, FaultKind


def fly(mission, autopilot=None, work=None, taken_over=False, during=None, caution=None):
    """The ending of ``mission``, its context and its autopilot; ``during(context)`` runs beside it."""
    autopilot = autopilot or FakeAutopilot()
    context = make_context(autopilot)

    async def main():
        coordinator = Coordinator(context)
        drone = Drone(context, coordinator, {})
        tasks = {"states": stream_states(context), **(work(context) if work else {})}
        beside = asyncio.create_task(during(context)) if during else None
        guard = SimpleNamespace(taken_over=taken_over)
        supervisor = Supervisor(context, coordinator, guard, caution or Caution(context.config))
        ending = await supervisor.run(tasks, autopilot, lambda: mission(drone))
        if beside is not None:
            beside.cancel()
        return ending

    return virtually(main()), context, autopilot


async def up_and_down(drone):
    await drone.takeoff()
    await drone.hover(5.0)
    await drone.land()


def test_a_whole_mission():
    ending, context, autopilot = fly(up_and_down)
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert context.machine.phase is Phase.LANDED
    assert autopilot.calls == ["connect", "takeoff", "arm", "start_offboard", "land"]


def test_a_mission_that_forgets_to_land_is_landed():
    async def mission(drone):
        await drone.takeoff()

    ending, context, autopilot = fly(mission)
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert context.machine.phase is Phase.ABORTED
    assert autopilot.calls[-1] == "land"
    assert not autopilot.status.latest.armed


def test_an_error_in_the_mission_lands_and_names_the_line():
    async def mission(drone):
        await drone.takeoff()
        raise ValueError("typo")

    ending, _, autopilot = fly(mission)
    assert ending.outcome is Outcome.PROCESS_FAILURE
    assert "test_supervisor.py" in ending.reason
    assert "ValueError: typo" in ending.reason
    assert not autopilot.status.latest.armed


def test_a_behavior_that_fails_lands():
    async def mission(drone):
        await drone.takeoff()
        await drone.follow([[1.0, 0.0, 1.5]])

    ending, _, autopilot = fly(mission)
    assert ending.outcome is Outcome.TIME_OUT
    assert not autopilot.status.latest.armed


def test_a_fault_in_flight_lands():
    async def fault(context):
        await asyncio.sleep(4.0)
        context.bus.fault.publish(Fault(context.now(), FaultKind.POSE_LOST, "for long"))

    ending, context, autopilot = fly(up_and_down, during=fault)
    assert ending.outcome is Outcome.PROCESS_FAILURE
    assert ending.reason == "pose lost: for long"
    assert context.machine.phase is Phase.ABORTED
    assert not autopilot.status.latest.armed


def test_a_task_that_dies_lands():
    def work(context):
        async def mapping():
            await asyncio.sleep(4.0)
            raise RuntimeError("boom")

        return {"mapping": mapping()}

    ending, _, autopilot = fly(up_and_down, work=work)
    assert ending.outcome is Outcome.PROCESS_FAILURE
    assert "task mapping failed" in ending.reason
    assert "RuntimeError: boom" in ending.reason
    assert not autopilot.status.latest.armed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_lands_and_a_second_one_changes_nothing(number):
    async def interrupt(context):
        await asyncio.sleep(4.0)
        os.kill(os.getpid(), number)
        await asyncio.sleep(1.0)
        os.kill(os.getpid(), number)

    ending, context, autopilot = fly(up_and_down, during=interrupt)
    assert ending.outcome is Outcome.INTERRUPTED
    assert context.machine.phase is Phase.ABORTED
    assert not autopilot.status.latest.armed


def test_after_a_pilot_took_over_nothing_is_asked_of_the_autopilot():
    async def fault(context):
        await asyncio.sleep(4.0)
        context.bus.fault.publish(Fault(context.now(), FaultKind.TAKEN_OVER, "pilot"))

    events = []

    def work(context):
        context.bus.event.tap(events.append)
        return {}

    _, context, autopilot = fly(up_and_down, taken_over=True, during=fault, work=work)
    assert "land" not in autopilot.calls
    assert [event.text for event in events][-2:] == [
        "the vehicle was taken over: nothing is asked of the autopilot until it has disarmed",
        f"landing not confirmed: not disarmed within {context.config.mission.land_timeout:g} s",
    ]
    assert events[-1].stamp == pytest.approx(4.0 + context.config.mission.land_timeout, abs=0.1)


def test_after_a_pilot_took_over_the_flight_ends_when_he_has_landed():
    async def fault(context):
        await asyncio.sleep(4.0)
        context.bus.fault.publish(Fault(context.now(), FaultKind.TAKEN_OVER, "pilot"))
        await asyncio.sleep(3.0)
        context.autopilot._set(mode=FlightMode.POSITION, armed=False)
        ended.append(context.now())

    ended = []
    ending, _, autopilot = fly(up_and_down, taken_over=True, during=fault)
    assert ended, "not before"
    assert (ending.outcome, ending.reason) == (Outcome.PROCESS_FAILURE, "pilot takeover: pilot")
    assert "land" not in autopilot.calls


def test_a_pilot_who_took_over_unheard_is_heard_before_a_landing_is_asked_for():
    async def fault(context):
        await asyncio.sleep(4.0)
        context.bus.fault.publish(Fault(context.now(), FaultKind.NO_COMMAND, "the sender stalled"))
        await asyncio.sleep(0.1)
        context.autopilot._set(mode=FlightMode.POSITION, stamp=context.now())
        await asyncio.sleep(3.0)
        context.autopilot._set(armed=False, stamp=context.now())

    ending, _, autopilot = fly(up_and_down, during=fault)
    assert ending.reason == "no command: the sender stalled"
    assert "land" not in autopilot.calls


class SlowToArm(FakeAutopilot):
    """Takes half a second until it says that it has armed."""

    async def arm(self):
        self.calls.append("arm")
        await asyncio.sleep(0.5)
        if self.refuse == "arm":
            raise AutopilotError("arm refused: test")
        self._set(armed=True, landed=False)


@pytest.mark.parametrize("refuse", ["", "arm"])
def test_who_interrupts_the_arming_lands_what_has_armed(refuse):
    async def fault(context):
        await asyncio.sleep(0.3)
        assert context.autopilot.calls[-1] == "arm"
        context.bus.fault.publish(Fault(context.now(), FaultKind.POSE_LOST, "for long"))

    ending, _, autopilot = fly(up_and_down, SlowToArm(refuse), during=fault)
    assert ending.reason == "pose lost: for long"
    assert autopilot.calls[-1] == ("arm" if refuse else "land")
    assert not autopilot.status.latest.armed


def test_a_link_that_is_never_found_ends_the_flight_on_the_ground():
    ending, context, autopilot = fly(up_and_down, FakeAutopilot(refuse="connect"))
    assert ending.outcome is Outcome.PROCESS_FAILURE
    assert "connect refused" in ending.reason
    assert autopilot.calls == ["connect"]
    assert context.machine.phase is Phase.IDLE


def test_an_autopilot_that_does_not_land_is_reported():
    async def fault(context):
        await asyncio.sleep(4.0)
        context.bus.fault.publish(Fault(context.now(), FaultKind.POSE_LOST, "for long"))

    events = []

    def work(context):
        context.bus.event.tap(events.append)
        return {}

    fly(up_and_down, FakeAutopilot(refuse="land"), work=work, during=fault)
    assert any("landing not confirmed" in event.text for event in events)


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


def told(kind, *, at=4.0, lasts=None):
    """Beside a flight: a fault of ``kind`` at ``at`` s, over ``lasts`` s later, if ever."""

    async def tell(context):
        await asyncio.sleep(at)
        context.bus.fault.publish(Fault(context.now(), kind, "test"))
        if lasts is not None:
            await asyncio.sleep(lasts)
            context.bus.fault.publish(Fault(context.now(), kind, "", over=True))

    return tell


def test_what_calls_for_nothing_changes_nothing():
    ending, _, autopilot = fly(up_and_down, during=told(FaultKind.DISK_FULL))
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert autopilot.calls[-1] == "land"


@pytest.mark.parametrize("kind", [FaultKind.BATTERY_LOW, FaultKind.DISK_FULL, FaultKind.TASK_FAILED])
def test_what_forbids_a_flight_ends_it_before_it_is_armed(kind):
    async def mission(drone):
        await asyncio.sleep(1.0)
        await up_and_down(drone)

    ending, _, autopilot = fly(mission, during=told(kind, at=0.5))
    assert (ending.outcome, ending.reason) == (Outcome.PROCESS_FAILURE, f"{kind}: test")
    assert autopilot.calls == ["connect"]


def test_what_has_passed_before_the_takeoff_forbids_nothing_that_allows_it_later():
    async def mission(drone):
        await drone.takeoff()
        await drone.land()

    ending, _, _ = fly(mission, during=told(FaultKind.CLOCK_JUMP, at=0.0, lasts=0.1))
    assert ending.outcome is Outcome.GOAL_ACHIEVED


def test_a_slow_flight_is_slow_for_as_long_as_the_fault_lasts():
    caution, held = SimpleNamespace(held=""), {}

    async def look(context):
        beside = asyncio.create_task(told(FaultKind.OVERLOAD, lasts=1.0)(context))
        for moment in (3.9, 4.5, 5.5):
            await asyncio.sleep(moment - context.now())
            held[moment] = caution.held
        await beside

    ending, _, _ = fly(up_and_down, during=look, caution=caution)
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert held == {3.9: "", 4.5: "compute overload: test", 5.5: ""}


def test_a_hold_that_passes_is_flown_on_after():
    events = []

    async def mission(drone):
        await drone.takeoff()
        await drone.hover(5.0, timeout=20.0)
        await drone.land()

    def work(context):
        context.bus.event.tap(lambda event: events.append(event.text))
        return {}

    ending, _, _ = fly(mission, during=told(FaultKind.CAMERA_LOST, lasts=2.0), work=work)
    assert ending.outcome is Outcome.GOAL_ACHIEVED
    assert "camera lost: test; hold" in events
    assert any(text.startswith("hover suspended: camera lost") for text in events)
    assert any(text.startswith("hover resumed") for text in events)


def test_a_hold_that_does_not_pass_lands():
    ended = []

    async def mission(drone):
        await drone.takeoff()
        await drone.hover(100.0)

    def work(context):
        context.bus.phase.tap(lambda phase: ended.append(context.now()) if phase is Phase.ABORTED else None)
        return {}

    ending, context, autopilot = fly(mission, during=told(FaultKind.CAMERA_LOST), work=work)
    assert ending.reason == "camera lost: test"
    assert ended == [pytest.approx(4.0 + context.config.safety.hold_time, abs=0.1)]
    assert not autopilot.status.latest.armed


def test_a_vehicle_that_has_tipped_over_has_its_motors_stopped():
    _, _, autopilot = fly(up_and_down, during=told(FaultKind.TIPPED_OVER))
    assert autopilot.calls[-1] == "kill"
    assert "land" not in autopilot.calls


def test_one_that_tips_over_while_it_lands_as_well():
    async def both(context):
        await told(FaultKind.POSE_LOST)(context)
        await told(FaultKind.TIPPED_OVER, at=1.0)(context)

    ending, _, autopilot = fly(up_and_down, during=both)
    assert ending.reason == "pose lost: test"
    assert autopilot.calls[-2:] == ["land", "kill"]


def test_the_same_fault_told_again_is_not_logged_again():
    events = []

    def work(context):
        context.bus.event.tap(lambda event: events.append(event.text))
        return {}

    async def twice(context):
        await told(FaultKind.DISK_FULL)(context)
        await told(FaultKind.DISK_FULL, at=0.1)(context)

    fly(up_and_down, during=twice, work=work)
    assert events.count("disk full: test; continue") == 1


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
