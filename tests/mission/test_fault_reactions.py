"""What the supervisor does about a fault, as the table says."""

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest
from fakes import FakeAutopilot
from supervised import fly, up_and_down

from flightapp.interfaces import Motion, PlanRequest
from flightapp.messages import Drift, GateEstimate, GateMap, Outcome, Phase
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.safety.faults import Fault, FaultKind


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


def moving(context):
    """A line that is under way along x for 4 s; where it is flown through gate 1's opening is at 8 m."""
    way = np.array([(12.0, 0.0, 1.5)])
    rest = Motion(np.array((0.0, 0.0, 1.5)), *np.zeros((3, 3)), 0.0, 0.0)
    request = PlanRequest(context.now(), rest, (), way[-1], context.limits)
    return PolynomialPlanner(context.config).through(way, request)


GATE = GateMap(
    0.0,
    1,
    (GateEstimate(1, np.array((8.0, 0.0, 1.5)), 0.0, np.zeros((4, 4)), 9, 0.0),),
    Drift(0.0, np.zeros(3), 0.0, np.zeros((4, 4))),
)


def broken_off_at(x, kind):
    """Where the line was when the landing was asked for, of a flight along `moving` that ``kind`` ends at ``x`` m."""
    places, autopilot = [], FakeAutopilot()

    async def mission(drone):
        await drone.takeoff()
        await drone.hover(60.0)

    async def during(context):
        told, line = False, None
        while autopilot.calls[-1:] != ["land"]:
            await asyncio.sleep(0.01)
            autopilot._set(stamp=context.now())
            if line is None and context.machine.phase is Phase.FLYING:
                line = moving(context)
                context.line.clear()
                context.line.accept(line)
                context.bus.gate_map.publish(GATE)
            if line is not None and (flown := context.line.at(context.now())) is not None:
                setpoint = flown.setpoint(context.now())
                places[:] = [setpoint.position[0], float(np.linalg.norm(setpoint.velocity))]
                if places[0] >= x and not told:
                    context.bus.fault.publish(Fault(context.now(), kind, "test"))
                    told = True

    fly(mission, autopilot, during=during)
    return places


@pytest.mark.parametrize("x", [3.0, 6.5, 7.5, 8.0])
def test_what_still_flies_lands_from_rest_where_no_frame_is_below(x):
    place, speed = broken_off_at(x, FaultKind.TASK_FAILED)
    assert speed < 0.05
    assert place > x
    assert abs(place - 8.0) > 0.6


def test_what_is_adrift_is_landed_where_it_is():
    place, speed = broken_off_at(6.5, FaultKind.OFF_THE_LINE)
    assert speed > 1.0
    assert place == pytest.approx(6.5, abs=0.5)
