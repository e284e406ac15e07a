"""What the benchmark times of control: the law, whole commands in compiled code, and from Python."""

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.flatness import control_memory, flatness_command, flatness_law, forget
from flightapp.control.parameters import parameters_of, unpacked
from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import Controller
from flightapp.jit import lean_kernel
from flightapp.messages import RateCommand, VehicleState
from flightapp.trajectory import Trajectory

BATCH = 1000
"""Commands in a row in compiled code."""
PERIOD, AGE, HEIGHT = 0.004, 0.003, 1.5
"""s between commands, s of a state's age, and m."""


@lean_kernel
def _laws(m: Vector, n: int) -> float:
    """So many times the law itself, from motions as they are, without prediction and what is learnt."""
    p, total = unpacked(m), 0.0
    drag, s = (p.drag_x, p.drag_y, p.drag_z), at.STATE
    for tick in range(n):
        q = (m[s + 4], m[s + 5], m[s + 6], m[s + 7])
        motion = ((m[s + 1], m[s + 2], m[s + 3]), (m[s + 8], m[s + 9], m[s + 10]), q, GRAVITY)
        asked, thrust, _ = flatness_law(p, m, PERIOD * tick, motion, drag, (0.0, 0.0, 0.0))
        m[at.RATES], m[at.RATES + 1], m[at.RATES + 2] = asked
        total += thrust
    return total


def compiled_laws(config: Config, line: Trajectory) -> Callable[[], float]:
    """Evaluates the control law in a batch along ``line`` in compiled code, as the paper's profile has it."""
    memory = _control_memory(config, line)
    return lambda: _laws(memory, BATCH)


@lean_kernel
def _commands(m: Vector, n: int) -> float:
    """So many commands in a row, each from a state `AGE` old, without leaving compiled code."""
    forget(m)
    total = 0.0
    for tick in range(n):
        m[at.STAMP] = PERIOD * tick
        m[at.STATE] = m[at.STAMP] - AGE
        total += flatness_command(m)
    return total


def compiled_commands(config: Config, line: Trajectory) -> Callable[[], float]:
    """Makes a batch of commands along ``line`` in compiled code, each with a prediction over the configured delay."""
    memory = _control_memory(config, line)
    return lambda: _commands(memory, BATCH)


def packed_commands(config: Config, line: Trajectory) -> Callable[[], float]:
    """Makes one command after the other from Python, whose numbers stand in the controller's array."""
    memory, clock = _control_memory(config, line), _stamps()

    def command() -> float:
        memory[at.STAMP] = stamp = next(clock)
        memory[at.STATE] = stamp - AGE
        return flatness_command(memory)

    return command


def _control_memory(config: Config, line: Trajectory) -> Vector:
    memory = control_memory(parameters_of(config), line)
    memory[at.STATE + 3] = HEIGHT
    return memory


def python_commands(controller: Controller, line: Trajectory) -> Callable[[], RateCommand]:
    """Makes one command after the other along ``line``, as an application does."""
    clock = _stamps()

    def command() -> RateCommand:
        stamp = next(clock)
        return controller.command(stamp, _state(stamp - AGE), line)

    return command


def _stamps() -> Iterator[float]:
    return (PERIOD * count for count in itertools.count(1))


def _state(stamp: float) -> VehicleState:
    rest = np.zeros(3)
    upright = np.array((1.0, 0.0, 0.0, 0.0))
    return VehicleState(stamp, np.array((0.0, 0.0, HEIGHT)), upright, rest, rest, 1e-4 * np.eye(9))
