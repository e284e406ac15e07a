"""The control task: line and state in, commands out, and what it does when there are none to send."""

import asyncio
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fakes import state, virtually

from flightapp import tasks
from flightapp.autopilot.guard import CommandGuard
from flightapp.autopilot.sender import SenderReport
from flightapp.bus import Bus
from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.control.flatness import FlatnessController
from flightapp.evaluation.flight import Commands, Flight
from flightapp.evaluation.summary import summarise
from flightapp.frames import GRAVITY, quat_from_euler
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand
from flightapp.planning.line import Line
from flightapp.service.pulse import Pulse
from flightapp.timing import KernelTicker, Ticker
from flightapp.trajectory import hover

CONFIG = Config()
HOLD, TICK = CONFIG.guard.hold, 1.0 / CONFIG.control.rate
HERE = np.array((0.0, 0.0, 1.5))


class Hoverer:
    """A controller that hovers, but fails while told to."""

    report = "all hovered"

    def __init__(self):
        self.failing = False
        self.resets = 0

    def reset(self):
        self.resets += 1

    def command(self, stamp, state, trajectory):
        if self.failing:
            raise IndexError("out of range")
        return RateCommand(stamp, np.zeros(3), 10.0)


class Flight250:
    """The control task on a bus, with an autopilot that only listens."""

    def __init__(self, controller=None, ticker=Ticker):
        self.status = Topic("status")
        self.sent = []
        self.rig = SimpleNamespace(autopilot=SimpleNamespace(status=self.status, send=self.send))
        self.bus, self.line = Bus(), Line()
        self.controller = controller or Hoverer()
        self.guard = CommandGuard(CONFIG)
        self.faults, self.events = [], []
        self.bus.fault.tap(self.faults.append)
        self.bus.event.tap(self.events.append)
        self.mode, self.hearing, self.seeing = FlightMode.OFFBOARD, True, True
        self.attitude = quat_from_euler(0.0, 0.0, 0.0)
        self.ticker = ticker(CONFIG.control.rate)

    def send(self, command):
        self.sent.append((asyncio.get_running_loop().time(), command))

    def since(self, stamp):
        """Commands sent at ``stamp`` or later."""
        return [command for at, command in self.sent if at >= stamp]

    def heard(self, **changes):
        now = asyncio.get_running_loop().time()
        status = AutopilotStatus(now, self.mode, True, False, True, 16.0, 0.9)
        self.status.publish(replace(status, **changes))

    async def surroundings(self):
        while True:
            if self.hearing:
                self.heard()
            if self.seeing:
                here = state(asyncio.get_running_loop().time())
                self.bus.state.publish(replace(here, orientation=self.attitude))
            await asyncio.sleep(0.01)

    async def fly(self, mission):
        self.line.accept(hover(0.0, HERE, 0.0))
        modules = SimpleNamespace(controller=self.controller, guard=self.guard)
        control = tasks.control(self.rig, self.bus, modules, self.line, self.ticker)
        running = [asyncio.create_task(work) for work in (self.surroundings(), control)]
        try:
            await mission(self)
        finally:
            for task in running:
                task.cancel()
            ended = await asyncio.gather(*running, return_exceptions=True)
            self.ticker.close()
        assert all(isinstance(end, asyncio.CancelledError) for end in ended)


def flown(mission, **options):
    async def main():
        flight = Flight250(**options)
        await flight.fly(mission)
        return flight

    return virtually(main())


def now():
    return asyncio.get_running_loop().time()


def test_commands_go_out_at_the_rate_and_are_published():
    async def mission(flight):
        await asyncio.sleep(1.0)

    flight = flown(mission)
    assert len(flight.sent) == pytest.approx(250, abs=3)
    assert flight.bus.command.count == flight.bus.setpoint.count == len(flight.sent)
    assert not flight.faults
    assert [event.text for event in flight.events if event.kind == "control"] == ["all hovered"]


