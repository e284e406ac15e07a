"""How the model-predictive controller flies."""

import numpy as np
import pytest
from lag_plant import LagPlant, Lags, Noise, at_start, believing, fly, lemniscate, rmse
from planned import REST

from flightapp.control.mpc import MpcController
from flightapp.frames import GRAVITY
from flightapp.trajectory import hover


def race(v_peak, real=None, noise=None, **control):
    trajectory = lemniscate(v_peak)
    controller = MpcController(believing(Lags(), **control))
    rows, references, _ = fly(controller, at_start(real or Lags(), trajectory), trajectory, trajectory.duration, noise)
    assert not controller.fallbacks
    return rmse(rows, references)


@pytest.mark.parametrize(("v_peak", "bound"), [(3.0, 0.001), (7.0, 0.003)])
def test_the_vehicle_it_believes_in_is_tracked_to_millimetres(v_peak, bound):
    assert race(v_peak) < bound


@pytest.mark.parametrize(
    "real", [Lags(thrust_factor=0.9), Lags(gust=0.3), Lags(rate_lag=0.06), Lags(delay=0.03)], ids=str
)
def test_a_vehicle_that_is_not_as_believed_stays_on_the_line(real):
    assert race(6.0, real=real) < 0.06


def test_noise_of_a_tracking_camera_does_not_shake_it():
    assert race(5.0, noise=Noise(0.01, 0.05, 0.01, age=5)) < 0.015


def settle(plant, seconds=4.0, **control):
    controller = MpcController(believing(plant.lags, **control))
    rows, references, commands = fly(controller, plant, hover(0.0, REST, 0.0), seconds)
    return np.linalg.norm(rows[:, 0:3] - references, axis=1), rows, commands


def test_a_jump_of_the_estimate_is_flown_off_without_overshoot():
    error, rows, _ = settle(LagPlant(Lags(), REST + np.array([0.3, 0.0, 0.0])))
    assert error[-250:].max() < 0.01
    assert rows[:, 0].min() > -0.03


def test_wrong_thrust_and_a_steady_push_leave_no_error():
    error, _, commands = settle(LagPlant(Lags(thrust_factor=0.85), REST.copy()), 12.0)
    assert error[-1] < 0.005
    assert commands[-1].thrust == pytest.approx(GRAVITY / 0.85, rel=0.01)
