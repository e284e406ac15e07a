"""What a flight does when somebody outside asks for something."""

import asyncio
import threading
from pathlib import Path

import numpy as np
import pytest
from fakes import FakeAutopilot
from supervised import fly, up_and_down

from flightapp import app
from flightapp.inputs import BadInputError
from flightapp.messages import FlightMode, Outcome, Phase
from flightapp.mission.orders import WAITING, Orders
from flightapp.recording.reader import read_flight

MISSION = Path(__file__).parents[2] / "missions" / "lemniscate.py"


def ordered(*given):
    """A flight during which ``given`` orders come: (s, "stop" or "abort"); its events too."""
    orders, events = Orders(), []

    async def give(context):
        for when, what in given:
            await asyncio.sleep(when - context.now())
            getattr(orders, what)(f"{what} asked for")

    def work(context):
        context.bus.event.tap(events.append)
        return {}

    ending, context, autopilot = fly(up_and_down, work=work, during=give, orders=orders)
    assert orders.begun and not orders.flying
    return ending, context, autopilot, [event.text for event in events]


def test_a_stop_comes_to_rest_and_lands():
    ending, context, autopilot, texts = ordered((4.0, "stop"))
    assert (ending.outcome, ending.reason) == (Outcome.INTERRUPTED, "stop asked for")
    assert context.machine.phase is Phase.ABORTED and autopilot.calls[-1] == "land"
    assert not autopilot.status.latest.armed
    assert not any("right here" in text for text in texts)


def test_a_second_order_changes_nothing():
    ending, _, autopilot, _ = ordered((4.0, "stop"), (4.01, "stop"), (4.02, "abort"))
    assert ending.reason == "stop asked for"
    assert autopilot.calls.count("land") == 1
    assert not autopilot.status.latest.armed


def flown_until(tmp_path, *orders):
    """The log of a lemniscate at 4 m/s, in which ``orders`` come as soon as it is faster than 3 m/s."""
    plan = app.FlightPlan(MISSION, tmp_path, overrides=("sim.camera=corners", "race.v_max=4"))
    given = Orders()

    def watch(bus, _):
        bus.state.tap(
            lambda state: np.linalg.norm(state.velocity) > 3.0 and [getattr(given, one)(one) for one in orders]
        )

    flown = app.fly_prepared(plan, app.prepare(plan), watch, given)
    assert (flown.ending.outcome, flown.ending.reason) == (Outcome.INTERRUPTED, orders[0])
    flight = read_flight(tmp_path / "flight.mcap")
    assert not flight.statuses[-1].armed
    asked = next(event.stamp for event in flight.events if event.text.startswith("aborted"))
    landing = next(one.stamp for one in flight.statuses if one.stamp > asked and one.mode is FlightMode.LAND)
    return landing - asked, [event.text for event in flight.events]


def test_in_flight_a_stop_brakes_along_the_line_and_an_abort_lands_at_once(tmp_path):
    stopped, texts = flown_until(tmp_path / "stop", "stop")
    assert stopped > 0.5 and not any("right here" in text for text in texts)
    # An abort counts while a stop is carried out, too.
    aborted, texts = flown_until(tmp_path / "abort", "stop", "abort")
    assert aborted < 0.3 and "it lands right here: abort" in texts


def test_before_the_flight_has_begun_nothing_is_asked_of_the_autopilot():
    orders, autopilot = Orders(), FakeAutopilot()
    orders.stop("thought better of it")
    ending, context, _ = fly(up_and_down, autopilot, orders=orders)
    assert (ending.outcome, ending.reason) == (Outcome.INTERRUPTED, "thought better of it")
    assert autopilot.calls == [] and context.machine.phase is Phase.IDLE


def test_a_vehicle_that_is_armed_by_somebody_else_is_left_alone():
    autopilot = FakeAutopilot()
    autopilot._set(armed=True, landed=False, mode=FlightMode.POSITION)
    ending, context, _ = fly(up_and_down, autopilot)
    assert ending.outcome is Outcome.PROCESS_FAILURE
    assert ending.reason == "the vehicle is armed, and not by this flight: let it land and disarm, then start again"
    assert autopilot.calls == ["connect"] and context.machine.phase is Phase.IDLE


def test_where_nothing_flies_nothing_is_retuned():
    with pytest.raises(BadInputError, match="nothing flies"):
        Orders().retune({"control.yaw_bandwidth": "2"}).result(0)


async def test_retunings_from_other_threads_come_in_order_and_those_left_over_are_refused():
    orders, asked, taken = Orders(), [], []

    def ask():
        asked.extend(orders.retune({"control.yaw_bandwidth": str(k)}) for k in range(WAITING + 2))

    with orders:
        thread = threading.Thread(target=ask)
        thread.start()
        for _ in range(3):
            one = await asyncio.wait_for(orders.retuning(), 5.0)
            taken.append(one.settings["control.yaw_bandwidth"])
            one.answer.set_result("done")
        thread.join()
    assert taken == ["0", "1", "2"]
    assert [future.result(0) for future in asked[:3]] == ["done"] * 3
    for future in asked[3:]:
        with pytest.raises(BadInputError, match=r"nothing flies|wait already"):
            future.result(0)