def test_its_turns_feed_the_watchdog_until_it_stalls():
    pings = []

    async def mission(flight):
        pulse = Pulse(lambda: pings.append(now()), 1.0, now)
        flight.bus.tick.tap(lambda _: pulse.tick())
        pulse.fly(CONFIG.control.rate)
        await asyncio.sleep(2.0)
        flight.line.clear()  # what is not sent is no stall
        await asyncio.sleep(1.0)
        flight.ticker.tick = asyncio.Event().wait
        await asyncio.sleep(2.0)

    flown(mission)
    assert len(pings) == pytest.approx(12, abs=1) and max(pings) == pytest.approx(3.0, abs=0.3)


def test_without_a_line_nothing_is_sent_and_the_controller_starts_anew():
    async def mission(flight):
        flight.line.clear()
        await asyncio.sleep(0.1)

    flight = flown(mission)
    assert not flight.sent
    assert flight.controller.resets == pytest.approx(25, abs=2)


def test_a_controller_that_fails_for_a_moment_is_bridged_and_told_once():
    async def mission(flight):
        await asyncio.sleep(0.5)
        flight.controller.failing = True
        await asyncio.sleep(0.04)
        flight.controller.failing = False
        await asyncio.sleep(1.0)

    flight = flown(mission)
    held = [command for _, command in flight.sent if command.thrust == pytest.approx(GRAVITY)]
    assert len(held) == pytest.approx(10, abs=1)
    assert np.diff([at for at, _ in flight.sent]).max() == pytest.approx(TICK)
    assert not flight.faults
    told = [event.text for event in flight.events if event.kind == "guard"]
    assert len(told) == 2
    assert "IndexError: out of range" in told[0]
    assert told[1].startswith("sender: 250.0 Hz")


def test_a_controller_that_stays_broken_is_held_for_and_then_the_autopilot_is_asked():
    async def mission(flight):
        await asyncio.sleep(0.5)
        flight.controller.failing = True
        await asyncio.sleep(1.0)

    flight = flown(mission)
    last = flight.sent[-1][0]
    assert last == pytest.approx(0.5 + HOLD, abs=2.0 * TICK)
    assert flight.sent[-1][1].thrust == pytest.approx(GRAVITY)
    assert len(flight.faults) == 1
    assert "no sound command for too long" in flight.faults[0].text
    assert "IndexError" in flight.faults[0].text
    assert flight.faults[0].stamp == pytest.approx(last, abs=2.0 * TICK)
    assert flight.line.latest is None
    assert flight.guard.handed_over


def test_what_is_held_keeps_the_height_of_a_tilted_vehicle():
    async def mission(flight):
        flight.attitude = quat_from_euler(0.0, 0.8, 0.0)
        await asyncio.sleep(0.5)
        flight.controller.failing = True
        await asyncio.sleep(0.1)

    flight = flown(mission)
    assert flight.sent[-1][1].thrust * np.cos(0.8) == pytest.approx(GRAVITY)


def test_a_line_that_comes_after_handing_over_is_not_flown():
    async def mission(flight):
        flight.controller.failing = True
        await asyncio.sleep(0.5)
        flight.controller.failing = False
        flight.line.accept(hover(now(), HERE, 0.0))
        mission.late = now()
        await asyncio.sleep(0.1)

    flight = flown(mission)
    assert not flight.since(mission.late)
    assert flight.line.latest is None


def test_when_the_state_stays_away_commands_end():
    async def mission(flight):
        await asyncio.sleep(0.5)
        flight.seeing = False
        await asyncio.sleep(1.0)

    flight = flown(mission)
    limit = 0.5 + CONFIG.safety.state_timeout + HOLD
    assert flight.sent[-1][0] == pytest.approx(limit, abs=0.02)
    assert "the state is too old" in flight.faults[0].text


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.LAND, FlightMode.HOLD])
def test_a_pilots_mode_change_ends_the_commands_within_a_tick_and_for_good(mode):
    async def mission(flight):
        await asyncio.sleep(0.5)
        flight.mode = mode
        flight.heard()
        mission.at = now()
        await asyncio.sleep(0.3)
        flight.mode = FlightMode.OFFBOARD
        flight.line.accept(hover(now(), HERE, 0.0))
        await asyncio.sleep(0.3)

    flight = flown(mission)
    assert not flight.since(mission.at + 1e-9)
    assert flight.guard.taken_over
    assert "taken over" in flight.faults[0].text
    assert flight.faults[0].stamp - mission.at <= TICK + 1e-9


