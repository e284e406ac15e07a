"""How long a command takes: compiled code alone, from Python, and the guard."""

import math

import pytest
from lag_plant import lemniscate

from flightapp.autopilot.guard import CommandGuard
from flightapp.config import Config
from flightapp.control.flatness import FlatnessController
from flightapp.control.mpc import MpcController
from flightapp.control.mpcc import MpccController
from flightapp.control_speed import compiled_commands, compiled_laws, packed_commands, python_commands
from flightapp.messages import AutopilotStatus, FlightMode

LINE = lemniscate(5.0)


def test_bench_controller(benchmark):
    """A thousand times the law itself."""
    assert math.isfinite(benchmark(compiled_laws(Config(), LINE)))


def test_bench_controller_predicting(benchmark):
    """A thousand commands in compiled code, each with a prediction over 3 ms + 29 ms of past commands."""
    assert math.isfinite(benchmark(compiled_commands(Config(), LINE)))


def test_bench_controller_from_python(benchmark):
    assert math.isfinite(benchmark(packed_commands(Config(), LINE)))


@pytest.mark.parametrize("controller", [FlatnessController, MpcController, MpccController])
def test_bench_controller_task(benchmark, controller):
    assert math.isfinite(benchmark(python_commands(controller(Config()), LINE)).thrust)


def test_bench_guard(benchmark):
    status = AutopilotStatus(0.0, FlightMode.OFFBOARD, True, False, True, 16.0, 0.9)
    command = python_commands(FlatnessController(Config()), LINE)()
    assert benchmark(CommandGuard(Config()).check, command, command.stamp, status) is command
