import math

import numpy as np
import pytest

from flightapp.frames import GRAVITY, quat_from_euler, quat_rotate
from sim import layout as at
from sim.plant import Plant
from sim.vehicles import AIR_DENSITY, FOOT_SAG, load_vehicle

STEP = 0.001


def without_air(name="racer"):
    return load_vehicle(name).model_copy(
        update={"linear_drag": (0.0, 0.0, 0.0), "drag_area": 0.0, "angular_damping": 0.0}
    )


def hovering(vehicle, **kwargs):
    plant = Plant(vehicle, 0, **{"position": (0.0, 0.0, 100.0), **kwargs})
    plant._state[at.ROTORS : at.ROTORS + 4] = math.sqrt(vehicle.mass * GRAVITY / 4.0 / vehicle.thrust_coefficient)
    plant.command(0.0, (0.0, 0.0, 0.0), vehicle.hover_thrust)
    return plant


def rows(plant):
    trace = plant.trace
    return trace[:, 1:4], trace[:, 4:8], trace[:, 8:11], trace[:, 11:14]


def test_tumbling_without_air_or_thrust_conserves_energy_and_angular_momentum():
    vehicle = without_air()
    plant = Plant(vehicle, 0, position=(0.0, 0.0, 500.0))
    plant._state[at.OMEGA : at.OMEGA + 3] = (9.0, -7.0, 4.0)
    plant._state[at.VELOCITY : at.VELOCITY + 3] = (3.0, 2.0, 10.0)
    plant.advance(5.0)
    p, q, v, w = rows(plant)
    inertia = np.array(vehicle.inertia)
    energy = vehicle.mass * (GRAVITY * p[:, 2] + 0.5 * (v**2).sum(1)) + 0.5 * (inertia * w**2).sum(1)
    assert np.ptp(energy) / (0.5 * (inertia * w[0] ** 2).sum()) < 1e-6
    momentum = np.array([quat_rotate(q[i], inertia * w[i]) for i in range(0, len(q), 50)])
    assert np.ptp(momentum, axis=0).max() / np.linalg.norm(momentum[0]) < 1e-6
    assert np.ptp(w[:, 0]) > 5.0


def test_a_symmetric_top_precesses_at_its_rate():
    vehicle = without_air("px4")
    plant = Plant(vehicle, 0, position=(0.0, 0.0, 500.0))
    plant._state[at.OMEGA : at.OMEGA + 3] = (2.0, 0.0, 5.0)
    plant.advance(2.0)
    angle = np.unwrap(np.arctan2(plant.trace[:, 12], plant.trace[:, 11]))
    rate = (angle[-1] - angle[0]) / (plant.trace[-1, 0] - plant.trace[0, 0])
    assert rate == pytest.approx((0.030 - 0.025) / 0.025 * 5.0, rel=1e-6)


def test_free_fall():
    plant = Plant(without_air(), 0, position=(0.0, 0.0, 100.0))
    plant.advance(2.0)
    assert plant.position == pytest.approx([0.0, 0.0, 100.0 - 0.5 * GRAVITY * 4.0], abs=1e-9)
    assert plant.specific_force == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.parametrize("name", ["racer", "f330"])
def test_terminal_velocity(name):
    vehicle = load_vehicle(name)
    plant = Plant(vehicle, 0, position=(0.0, 0.0, 3000.0))
    plant.advance(40.0)
    linear, quadratic = vehicle.linear_drag[2], 0.5 * AIR_DENSITY * vehicle.drag_area
    weight = vehicle.mass * GRAVITY
    expected = (-linear + math.sqrt(linear**2 + 4.0 * quadratic * weight)) / (2.0 * quadratic)
    assert plant.velocity[2] == pytest.approx(-expected, rel=1e-3)


@pytest.mark.parametrize("name", ["px4", "iris", "limits"])
def test_hover_thrust_holds_the_height(name):
    plant = hovering(load_vehicle(name))
    plant.advance(2.0)
    assert plant.specific_force[2] == pytest.approx(GRAVITY, rel=2e-3)
    assert abs(plant.velocity[2]) < 0.02


def test_rotors_follow_with_their_time_constant_to_the_speed_of_full_thrust():
    vehicle = without_air("limits")
    plant = Plant(vehicle, 0, position=(0.0, 0.0, 100.0))
    plant.command(0.0, (0.0, 0.0, 0.0), 1.0)
    full = math.sqrt(vehicle.thrust_max / vehicle.thrust_coefficient)
    left = []
    for until in (0.02, 0.05):
        plant.advance(until)
        left.append(full - plant.rotor_speeds[0])
    assert 0.03 / math.log(left[0] / left[1]) == pytest.approx(vehicle.motor_up, rel=1e-6)
    plant.advance(1.0)
    assert plant.specific_force[2] == pytest.approx(2.8 * GRAVITY, rel=1e-3)


def test_it_rests_on_the_ground():
    plant = Plant(load_vehicle("racer"), 0)
    plant.advance(3.0)
    assert plant.on_ground
    assert plant.position == pytest.approx([0.0, 0.0, -FOOT_SAG], abs=1e-6)
    assert plant.specific_force == pytest.approx([0.0, 0.0, GRAVITY], abs=1e-3)


