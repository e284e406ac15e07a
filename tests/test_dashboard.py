"""The flight at a glance on a terminal: what it tells, that it fits, and what there is without a terminal."""

import dataclasses
import io
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from flightapp import display
from flightapp.bus import Bus
from flightapp.channel import Topic
from flightapp.dashboard import EVENTS, Dashboard, Rate
from flightapp.interfaces import Limits
from flightapp.messages import (
    AutopilotStatus,
    Event,
    FlightMode,
    Frame,
    Phase,
    PlanReport,
    RateCommand,
    Setpoint,
    VehicleState,
)
from flightapp.planning.goal import Goal
from flightapp.safety.faults import Fault, FaultKind


def state(stamp, position=(1.0, -2.0, 3.0), doubt=""):
    rest, level = np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0))
    return VehicleState(stamp, np.array(position), level, np.array((3.0, 4.0, 0.0)), rest, np.eye(9) * 0.01, doubt)


@pytest.fixture
def bus():
    return Bus()


@pytest.fixture
def rig():
    return SimpleNamespace(autopilot=SimpleNamespace(status=Topic("autopilot")))


def text_of(dashboard, width=100):
    console = Console(width=width, file=io.StringIO())
    console.print(dashboard.draw())
    return console.file.getvalue()


def fly_a_while(bus, rig, dashboard, end=3.0):
    bus.event.publish(Event(0.0, "phase", "flying: the climb is over"))
    bus.phase.publish(Phase.FLYING)
    bus.behaviors.publish(("race",))
    rig.autopilot.status.publish(AutopilotStatus(0.0, FlightMode.OFFBOARD, True, False, True, 15.8, 0.87))
    bus.goal.publish(Goal(np.zeros(3), Limits(4.0, 8.0, 3.0), (1, 2, 3), 2))
    for k in range(int(end * 100)):
        stamp = 0.01 * (k + 1)
        bus.state.publish(state(stamp))
        bus.setpoint.publish(Setpoint(stamp, np.array((1.0, -2.0, 3.25)), *(np.zeros(3),) * 3, 0.0, 0.0))
        bus.command.publish(RateCommand(stamp, np.zeros(3), 9.81))
        if k % 4 == 0:
            bus.frame.publish(Frame(stamp, k, None))
        if k % 10 == 0:
            dashboard.draw()


def test_it_tells_what_the_flight_does_and_how_well(bus, rig):
    dashboard = Dashboard(bus, rig)
    bus.plan.publish(PlanReport(0.5, 0.0123, True, ""))
    fly_a_while(bus, rig, dashboard)
    text = text_of(dashboard)
    for expected in (
        *("flying · 3.0 s", "race", "1.00   -2.00   3.00 m", "5.00 m/s", "2 of 3 passed, 0 known"),
        *("100.0 Hz", "25 Hz", "1 flown, 0 refused, last 12.3 ms", "87 %, 15.8 V", "offboard, armed"),
        *("0.25 m", "0.17 m", "the climb is over"),
    ):
        assert expected in text, expected


def test_it_says_what_is_not_known(bus, rig):
    text = text_of(Dashboard(bus, rig))
    for expected in ("starting", "not known yet", "none"):
        assert expected in text


def test_faults_stand_there_while_they_last(bus, rig):
    dashboard = Dashboard(bus, rig)
    fault = Fault(1.0, FaultKind.POSE_LOST, "no pose for 0.4 s")
    bus.fault.publish(fault)
    assert "pose lost: no pose for 0.4 s" in text_of(dashboard)
    bus.fault.publish(dataclasses.replace(fault, over=True))
    text = text_of(dashboard)
    assert "pose lost" not in text


def test_only_the_newest_events_are_shown(bus, rig):
    dashboard = Dashboard(bus, rig)
    for k in range(30):
        bus.event.publish(Event(0.1 * k, "gate", f"notice {k:02d}"))
    text = text_of(dashboard)
    assert [k for k in range(30) if f"notice {k:02d}" in text] == list(range(30 - EVENTS, 30))


@pytest.mark.parametrize("width", [40, 60, 80, 200])
def test_it_fits_the_terminal(bus, rig, width):
    dashboard = Dashboard(bus, rig)
    fly_a_while(bus, rig, dashboard, 1.5)
    bus.event.publish(Event(1.0, "fault", "very " * 60 + "long"))
    lines = text_of(dashboard, width).splitlines()
    assert max(map(len, lines)) <= width
    assert any("5.00 m/s" in line for line in lines)
    assert any("87 %" in line for line in lines)


def test_a_silent_sender_has_no_rate(bus, rig):
    dashboard = Dashboard(bus, rig)
    fly_a_while(bus, rig, dashboard)
    assert "100.0 Hz" in text_of(dashboard)
    bus.state.publish(state(4.0))
    assert "100.0 Hz" not in text_of(dashboard)


def test_rates_are_taken_over_a_second():
    rate = Rate()
    for k in range(301):
        rate.take(0.01 * k, 1 + 2 * k)
        if k < 100:
            assert rate.value is None
    assert rate.value == pytest.approx(200.0, rel=0.02)


def test_without_a_terminal_events_are_plain_lines(bus, rig):
    console = Console(file=io.StringIO(), force_terminal=False, width=100)
    with display.dashboard(console) as watch:
        watch(bus, rig)
        bus.event.publish(Event(2.0, "phase", "flying: the climb is over"))
    text = console.file.getvalue()
    assert text.splitlines() == ["    0.00 s  flying: the climb is over"]
    assert "\x1b" not in text


def test_on_a_terminal_it_is_drawn_to_the_end(bus, rig):
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    with display.dashboard(console) as watch:
        watch(bus, rig)
        bus.event.publish(Event(2.0, "phase", "landed: disarmed on the ground"))
    assert "landed: disarmed on the ground" in console.file.getvalue()
