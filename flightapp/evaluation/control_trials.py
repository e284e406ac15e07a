"""Vehicle and controller alone: how closely a line is tracked, by vehicles that are as believed and by others."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import Controller
from flightapp.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Mismatch:
    """What a simulated vehicle has other than it is believed to have; and its weather."""

    seed: int = 0
    mass: float = 1.0
    """Factors."""
    thrust: float = 1.0
    drag: float = 1.0
    motor: float = 1.0
    """Of the rotors' time constants."""
    delay: float = 0.0
    """s more from state to effect than is known."""
    wind: float = 0.0
    """m/s, mean."""
    gust: float = 0.0
    """m/s, standard deviation."""
    noise: float = 0.0
    """Of the states that the controller sees, in shares of a T265's white noise."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One line as it was flown; m."""

    rmse: float
    worst: float
    crashed: bool
    """It touched the ground, or was lost."""


@dataclass(frozen=True, slots=True)
class Score:
    """Many trials together."""

    runs: int
    rmse: float | None
    """m, median of those that did not crash; None where all did."""
    worst: float | None
    """m, the greatest of their RMSEs."""
    error: float | None
    """m, their greatest distance from the line."""
    crashes: int
    cost: float
    """m, what tuning makes small: half the mean RMSE and half the worst, a crash counted as `LOST`."""


FlyAlone = Callable[[Config, Controller, Trajectory, Mismatch], Trial]
"""Fly a line with vehicle and controller alone."""
LOST = 3.0
"""m off the line."""
WIND, GUST = 1.0, 0.8
"""m/s; on the racer about 0.3 m/s² of gusts."""


def drawn(seed: int, size: float = 1.0) -> Mismatch:
    """Mass and thrust ±10 %, drag × 0.5–2 (evenly in its logarithm), delay ±10 ms, motors ±30 %; ``size`` times that.

    In still air, without noise.
    """
    mass, thrust, drag, motor, delay = size * np.random.default_rng([seed, 0xC7]).uniform(-1.0, 1.0, 5)
    return Mismatch(seed, 1.0 + 0.1 * mass, 1.0 + 0.1 * thrust, 2.0**drag, 1.0 + 0.3 * motor, 0.01 * delay)


def draws(count: int, first_seed: int) -> Iterator[Mismatch]:
    """Vehicles as `drawn`, in wind with gusts."""
    for seed in range(first_seed, first_seed + count):
        yield replace(drawn(seed), wind=WIND, gust=GUST)


def trial(errors: Vector, crashed: bool) -> Trial:
    """The trial with the position ``errors`` (n, 3)."""
    squares = np.einsum("ni,ni->n", errors, errors)
    return Trial(math.sqrt(float(squares.mean())), math.sqrt(float(squares.max())), crashed)


def score(trials: Sequence[Trial]) -> Score:
    """``trials``, at least one, as one."""
    flown = [trial for trial in trials if not trial.crashed]
    counted = [LOST if trial.crashed else trial.rmse for trial in trials]
    return Score(
        len(trials),
        float(np.median([trial.rmse for trial in flown])) if flown else None,
        max((trial.rmse for trial in flown), default=None),
        max((trial.worst for trial in flown), default=None),
        len(trials) - len(flown),
        0.5 * (sum(counted) / len(counted) + max(counted)),
    )
