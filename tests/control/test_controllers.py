"""What every controller must do, and how the default one flies the simulated vehicles."""

from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from lag_plant import LagPlant, Lags, fly, lemniscate, rmse

from flightapp.config import Config, load_config
from flightapp.control.errors import ControllerError
from flightapp.control.flatness import FlatnessController
from flightapp.evaluation.control_trials import Mismatch
from flightapp.frames import GRAVITY
from flightapp.messages import VehicleState
from flightapp.trajectory import hover
from sim.plant import Plant
from sim.trials import fly as fly_vehicle
from sim.vehicles import load_vehicle

CONFIGS = Path(__file__).parents[2] / "config"
CONTROLLERS = {point.name: point for point in entry_points(group="flightapp.controllers")}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_holds_a_hover_and_is_repeatable(name):
    config, line = Config(), hover(0.0, np.array([0.0, 0.0, 1.5]), 0.0)
    vehicle = config.vehicle
    lags = Lags(vehicle.rate_lag, vehicle.motor_lag, vehicle.delay, vehicle.drag)
    controller, ends = CONTROLLERS[name].load()(config), []
    for _ in range(2):
        rows, references, commands = fly(controller, LagPlant(lags, np.array([0.1, 0.0, 1.4])), line, 3.0)
        assert rmse(rows[-100:], references[-100:]) < 0.01
        assert all(np.isfinite(command.rates).all() and np.isfinite(command.thrust) for command in commands)
        assert isinstance(controller.report, str)
        ends.append(rows[-1])
        controller.reset()
    assert np.array_equal(ends[0], ends[1])


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_follows_the_lemniscate_on_the_simulated_vehicle(name):
    config, line = Config(), lemniscate(3.0)
    flown = fly_vehicle(config, CONTROLLERS[name].load()(config), line, Mismatch())
    assert not flown.crashed
    assert flown.contour < 0.2
    # By time as well, so that nobody takes it for lost.
    assert flown.worst < 0.5 * config.safety.tracking_error


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("part", ["position", "orientation", "velocity", "angular_velocity"])
def test_no_controller_makes_a_command_of_a_state_that_is_not_finite_and_each_flies_on_after_it(name, part):
    controller, line = CONTROLLERS[name].load()(Config()), hover(0.0, np.array([0.0, 0.0, 1.5]), 0.0)
    upright, rest = np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3)
    good = VehicleState(0.0, line.setpoint(0.0).position, upright, rest, rest, np.zeros((9, 9)))
    with pytest.raises(ControllerError):
        controller.command(0.0, replace(good, **{part: getattr(good, part) * np.nan}), line)
    command = controller.command(0.004, replace(good, stamp=0.004), line)
    assert command.rates == pytest.approx(np.zeros(3), abs=1e-6)
    assert command.thrust == pytest.approx(GRAVITY, abs=0.05)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_no_controller_bridges_a_state_that_is_stale(name):
    config, line = Config(), hover(0.0, np.zeros(3), 0.0)
    upright, rest = np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3)
    old = VehicleState(0.0, rest, upright, rest, rest, np.zeros((9, 9)))
    with pytest.raises(ControllerError):
        CONTROLLERS[name].load()(config).command(config.safety.state_timeout + 0.01, old, line)


def test_the_default_vehicle_is_the_racer():
    assert load_config(CONFIGS / "sim_racer.toml") == Config()


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("sim_*.toml")), ids=lambda path: path.stem)
def test_the_simulated_vehicles_hover_at_the_thrust_that_their_files_say(path):
    config = load_config(path)
    plant = Plant(load_vehicle(config.sim.vehicle), 1, position=(0.0, 0.0, 50.0))
    plant.command(0.0, np.zeros(3), config.vehicle.hover_thrust)
    plant.advance(0.5)
    assert np.linalg.norm(plant.specific_force - [0.0, 0.0, GRAVITY]) < 0.06 * GRAVITY


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("sim_*.toml")), ids=lambda path: path.stem)
def test_the_simulated_vehicles_fly_the_lemniscate_within_centimetres(path):
    config, line = load_config(path), lemniscate(5.0)
    flown = fly_vehicle(config, FlatnessController(config), line, Mismatch())
    assert not flown.crashed
    assert flown.rmse < 0.02
