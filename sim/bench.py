"""How fast vehicle and control alone fly, without sensors and tasks."""

import math
from collections.abc import Callable

import numpy as np

from flightapp.config import Config, load_config
from flightapp.control import layout as told
from flightapp.control.flatness import control_memory, flatness_command
from flightapp.control.parameters import parameters_of
from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import Limits, Motion, PlanRequest
from flightapp.jit import kernel
from flightapp.planning.polynomial import PolynomialPlanner
from flightapp.trajectory import Trajectory, evaluate
from sim import layout as at
from sim.dynamics import advance
from sim.plant import Plant
from sim.vehicles import load_vehicle

STEPS = 4
"""Steps of 1 ms between commands."""
LAPS = 5


@kernel
def _fly(
    memory: Vector,
    control: Vector,
    ticks: int,
    throttle: float,
    delay: float,
    knots: Vector,
    coefficients: Vector,
    yaw_knots: Vector,
    yaw_coefficients: Vector,
) -> float:
    """Fly so many ticks along a trajectory that starts at 0; the greatest distance from it, m.

    ``memory`` is the plant's and ``control`` the controller's, with the same trajectory. ``throttle`` is what one m/s²
    of specific force takes, ``delay`` s what a command takes to arrive.
    """
    reference, worst = np.empty(17), 0.0
    for tick in range(ticks):
        now = memory[at.CONSTANTS + at.P_STEP] * memory[at.STEPS]
        control[told.STAMP] = control[told.STATE] = now
        for k in range(13):
            control[told.STATE + 1 + k] = memory[at.POSITION + k]
        evaluate(knots, coefficients, yaw_knots, yaw_coefficients, now, reference)
        error = 0.0
        for k in range(3):
            error += (memory[at.POSITION + k] - reference[k]) ** 2
        worst = max(worst, error)
        thrust = flatness_command(control)
        row = at.QUEUE + tick % at.QUEUE_ROWS * at.QUEUE_COLUMNS
        memory[row] = now + delay
        for k in range(3):
            memory[row + 1 + k] = control[told.RATES + k]
        memory[row + 4] = min(max(throttle * thrust, 0.0), 1.0)
        memory[at.QUEUE_TAIL] = tick + 1.0
        if memory[at.NOISE_ROW] + STEPS > at.NOISE_ROWS:
            memory[at.NOISE_ROW] = 0.0
        advance(memory, 1, STEPS)
    return math.sqrt(worst)


def course(laps: int) -> Trajectory:
    """So many laps of the paper's lemniscate at up to 5 m/s, 50 m up."""
    angle = np.linspace(0.0, 2.0 * math.pi * laps, 20 * laps + 1)[1:]
    points = np.column_stack((5.5 * np.sin(angle), 2.75 * np.sin(2.0 * angle), np.full(angle.size, 50.0)))
    rest = np.zeros(3)
    start = Motion(np.array((0.0, 0.0, 50.0)), rest, rest, rest, 0.0, 0.0)
    request = PlanRequest(0.0, start, (), points[-1], Limits(5.0, 8.0, 3.0))
    return PolynomialPlanner(Config()).through(points[:-1], request)


def laps(config: Config, line: Trajectory) -> float:
    """Fly ``line`` with the racing vehicle in wind and gusts; the greatest distance from it, m."""
    vehicle = load_vehicle("racer")
    plant = Plant(vehicle, 0, wind=1.0, gust=0.5, position=(0.0, 0.0, 50.0))
    plant.command(0.0, (0.0, 0.0, 0.0), vehicle.hover_thrust)
    plant.advance(0.001)
    plant.drop_pending()
    pieces = (line.knots, line.coefficients, line.yaw_knots, line.yaw_coefficients)
    ticks = int(line.duration / (0.001 * STEPS))
    throttle = config.vehicle.hover_thrust / GRAVITY
    control = control_memory(parameters_of(config), line)
    return _fly(plant.memory, control, ticks, throttle, vehicle.delay, *pieces)


def rows() -> list[tuple[str, float, Callable[[], object]]]:
    """Name, simulated seconds and the function that simulates them."""
    config, line = load_config(), course(LAPS)
    return [("sim_vehicle", line.duration, lambda: laps(config, line))]