def test_it_settles_level_when_dropped_askew():
    plant = Plant(load_vehicle("f330"), 0, position=(0.0, 0.0, 0.4))
    plant._state[at.ORIENTATION : at.ORIENTATION + 4] = quat_from_euler(0.3, -0.2, 0.5)
    plant.advance(3.0)
    up = quat_rotate(plant.orientation, np.array([0.0, 0.0, 1.0]))
    assert up[2] > 0.99999
    assert plant.position[2] == pytest.approx(-FOOT_SAG, abs=1e-4)
    assert np.linalg.norm(plant.velocity) < 1e-3


def test_friction_stops_it_on_the_ground():
    plant = Plant(load_vehicle("px4"), 0)
    plant._state[at.VELOCITY] = 1.0
    plant.advance(2.0)
    assert plant.position[0] == pytest.approx(1.0 / (2.0 * 0.7 * GRAVITY), rel=0.25)


def test_it_takes_off():
    vehicle = load_vehicle("limits")
    plant = Plant(vehicle, 0)
    plant.command(0.5, (0.0, 0.0, 0.0), 1.3 * vehicle.hover_thrust)
    plant.advance(0.5)
    assert plant.on_ground
    plant.advance(1.5)
    assert not plant.on_ground
    assert 0.8 < plant.position[2] < 0.5 * 0.3 * GRAVITY


def test_the_battery_sags_under_load_and_empties():
    vehicle = load_vehicle("racer")
    plant = hovering(vehicle)
    assert plant.voltage == pytest.approx(16.8)
    plant.advance(0.5)
    loaded, speed = plant.voltage, plant.rotor_speeds[0]
    assert 0.1 < 16.8 - loaded < 1.0
    plant.advance(120.0)
    assert plant.charge < 0.9
    assert plant.voltage < loaded
    assert plant.rotor_speeds[0] / speed == pytest.approx(plant.voltage / loaded, rel=1e-3)


def test_capacity_is_the_charge_that_flows():
    vehicle = load_vehicle("racer")
    plant = Plant(vehicle, 0)
    plant.advance(60.0)
    current = vehicle.battery.avionics / plant.voltage
    assert 1.0 - plant.charge == pytest.approx(60.0 * current / (3600.0 * vehicle.battery.capacity), rel=2e-3)


def fly(pieces, seed=3):
    plant = Plant(load_vehicle("racer"), seed, wind=3.0, gust=1.0, position=(0.0, 0.0, 30.0))
    for k in range(40):
        plant.command(0.05 * k, (0.5 * math.sin(k), 0.3, 0.1), 0.25)
    for until in pieces:
        plant.advance(until)
    return plant


def test_how_time_is_cut_does_not_matter():
    whole = fly([6.0])
    cut = fly([*np.arange(0.0041, 6.0, 0.0041), 6.0])
    assert np.array_equal(whole.trace[-1], cut.state_at(6.0))


def test_seeds_repeat_and_differ():
    assert np.array_equal(fly([2.0]).position, fly([2.0]).position)
    assert not np.array_equal(fly([2.0]).position, fly([2.0], seed=4).position)


def test_trace_rows_are_the_steps_made():
    plant = Plant(load_vehicle("racer"), 0, position=(0.0, 0.0, 50.0), start=2.0)
    assert len(plant.trace) == 0
    plant.advance(2.0105)
    assert plant.trace[:, 0] == pytest.approx(2.0 + STEP * np.arange(1, 11))
    plant.advance(2.012, extend=True)
    assert plant.trace[:, 0] == pytest.approx(2.0 + STEP * np.arange(1, 13))
    plant.advance(2.012)
    assert len(plant.trace) == 0
    plant.advance(9.0)
    assert len(plant.trace) == 6988
    assert plant.trace[-1, 1:4] == pytest.approx(plant.position)


def test_the_recent_past_can_be_looked_up():
    plant = Plant(load_vehicle("racer"), 0, position=(0.0, 0.0, 200.0))
    assert plant.state_at(0.0)[3] == 200.0
    for until in np.arange(0.004, 5.0, 0.004):
        plant.advance(until)
    row = plant.state_at(plant.time - 1.0005)
    assert row[0] == pytest.approx(plant.time - 1.0005)
    before, after = plant.state_at(row[0] - 0.0005), plant.state_at(row[0] + 0.0005)
    assert row[3] == pytest.approx(0.5 * (before[3] + after[3]))
    assert np.linalg.norm(row[4:8]) == pytest.approx(1.0)
    for outside in (0.5, plant.time + 0.01):
        with pytest.raises(ValueError, match="no state is kept"):
            plant.state_at(outside)


def test_commands_take_effect_in_time_and_stopping_forgets_them():
    plant = hovering(load_vehicle("px4"))
    plant.command(0.1, (1.0, 0.0, 0.0), 0.5)
    plant.command(0.2, (-1.0, 0.0, 0.0), 0.5)
    plant.advance(0.1)
    assert plant.angular_velocity[0] == pytest.approx(0.0, abs=1e-9)
    plant.advance(0.2)
    assert plant.angular_velocity[0] > 0.3
    plant.advance(0.5)
    assert plant.angular_velocity[0] < -0.3
    plant.command(0.6, (0.0, 0.0, 0.0), 1.0)
    plant.stop_motors()
    plant.advance(1.5)
    assert np.all(plant.rotor_speeds == 0.0)


def test_bench_vehicle(benchmark):
    vehicle = load_vehicle("racer")
    plant = hovering(vehicle, position=(0.0, 0.0, 1000.0))
    rates = (0.1, 0.0, 0.0)

    def one_second():
        for _ in range(250):
            now = plant.time
            plant.command(now + 0.003, rates, 0.25)
            plant.advance(now + 0.004)

    benchmark(one_second)
