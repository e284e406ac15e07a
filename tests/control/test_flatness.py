import numpy as np
import pytest
from lag_plant import LagPlant, Lags, Noise, at_start, believing, fly, lemniscate, rmse

from flightapp.control.flatness import FlatnessController
from flightapp.control.mpc import MpcController
from flightapp.frames import quat_from_euler, quat_to_matrix, quat_yaw
from flightapp.messages import VehicleState
from flightapp.trajectory import hover

REST = np.array([0.0, 0.0, 1.5])


def race(v_peak, real=None, believed=None, noise=None, **control):
    trajectory = lemniscate(v_peak)
    controller = FlatnessController(believing(believed or Lags(), **control))
    rows, references, _ = fly(controller, at_start(real or Lags(), trajectory), trajectory, trajectory.duration, noise)
    return rmse(rows, references)


def settle(plant, seconds=4.0, noise=None, by=FlatnessController, **control):
    controller = by(believing(plant.lags, **control))
    rows, references, commands = fly(controller, plant, hover(0.0, REST, 0.0), seconds, noise)
    return np.linalg.norm(rows[:, 0:3] - references, axis=1), rows, commands


@pytest.mark.parametrize(("v_peak", "bound"), [(3.0, 0.001), (5.0, 0.002), (7.0, 0.003)])
def test_the_vehicle_it_believes_in_is_tracked_to_millimetres(v_peak, bound):
    assert race(v_peak) < bound


def test_an_old_state_is_predicted_forward():
    assert race(5.0, noise=Noise(age=20)) < 0.003


@pytest.mark.parametrize(
    "forgotten", [{"drag": (0.0, 0.0, 0.0)}, {"delay": 0.0}, {"rate_lag": 0.0, "motor_lag": 0.0}], ids=str
)
def test_each_part_of_the_model_earns_its_place(forgotten):
    assert race(7.0, believed=Lags(**forgotten), without=("disturbance",)) > 2.0 * race(7.0, without=("disturbance",))


@pytest.mark.parametrize(
    "real",
    [
        Lags(thrust_factor=1.1),
        Lags(thrust_factor=0.9),
        Lags(gust=0.3),
        Lags(rate_lag=0.06),
        Lags(delay=0.03),
        Lags(motor_lag=0.07),
    ],
    ids=str,
)
def test_a_vehicle_that_is_not_as_believed_stays_on_the_line(real):
    assert race(6.0, real=real) < 0.06


def test_noise_of_a_tracking_camera_does_not_shake_it():
    assert race(5.0, noise=Noise(0.01, 0.05, 0.01, age=5)) < 0.01


@pytest.mark.parametrize("by", [FlatnessController, MpcController])
@pytest.mark.parametrize("roll", [0.5 * np.pi, np.pi], ids=["on its side", "upside down"])
def test_it_recovers_from_a_tumble(roll, by):
    plant = LagPlant(Lags(), REST + np.array([0.0, 0.0, 5.0]), quat_from_euler(roll, 0.0, 0.0))
    error, rows, _ = settle(plant, 8.0, by=by)
    assert error[-1] < 0.05
    assert rows[:, 2].min() > 1.0


def test_a_jump_of_the_estimate_is_flown_off_without_overshoot():
    error, rows, commands = settle(LagPlant(Lags(), REST + np.array([0.3, 0.0, 0.0])))
    assert error[-250:].max() < 0.01
    assert rows[:, 0].min() > -0.03
    assert max(np.abs(command.rates).max() for command in commands) < 6.0


@pytest.mark.parametrize("by", [FlatnessController, MpcController])
def test_a_far_setpoint_is_approached_at_bounded_speed(by):
    _, rows, _ = settle(LagPlant(Lags(), REST + np.array([20.0, 0.0, 0.0])), by=by)
    assert 1.5 < np.linalg.norm(rows[:, 7:10], axis=1).max() < 3.0


@pytest.mark.parametrize("by", [FlatnessController, MpcController])
@pytest.mark.parametrize("tilt_max", [30.0, 65.0])
def test_it_brakes_hard_but_not_beyond_the_tilt_limit(tilt_max, by):
    plant = LagPlant(Lags(), REST.copy(), velocity=np.array([15.0, 0.0, 0.0]))
    _, rows, _ = settle(plant, 4.0, by=by, tilt_max_deg=tilt_max)
    tilts = np.degrees(np.arccos([quat_to_matrix(row[3:7])[2, 2] for row in rows]))
    assert 0.85 * tilt_max < tilts.max() < tilt_max + 2.0
    assert np.abs(rows[:, 2] - REST[2]).max() < 0.3


def test_the_heading_turns_the_short_way_and_does_not_bend_the_path():
    plant = LagPlant(Lags(), REST.copy(), quat_from_euler(0.0, 0.0, -3.0))
    controller = FlatnessController(believing(Lags()))
    rows, references, _ = fly(controller, plant, hover(0.0, REST, 3.0), 4.0)
    headings = np.unwrap([quat_yaw(row[3:7]) for row in rows])
    assert headings[-1] == pytest.approx(3.0 - 2.0 * np.pi, abs=0.02)
    assert rmse(rows, references) < 0.005


def test_wrong_thrust_is_learnt_in_flight_and_forgotten_at_reset():
    plant = LagPlant(Lags(thrust_factor=0.85), REST.copy())
    controller = FlatnessController(believing(Lags()))
    rows, _, commands = fly(controller, plant, hover(0.0, REST, 0.0), 12.0)
    assert np.linalg.norm(rows[-1, 0:3] - REST) < 0.005
    assert commands[-1].thrust == pytest.approx(9.80665 / 0.85, rel=0.01)
    controller.reset()
    fresh = fly(controller, LagPlant(Lags(), REST.copy()), hover(0.0, REST, 0.0), 0.004)[2]
    assert fresh[0].thrust == pytest.approx(9.80665, abs=1e-6)


@pytest.mark.parametrize(("height", "learns"), [(0.0, False), (1.0, True)])
def test_nothing_is_learnt_on_the_ground(height, learns):
    controller = FlatnessController(believing(Lags()))
    place, rest = np.array([0.0, 0.0, height]), np.zeros(3)
    thrusts = []
    for tick in range(500):
        stamp = tick / 250.0
        state = VehicleState(stamp, place, np.array([1.0, 0.0, 0.0, 0.0]), rest, rest, np.zeros((9, 9)))
        thrusts.append(controller.command(stamp, state, hover(0.0, place + np.array([0.0, 0.0, 0.05]), 0.0)).thrust)
    assert (thrusts[-1] - thrusts[100] > 0.2) is learns


def test_the_same_flight_gives_the_same_commands():
    one, other = (settle(LagPlant(Lags(gust=0.5), REST.copy()), 0.5)[2] for _ in range(2))
    assert all(np.array_equal(a.rates, b.rates) and a.thrust == b.thrust for a, b in zip(one, other, strict=True))