def test_a_dead_link_is_not_sent_into_for_ever():
    async def mission(flight):
        await asyncio.sleep(0.5)
        flight.hearing = False
        await asyncio.sleep(3.0)

    flight = flown(mission)
    assert flight.sent[-1][0] == pytest.approx(0.5 + CONFIG.link.lost_after + HOLD, abs=0.03)
    assert "nothing is heard of the autopilot" in flight.faults[0].text


def test_a_status_of_no_time_is_not_flown_on():
    async def mission(flight):
        await asyncio.sleep(0.5)
        flight.hearing = False
        flight.heard(stamp=float("nan"))
        await asyncio.sleep(0.5)

    flight = flown(mission)
    assert flight.sent[-1][0] == pytest.approx(0.5, abs=2.0 * TICK)
    assert len(flight.faults) == 1
    assert flight.faults[0].stamp == pytest.approx(0.5 + HOLD, abs=2.0 * TICK)


@pytest.mark.parametrize(("left", "refused"), [(False, False), (True, True)])
def test_after_a_stall_of_the_loop_the_mode_of_now_decides(left, refused):
    """On the wall clock: what the autopilot says while the loop is blocked arrives once it goes on."""

    async def mission(flight):
        await asyncio.sleep(0.1)
        assert flight.sent
        flight.mode = FlightMode.LAND if left else FlightMode.OFFBOARD
        time.sleep(0.4)  # noqa: ASYNC251
        mission.resumed = now()
        await asyncio.sleep(0.15)

    async def main():
        flight = Flight250(ticker=KernelTicker)
        await flight.fly(mission)
        return flight

    flight = asyncio.run(main())
    after = [(at, command) for at, command in flight.sent if at >= mission.resumed]
    assert bool(after) is not refused
    assert flight.guard.taken_over is refused
    assert all(at - command.stamp < CONFIG.guard.late for at, command in after)
    assert not after or len(after) <= (after[-1][0] - after[0][0]) / TICK + 2.0


def test_the_real_controller_recovers_from_a_state_that_is_not_finite():
    async def mission(flight):
        await asyncio.sleep(0.5)
        flight.seeing = False
        flight.bus.state.publish(replace(state(now()), orientation=np.full(4, np.nan)))
        await asyncio.sleep(0.05)
        flight.seeing = True
        await asyncio.sleep(0.5)

    flight = flown(mission, controller=FlatnessController(CONFIG))
    assert not flight.faults
    assert flight.guard.counts.held == pytest.approx(13, abs=2)
    assert all(np.isfinite(command.rates).all() for _, command in flight.sent)
    assert flight.sent[-1][0] > 1.0


def test_the_senders_report_reaches_the_summary():
    async def mission(flight):
        await asyncio.sleep(0.1)

    flight = flown(mission)
    report = SenderReport(flight.ticker.statistics(), flight.guard.counts)
    stamps = np.arange(100) * TICK
    log = Flight(header={"sender": report.entry()}, commands=Commands(stamps, np.zeros((100, 3)), np.zeros(100)))
    sender = summarise(log)["sender"]
    assert sender["guard"]["passed"] == len(flight.sent)
    assert sender["guard"]["reasons"] == {}
    assert sender["p50"] == pytest.approx(TICK)
    assert report.line().startswith("sender: 250.0 Hz")
    assert summarise(replace(log, header={"sender": "?"}))["sender"]["guard"] is None
