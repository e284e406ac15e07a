"""How long a command takes: compiled code alone, from Python, and the guard."""

import math

import numpy as np
from lag_plant import lemniscate

from flightapp.autopilot.guard import CommandGuard
from flightapp.config import Config
from flightapp.control.flatness import FlatnessController, flatness_command
from flightapp.control.parameters import parameters_of
from flightapp.control.prediction import ENTRY, HISTORY
from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.messages import AutopilotStatus, FlightMode, VehicleState

LINE = lemniscate(5.0)
TICKS = 1000


@kernel
def _many(
    parameters: Vector, state: Vector, knots: Vector, c: Vector, yk: Vector, yc: Vector, history: Vector, n: int
) -> float:
    learnt, scratch, total = np.zeros(4), np.zeros(37), 0.0
    for tick in range(n):
        stamp = 0.004 * tick
        state[0] = stamp - 0.003
        total += flatness_command(parameters, stamp, state, 0.0, knots, c, yk, yc, history, tick, learnt, scratch)
    return total


def test_bench_controller(benchmark):
    """A thousand commands in compiled code, each with a prediction over 3 ms + 29 ms of past commands."""
    state = np.array((0.0, 0.0, 0.0, 1.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    pieces = (LINE.knots, LINE.coefficients, LINE.yaw_knots, LINE.yaw_coefficients)
    parameters, history = np.array(parameters_of(Config())), np.zeros((HISTORY, ENTRY))
    _many(parameters, state, *pieces, history, 1)
    total = benchmark(_many, parameters, state, *pieces, history, TICKS)
    assert math.isfinite(total)


def test_bench_controller_from_python(benchmark):
    controller, stamps = FlatnessController(Config()), _ticks()
    position, rest = np.array([0.0, 0.0, 1.5]), np.zeros(3)
    q, covariance = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros((9, 9))

    def once():
        stamp = next(stamps)
        return controller.command(stamp, VehicleState(stamp - 0.003, position, q, rest, rest, covariance), LINE)

    assert math.isfinite(benchmark(once).thrust)


def test_bench_guard(benchmark):
    guard = CommandGuard(Config())
    status = AutopilotStatus(0.0, FlightMode.OFFBOARD, True, False, True, 16.0, 0.9)
    q, rest = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    command = FlatnessController(Config()).command(0.0, VehicleState(0.0, rest, q, rest, rest, np.zeros((9, 9))), LINE)
    assert benchmark(guard.check, command, 0.0, status) is command


def _ticks():
    stamp = 0.0
    while True:
        yield stamp
        stamp += 0.004
