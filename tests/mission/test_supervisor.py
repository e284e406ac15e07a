"""Whatever happens to a flight ends on the ground, or in the pilot's hands."""

import asyncio
import os
import signal

import pytest
from fakes import FakeAutopilot
from supervised import fly, up_and_down

from flightapp.interfaces import AutopilotError
from flightapp.messages import FlightMode, Outcome, Phase
from flightapp.safety.faults import Fault, FaultKind


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
