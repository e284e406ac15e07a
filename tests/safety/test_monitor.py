"""The monitor: each fault is told once when it has lasted, and once when it has been gone for long enough."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.messages import FlightMode
from flightapp.safety.faults import FaultKind, Stage
from flightapp.safety.monitor import (
    OVERLOADED,
    OVERLOADED_BEFORE,
    STARTUP,
    Condition,
    Monitor,
    Readings,
    _Watched,
    conditions,
)

CONFIG = load_config(None, {"geofence.corners": ((-5.0, -5.0), (5.0, 5.0)), "race.v_max": 4.0})
GOOD = Readings(
    0.0,
    Stage.FLYING,
    commanded=True,
    state_age=0.01,
    pose_age=0.01,
    position=np.array((0.0, 0.0, 1.0)),
    armed=True,
    mode=FlightMode.OFFBOARD,
    status_age=0.05,
    charge=0.8,
    disk_free=1e4,
)
WRONG = {
    FaultKind.STATE_UNTRUSTED: {"doubt": "contradiction"},
    FaultKind.POSE_MISSING: {"pose_age": 0.3},
    FaultKind.POSE_LOST: {"commanded": False, "state_age": 0.3},
    FaultKind.CAMERA_LOST: {"image_age": 1.1},
    FaultKind.PLANNER_FAILING: {"at_rest": True, "plans_refused": 5},
    FaultKind.OFF_THE_LINE: {"line_error": 2.1},
    FaultKind.GEOFENCE_LEFT: {"position": np.array((5.6, 0.0, 1.0))},
    FaultKind.OUT_OF_ENVELOPE: {"speed": 7.1},
    FaultKind.TIPPED_OVER: {"tilt": math.radians(75.0)},
    FaultKind.BATTERY_LOW: {"charge": 0.19},
    FaultKind.BATTERY_CRITICAL: {"charge": 0.09},
    FaultKind.LINK_LOST: {"status_age": 1.1},
    FaultKind.TAKEN_OVER: {"mode": FlightMode.POSITION},
    FaultKind.OVERLOAD: {"ticks_missed": 0.5},
    FaultKind.DISK_FULL: {"disk_free": 100.0},
    FaultKind.LOG_FAILING: {"log_error": "No space left"},
    FaultKind.CLOCK_JUMP: {"clock_moved": -1.0},
}


def told(*pieces, gates=True, period=0.05):
    """The faults that are told of ``pieces`` (s, changes of the readings), one after the other."""
    monitor, now, faults = Monitor(CONFIG, gates), 0.0, []
    for seconds, changes in pieces:
        for _ in range(round(seconds / period)):
            now += period
            faults += monitor.look(replace(GOOD, stamp=now, **changes))
    return faults


def test_nothing_is_told_where_nothing_is_wrong():
    assert told((5.0, {})) == []


def test_every_condition_has_readings_that_are_wrong():
    assert {condition.kind for condition in conditions(CONFIG, gates=True)} == set(WRONG)


@pytest.mark.parametrize("kind", WRONG)
def test_each_fault_is_told_once_and_alone_and_then_that_it_is_over(kind):
    faults = told((2.0, {}), (3.0, WRONG[kind]), (3.0, {}))
    expected = [kind] if kind is not FaultKind.BATTERY_CRITICAL else [FaultKind.BATTERY_LOW, kind]
    begun = [fault for fault in faults if not fault.over]
    assert sorted(fault.kind for fault in begun) == sorted(expected)
    assert all(2.0 <= fault.stamp <= 3.2 and fault.text for fault in begun)
    lasting = {FaultKind.BATTERY_LOW, FaultKind.BATTERY_CRITICAL, FaultKind.TAKEN_OVER, FaultKind.LOG_FAILING}
    assert [fault.kind for fault in faults if fault.over] == [k for k in expected if k not in lasting]


@pytest.mark.parametrize(
    "changes",
    [
        {"charge": math.nan},
        {"status_age": math.nan},
        {"state_age": math.nan, "pose_age": math.nan, "position": None, "commanded": False},
        {"plans_refused": 50},
        {"tilt": math.radians(80.0), "speed": 3.0},
        {"position": np.array((5.4, 0.0, 1.0))},
        {"stage": Stage.PREFLIGHT, "armed": False, "mode": FlightMode.MANUAL},
        {"stage": Stage.TAKEOFF, "speed": 7.0, "mode": FlightMode.TAKEOFF},
        {"stage": Stage.PREFLIGHT, "images": 0, "image_age": STARTUP - 0.1},
    ],
)
def test_what_is_unknown_or_has_nothing_to_do_with_it_is_no_fault(changes):
    assert told((3.0, changes)) == []


def test_without_gates_no_camera_is_needed():
    assert told((3.0, {"image_age": 100.0}), gates=False) == []
    assert [fault.kind for fault in told((3.0, {"image_age": 100.0}))] == [FaultKind.CAMERA_LOST]


@given(
    st.lists(st.tuples(st.floats(0.01, 0.3), st.booleans()), min_size=1, max_size=60),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_a_fault_begins_after_it_has_lasted_and_ends_after_it_was_gone(steps, after, clear):
    """Against the same thing said in another way: by the whole history of readings."""
    watched = _Watched(Condition(FaultKind.DISK_FULL, lambda r: "full" if r.disk_free < 1.0 else "", after, clear))
    now, history, present = 0.0, [], False
    for step, wrong in steps:
        now += step
        history.append((now, wrong))
        fault = watched.look(replace(GOOD, stamp=now, disk_free=0.0 if wrong else 9.0))
        same = next(
            (t for (t, _), (_, w) in zip(reversed(history), list(reversed(history))[1:], strict=False) if w != wrong),
            history[0][0],
        )
        due = wrong != present and now - same >= (after if wrong else clear)
        assert (fault is not None) == due
        if fault is not None:
            assert fault.over == (not wrong)
            present = wrong


@pytest.mark.parametrize(("stage", "patience"), [(Stage.PREFLIGHT, OVERLOADED_BEFORE), (Stage.FLYING, OVERLOADED)])
def test_before_the_vehicle_is_armed_an_overload_may_last_longer(stage, patience):
    monitor = Monitor(CONFIG, gates=True)
    told = [t for t in np.arange(0.0, 3.0, 0.05) if monitor.look(replace(GOOD, stamp=t, stage=stage, ticks_missed=0.5))]
    assert told == pytest.approx([patience], abs=0.051)


@pytest.mark.parametrize(("speed", "armed", "tipped"), [(0.0, True, True), (2.0, True, False), (2.0, False, True)])
def test_what_is_tilted_and_moves_lies_only_where_its_motors_are_off(speed, armed, tipped):
    monitor, tilted = Monitor(CONFIG, gates=True), replace(GOOD, tilt=math.radians(75.0), speed=speed, armed=armed)
    told = {fault.kind for t in np.arange(0.0, 1.0, 0.05) for fault in monitor.look(replace(tilted, stamp=t))}
    assert (FaultKind.TIPPED_OVER in told) is tipped
