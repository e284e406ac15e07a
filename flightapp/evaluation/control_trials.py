"""Vehicle and controller alone: how closely a line is tracked, by vehicles that are as believed and by others."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector


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


WIND, GUST = 1.0, 0.8
"""m/s; on the racer about 0.3 m/s² of gusts."""


def draws(count: int, first_seed: int) -> Iterator[Mismatch]:
    """Mass and thrust ±10 %, drag × 0.5–2 (evenly in its logarithm), delay ±10 ms, motors ±30 %, wind with gusts."""
    for seed in range(first_seed, first_seed + count):
        rng = np.random.default_rng([seed, 0xC7])
        mass, thrust = rng.uniform(0.9, 1.1, 2)
        drag = math.exp(rng.uniform(-math.log(2.0), math.log(2.0)))
        yield Mismatch(seed, mass, thrust, drag, rng.uniform(0.7, 1.3), rng.uniform(-0.01, 0.01), WIND, GUST)


def trial(errors: Vector, crashed: bool) -> Trial:
    """The trial with the position ``errors`` (n, 3)."""
    squares = np.einsum("ni,ni->n", errors, errors)
    return Trial(math.sqrt(float(squares.mean())), math.sqrt(float(squares.max())), crashed)


def score(trials: Sequence[Trial]) -> Score:
    """``trials`` as one."""
    flown = [trial for trial in trials if not trial.crashed]
    return Score(
        len(trials),
        float(np.median([trial.rmse for trial in flown])) if flown else None,
        max((trial.rmse for trial in flown), default=None),
        max((trial.worst for trial in flown), default=None),
        len(trials) - len(flown),
    )
