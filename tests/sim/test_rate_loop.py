import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.frames import GRAVITY
from sim import layout as at
from sim.plant import Plant
from sim.rate_loop import PITCH_SIGNS, ROLL_SIGNS, YAW_SIGNS, allocate
from sim.vehicles import load_vehicle

MIX = math.sqrt(0.5)


def step_response(vehicle):
    """Seconds from sending a roll rate of 150 °/s in hover to 10, 63 and 90 % of it; and the share of it over time."""
    rate = math.radians(150.0)
    plant = Plant(vehicle, 0, position=(0.0, 0.0, 50.0))
    plant._state[at.ROTORS : at.ROTORS + 4] = math.sqrt(vehicle.mass * GRAVITY / 4.0 / vehicle.thrust_coefficient)
    plant.command(0.0, (0.0, 0.0, 0.0), vehicle.hover_thrust)
    plant.advance(1.0)
    plant.command(1.0 + vehicle.delay, (rate, 0.0, 0.0), vehicle.hover_thrust)
    plant.advance(1.8)
    reached = plant.trace[:, 11] / rate
    times = [plant.trace[np.argmax(reached >= share), 0] - 1.0 for share in (0.1, 0.63, 0.9)]
    return np.array(times), reached


def test_the_response_is_near_that_measured_on_px4():
    times, reached = step_response(load_vehicle("px4"))
    assert np.all(np.abs(times - [0.030, 0.093, 0.137]) <= [0.001, 0.003, 0.005])
    assert reached.max() < 1.12
    assert reached[-1] == pytest.approx(1.0, abs=0.05)


def test_twice_the_thrust_quickens_it_as_measured():
    strong = load_vehicle("px4").model_copy(update={"thrust_max": GRAVITY})
    times, _ = step_response(strong)
    assert np.all(np.abs(times - [0.018, 0.051, 0.075]) <= [0.003, 0.007, 0.006])


def test_the_racer_responds_like_px4_at_four_times_its_weight():
    times, reached = step_response(load_vehicle("racer"))
    assert np.all(np.abs(times - [0.018, 0.051, 0.075]) <= 0.002)
    assert reached.max() < 1.15


@pytest.mark.parametrize("name", ["iris", "f330", "limits"])
def test_all_vehicles_settle_on_the_rate(name):
    times, reached = step_response(load_vehicle(name))
    assert times[1] < 0.12
    assert reached.max() < 1.2
    assert reached[-1] == pytest.approx(1.0, abs=0.08)


def mixed(roll, pitch, yaw, thrust):
    S, P = np.zeros(at.STATE_SIZE), np.zeros(at.CONSTANTS_SIZE)
    S[at.TORQUE : at.TORQUE + 3], S[at.THRUST] = (roll, pitch, yaw), thrust
    P[at.P_MIX_ROLL] = P[at.P_MIX_PITCH] = MIX
    allocate(S, P)
    return S[at.SIGNALS : at.SIGNALS + 4]


def torques(u):
    return np.array([np.dot(ROLL_SIGNS, u) / MIX, np.dot(PITCH_SIGNS, u) / MIX, np.dot(YAW_SIGNS, u)]) / 4.0


torque = st.floats(-1.5, 1.5)


@given(torque, torque, torque, st.floats(0.0, 1.0))
def test_allocation_stays_in_range_and_never_raises_thrust(roll, pitch, yaw, thrust):
    u = mixed(roll, pitch, yaw, thrust)
    assert np.all((u >= 0.0) & (u <= 1.0))
    if roll == pitch == yaw == 0.0:
        assert u == pytest.approx(np.full(4, thrust))


@given(*[st.floats(-0.1, 0.1)] * 3, st.floats(0.3, 0.7))
def test_allocation_is_exact_where_there_is_room(roll, pitch, yaw, thrust):
    u = mixed(roll, pitch, yaw, thrust)
    assert np.mean(u) == pytest.approx(thrust)
    assert torques(u) == pytest.approx([roll, pitch, yaw], abs=1e-12)


def test_at_full_thrust_roll_lowers_the_thrust():
    u = mixed(0.4, 0.0, 0.0, 1.0)
    assert torques(u)[0] == pytest.approx(0.4)
    assert np.mean(u) == pytest.approx(1.0 - 0.4 * MIX)


def test_at_no_thrust_roll_is_given_up_without_raising_it():
    assert np.mean(mixed(0.4, 0.0, 0.0, 0.05)) == pytest.approx(0.05)
    assert abs(torques(mixed(0.4, 0.0, 0.0, 0.05))[0]) < 0.4


def test_yaw_gives_way_to_roll():
    roll, _, yaw = torques(mixed(0.4, 0.0, 0.9, 0.5))
    assert roll == pytest.approx(0.4, rel=0.05)
    assert 0.0 < yaw < 0.5
