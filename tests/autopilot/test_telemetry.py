import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.modes import LAND, LOITER, OFFBOARD, TAKEOFF, flight_mode
from flightapp.autopilot.telemetry import StatusBoard, identity, number, odometry
from flightapp.frames import quat_from_euler
from flightapp.messages import FlightMode

STILL = {"x": 1.0, "y": 2.0, "z": -3.0, "vx": 0.5, "vy": -0.5, "vz": 0.25, "q": [1.0, 0.0, 0.0, 0.0]}
STILL |= {"rollspeed": 0.1, "pitchspeed": 0.2, "yawspeed": 0.3, "frame_id": 1, "child_frame_id": 1, "quality": 0}


def custom(main, sub=0):
    return main << 16 | sub << 24


@pytest.mark.parametrize(
    ("wire", "mode"),
    [
        (TAKEOFF, "takeoff"),
        (LOITER, "hold"),
        (LAND, "land"),
        (OFFBOARD, "offboard"),
        ((3, 0), "position"),
        ((1, 0), "manual"),
    ],
)
def test_modes_from_the_wire(wire, mode):
    assert flight_mode(custom(*wire)) is FlightMode(mode)


@given(st.integers(0, 2**32 - 1))
def test_every_custom_mode_is_some_mode(wire):
    assert isinstance(flight_mode(wire), FlightMode)


def test_nothing_is_said_before_the_first_heartbeat():
    board = StatusBoard()
    assert board.current_mode(1.5, {"custom_mode": custom(6)}) is None
    assert board.local_position(0.9) is None
    status = board.heartbeat(1.0, {"custom_mode": custom(4, 2), "base_mode": 129})
    assert (status.stamp, status.mode, status.armed, status.ready) == (1.0, FlightMode.TAKEOFF, True, False)


def test_a_mode_change_is_told_at_once_but_makes_the_status_no_younger():
    board = StatusBoard()
    board.heartbeat(1.0, {"custom_mode": custom(6), "base_mode": 129})
    status = board.current_mode(1.5, {"custom_mode": custom(3)})
    assert (status.stamp, status.mode) == (1.0, FlightMode.POSITION)
    assert board.current_mode(1.5, {"custom_mode": custom(3)}) is None


def test_a_mode_that_a_newer_heartbeat_overtook_says_nothing():
    board = StatusBoard()
    board.heartbeat(1.0, {"custom_mode": custom(3), "base_mode": 129})
    assert board.current_mode(0.99, {"custom_mode": custom(6)}) is None
    assert board.heard(2.0).mode is FlightMode.POSITION


def test_a_local_position_counts_once_it_lasted_and_while_it_is_told():
    board = StatusBoard()
    assert not board.heartbeat(1.0, {"custom_mode": 0, "base_mode": 1}).ready
    for tenth in range(11, 23):
        assert board.local_position(0.1 * tenth) is None
    assert board.local_position(2.4).ready
    assert board.heard(3.3).ready
    assert not board.heard(3.5).ready
    assert not board.heartbeat(4.0, {"custom_mode": 0, "base_mode": 1}).ready
    assert board.local_position(4.1) is None


def test_any_message_keeps_the_status_young():
    board = StatusBoard()
    assert board.heard(1.0) is None
    board.heartbeat(1.0, {"custom_mode": custom(6), "base_mode": 129})
    assert board.heard(1.05) is None
    status = board.heard(1.2)
    assert (status.stamp, status.mode, status.armed) == (1.2, FlightMode.OFFBOARD, True)


def test_battery():
    board = StatusBoard()
    board.heartbeat(1.0, {"custom_mode": 0, "base_mode": 1})
    status = board.battery({"voltages": [4100, 4000, 65535, 0], "battery_remaining": 73})
    assert (status.voltage, status.battery) == (pytest.approx(8.1), pytest.approx(0.73))
    status = board.battery({"voltages": [65535] * 10, "battery_remaining": -1})
    assert math.isnan(status.voltage)
    assert math.isnan(status.battery)


def test_odometry_in_ned_becomes_flu():
    sample = odometry(7.0, STILL)
    assert sample.stamp == 7.0
    np.testing.assert_allclose(sample.position, (1.0, -2.0, 3.0))
    np.testing.assert_allclose(sample.velocity, (0.5, 0.5, -0.25))
    np.testing.assert_allclose(sample.angular_velocity, (0.1, -0.2, -0.3))


def test_resets_of_the_autopilots_estimate_are_epochs():
    assert odometry(7.0, STILL).epoch == 0
    assert odometry(7.0, STILL | {"reset_counter": 4}).epoch == 4
    assert odometry(7.0, STILL | {"reset_counter": None}).epoch == 0


def test_odometry_with_body_velocity_is_turned():
    w, x, y, z = quat_from_euler(0.0, 0.0, 0.5 * math.pi)  # facing left: west in NED
    sample = odometry(7.0, STILL | {"q": [w, x, -y, -z], "child_frame_id": 12, "vx": 1.0, "vy": 0.0, "vz": 0.0})
    np.testing.assert_allclose(sample.velocity, (0.0, 1.0, 0.0), atol=1e-12)


@pytest.mark.parametrize("field", ["x", "vz", "rollspeed", "q"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, None, "x"])
def test_odometry_that_is_not_finite_is_refused(field, bad):
    assert odometry(7.0, STILL | {field: [1.0, bad, 0.0, 0.0] if field == "q" else bad}) is None


def test_odometry_in_an_unknown_frame_is_refused():
    assert odometry(7.0, STILL | {"frame_id": 4}) is None


def test_numbers_of_json():
    assert number(json.loads("1")) == 1.0
    assert math.isnan(number(json.loads("NaN")))
    assert math.isnan(number(json.loads("null")))


def test_identity():
    fields = {"flight_sw_version": 1 << 24 | 16 << 16 | 1 << 8 | 255, "uid": 255}
    fields["flight_custom_version"] = [1, 2, 3, 4, 5, 6, 7, 0xAB]
    told = identity(3, fields)
    assert (told.system_id, told.version, told.git, told.uid) == (3, "1.16.1", "ab07060504030201", "ff")
    assert identity(3, {"flight_sw_version": 0}).version == ""
