"""The simulated vehicle and a controller alone, with perfect states: no sensors, no tasks."""

from dataclasses import replace

import numpy as np

from flightapp.config import Config
from flightapp.evaluation.control_trials import Mismatch, Trial, trial
from flightapp.frames import GRAVITY
from flightapp.interfaces import Controller
from flightapp.messages import VehicleState
from flightapp.trajectory import Trajectory
from sim.plant import Plant
from sim.vehicles import VehicleParameters, load_vehicle

AGE = 0.01
"""s from a state's capture until it is used."""
SETTLING = 3.0
"""s of hover before the line begins."""
LOST = 3.0
"""m off the line."""


def perturbed(vehicle: VehicleParameters, mismatch: Mismatch) -> VehicleParameters:
    """``vehicle`` as ``mismatch`` has it, but for its delay."""
    drag, mass = mismatch.drag, mismatch.mass
    return vehicle.model_copy(
        update={
            "mass": mass * vehicle.mass,
            "inertia": tuple(mass * moment for moment in vehicle.inertia),
            "thrust_max": mismatch.thrust * vehicle.thrust_max,
            "linear_drag": tuple(drag * d for d in vehicle.linear_drag),
            "drag_area": drag * vehicle.drag_area,
            "motor_up": mismatch.motor * vehicle.motor_up,
            "motor_down": mismatch.motor * vehicle.motor_down,
        }
    )


def fly(config: Config, controller: Controller, line: Trajectory, mismatch: Mismatch) -> Trial:
    """Hover where ``line`` begins, then fly it; judged by the truth, from its start to its end.

    The controller sees the true state of `AGE` before. What the delay cannot be shortened by, the state is newer.
    """
    vehicle = load_vehicle(config.sim.vehicle)
    delay = vehicle.delay + mismatch.delay
    age, delay = AGE + min(delay, 0.0), max(delay, 0.0)
    line, end = replace(line, stamp=SETTLING), SETTLING + line.duration
    first = line.setpoint(0.0)
    plant = Plant(
        perturbed(vehicle, mismatch), mismatch.seed, config.sim.step, mismatch.wind, mismatch.gust,
        first.position, first.yaw,
    )  # fmt: skip
    plant.command(0.0, (0.0, 0.0, 0.0), config.vehicle.hover_thrust)
    controller.reset()
    scale, unknown = config.vehicle.hover_thrust / GRAVITY, np.zeros((9, 9))
    errors = []
    for tick in range(1, int(end * config.control.rate) + 1):
        stamp = tick / config.control.rate
        plant.advance(stamp)
        off = plant.position - line.setpoint(stamp).position
        crashed = plant.on_ground or bool(off @ off > LOST * LOST)
        if stamp >= SETTLING or crashed:
            errors.append(off)
        if crashed:
            break
        x = plant.state_at(max(stamp - age, 0.0))
        state = VehicleState(max(stamp - AGE, 0.0), x[1:4], x[4:8], x[8:11], x[11:14], unknown)
        command = controller.command(stamp, state, line)
        plant.command(stamp + delay, command.rates, scale * command.thrust)
    return trial(np.array(errors), crashed)
