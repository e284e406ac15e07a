import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as dialect

from flightapp.frames import quat_from_euler
from sim.mavlink.codec import Decoder, named, pack
from sim.mavlink.setpoints import Setpoints

RATES_ONLY, ATTITUDE_ONLY = 128, 7


class FakePx4:
    """Takes setpoints down."""

    def __init__(self, **parameters):
        self.parameters = parameters
        self.targets = []
        self.attitudes = []

    def estimate(self):
        return self

    angular_velocity = np.array((0.1, 0.2, 0.3))

    def attitude_target(self, rates, throttle):
        self.targets.append((tuple(rates), throttle))

    def attitude_setpoint(self, orientation, throttle):
        self.attitudes.append((orientation, throttle))


def take(px4, *, mask=RATES_ONLY, rates=(0.0, 0.0, 0.0), thrust=0.5, q=(1.0, 0.0, 0.0, 0.0), target=(1, 1), more=b""):
    layout = named("SET_ATTITUDE_TARGET").layout
    payload = layout.pack(0, *q, *rates, thrust, *target, mask) + more
    (frame,) = Decoder().frames(pack(named("SET_ATTITUDE_TARGET"), payload, 0, 1, 191))
    return Setpoints(px4, 1, 1).take(frame)


@given(st.tuples(*[st.floats(-20.0, 20.0, width=32)] * 3), st.floats(0.0, 1.0, width=32))
def test_body_rates_are_frd_on_the_link(rates, thrust):
    px4 = FakePx4()
    take(px4, rates=rates, thrust=thrust)
    assert px4.targets == [((rates[0], -rates[1], -rates[2]), thrust)]
    assert px4.attitudes == []


@pytest.mark.parametrize("target", [(1, 1), (0, 1), (1, 0), (0, 0)])
def test_setpoints_for_this_vehicle_or_for_all(target):
    px4 = FakePx4()
    assert take(px4, target=target) is not None
    assert len(px4.targets) == 1


@pytest.mark.parametrize("target", [(2, 1), (1, 2), (255, 0)])
def test_setpoints_for_others_are_ignored(target):
    px4 = FakePx4()
    assert take(px4, target=target) is None
    assert px4.targets == []


@pytest.mark.parametrize("thrust, throttle", [(1.7, 1.0), (-0.3, 0.0), (math.nan, 0.0), (math.inf, 1.0)])
def test_thrust_is_what_motors_can_do(thrust, throttle):
    px4 = FakePx4()
    take(px4, thrust=thrust)
    assert px4.targets[0][1] == throttle


def test_rates_that_are_no_numbers_keep_those_that_are_flown():
    px4 = FakePx4()
    take(px4, rates=(math.nan, 1.0, math.inf))
    assert px4.targets[0][0] == pytest.approx((0.1, -1.0, 0.3))
    take(px4, mask=RATES_ONLY | 4, rates=(1.0, 1.0, 5.0))
    assert px4.targets[1][0] == pytest.approx((1.0, -1.0, 0.3))


@pytest.mark.parametrize("mask", [RATES_ONLY | 1, RATES_ONLY | 2, RATES_ONLY | ATTITUDE_ONLY])
def test_neither_attitude_nor_rates_is_no_setpoint(mask):
    px4 = FakePx4()
    assert take(px4, mask=mask) is None
    assert px4.targets == []


def test_throttle_ignored_is_no_thrust():
    px4 = FakePx4()
    take(px4, mask=RATES_ONLY | 64)
    assert px4.targets[0][1] == 0.0


def test_an_attitude_is_frd_to_ned_and_made_unit():
    px4 = FakePx4()
    w, x, y, z = 2.0 * quat_from_euler(0.3, -0.2, 0.1)
    take(px4, mask=ATTITUDE_ONLY, q=(w, x, -y, -z))
    orientation, throttle = px4.attitudes[0]
    assert orientation == pytest.approx(quat_from_euler(0.3, -0.2, 0.1), abs=1e-6)
    assert throttle == 0.5


def test_thrust_along_the_body_axes_is_taken_with_an_attitude():
    px4 = FakePx4()
    take(px4, mask=ATTITUDE_ONLY | 32, more=np.array((0.0, 0.0, -0.7), "<f4").tobytes())
    assert px4.attitudes[0][1] == pytest.approx(0.7)
    take(px4, mask=ATTITUDE_ONLY | 32)
    assert px4.attitudes[1][1] == 0.0


def test_px4_can_be_told_not_to_listen():
    px4 = FakePx4(MAV_FWDEXTSP=0)
    assert take(px4) is None
    assert px4.targets == []


def test_the_fields_stand_where_pymavlink_has_them():
    px4 = FakePx4()
    message = dialect.MAVLink_set_attitude_target_message(1, 1, 1, 128, [1, 0, 0, 0], 0.5, 0.25, 0.125, 0.75)
    (frame,) = Decoder().frames(message.pack(dialect.MAVLink(None, 1, 191)))
    Setpoints(px4, 1, 1).take(frame)
    assert px4.targets == [((0.5, -0.25, -0.125), 0.75)]
