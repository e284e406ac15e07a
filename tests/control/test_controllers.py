"""What every controller must do, and how the default one flies the simulated vehicles."""

from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from lag_plant import LagPlant, Lags, fly, lemniscate, rmse

from flightapp.config import Config, load_config
from flightapp.control.flatness import FlatnessController
from flightapp.frames import GRAVITY
from flightapp.messages import VehicleState
from flightapp.trajectory import hover
from sim.plant import Plant
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
        ends.append(rows[-1])
        controller.reset()
    assert np.array_equal(ends[0], ends[1])


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
    parameters = load_vehicle(config.sim.vehicle)
    controller, start = FlatnessController(config), line.setpoint(0.0)
    plant = Plant(parameters, 1, position=start.position, yaw=start.yaw)
    scale = config.vehicle.hover_thrust / GRAVITY
    plant.command(0.0, np.zeros(3), config.vehicle.hover_thrust)
    errors = []
    for tick in range(round(250.0 * line.duration)):
        stamp = tick / 250.0
        plant.advance(stamp)
        x = plant.state_at(max(stamp - 0.003, 0.0))
        state = VehicleState(x[0], x[1:4], x[4:8], x[8:11], x[11:14], np.zeros((9, 9)))
        command = controller.command(stamp, state, line)
        plant.command(stamp + parameters.delay, command.rates, command.thrust * scale)
        errors.append(plant.position - line.setpoint(stamp).position)
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=1))) < 0.03
