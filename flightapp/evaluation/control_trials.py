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
    """To where the line was at each moment; as `worst`."""
    worst: float
    crashed: bool
    """It touched the ground, or was lost."""
    contour: float = 0.0
    """RMS distance from the line as a path, whenever it was there; as `contour_worst`."""
    contour_worst: float = 0.0
    time: float | None = None
    """s from the line's start until `FINISH` m of it were left; None where that was never so."""
    speed: float = 0.0
    """m/s, the greatest."""
    stood_in: int = 0
    """Commands of the controller that stands in for one that plans."""


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
    contour: float | None
    """m, median RMS distance from the path; the greatest of them."""
    contour_worst: float | None
    contour_error: float | None
    """m, the greatest distance from the path."""
    time: float | None
    """s, median time; None where none finished. The greatest of them."""
    time_worst: float | None
    speed: float | None
    """m/s, the greatest."""
    stood_in: int
    """Commands in all of the controller that stands in."""
    cost: float
    """m, what tuning makes small: half the mean RMSE and half the worst, a crash counted as `LOST`."""


FlyAlone = Callable[[Config, Controller, Trajectory, Mismatch], Trial]
"""Fly a line with vehicle and controller alone."""
FINISH = 0.3
"""m of the line left, at which its time is taken: the last centimetres are for coming to rest."""
PATH_STEP = 2e-3
"""s between the points of a line that positions are compared with."""
PATH_REACH = 0.6
"""s of the line around the last nearest point, in which the next is looked for: it crosses itself."""
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


@dataclass(frozen=True, slots=True)
class Flown:
    """What was seen of a flight along a line, from its start on; n moments."""

    times: Vector
    """(n,) s since the line's start."""
    positions: Vector
    """(n, 3) m."""
    speeds: Vector
    """(n,) m/s."""
    crashed: bool
    stood_in: int


def trial(line: Trajectory, flown: Flown) -> Trial:
    """How ``line`` was flown. By time it is judged up to its end, as a path up to the finish."""
    off = flown.positions - line.sample(flown.times).position
    squares = np.einsum("ni,ni->n", off, off)[: max(int((flown.times <= line.duration).sum()), 1)]
    distances, left = _along(line, flown.positions)
    there = np.flatnonzero(left <= FINISH)
    squared = distances[: int(there[0]) + 1 if there.size else None] ** 2
    return Trial(
        math.sqrt(float(squares.mean())),
        math.sqrt(float(squares.max())),
        flown.crashed,
        math.sqrt(float(squared.mean())),
        math.sqrt(float(squared.max())),
        float(flown.times[there[0]]) if there.size and not flown.crashed else None,
        float(flown.speeds.max()),
        flown.stood_in,
    )


def _along(line: Trajectory, positions: Vector) -> tuple[Vector, Vector]:
    """(n,) distances of ``positions`` (n, 3) from the path, and m of it that are left from there; in order."""
    times = np.linspace(0.0, line.duration, max(int(line.duration / PATH_STEP), 2))
    points = line.sample(times).position
    ways = np.diff(points, axis=0)
    lengths = np.linalg.norm(ways, axis=1)
    ahead = ways / np.maximum(lengths, 1e-9)[:, None]
    left = np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
    reach, nearest = int(PATH_REACH / PATH_STEP), 0
    distances, remaining = np.empty(len(positions)), np.empty(len(positions))
    for i, position in enumerate(positions):
        first = max(nearest - reach, 0)
        off = position - points[first : nearest + reach]
        nearest = first + int(np.einsum("ni,ni->n", off, off).argmin())
        e, way = position - points[nearest], ahead[min(nearest, len(ahead) - 1)]
        distances[i], remaining[i] = np.linalg.norm(e - (e @ way) * way), left[nearest]
    return distances, remaining


def score(trials: Sequence[Trial]) -> Score:
    """``trials``, at least one, as one."""
    flown = [trial for trial in trials if not trial.crashed]
    counted = [LOST if trial.crashed else trial.rmse for trial in trials]
    times = [trial.time for trial in flown if trial.time is not None]
    return Score(
        len(trials),
        float(np.median([trial.rmse for trial in flown])) if flown else None,
        max((trial.rmse for trial in flown), default=None),
        max((trial.worst for trial in flown), default=None),
        len(trials) - len(flown),
        float(np.median([trial.contour for trial in flown])) if flown else None,
        max((trial.contour for trial in flown), default=None),
        max((trial.contour_worst for trial in flown), default=None),
        float(np.median(times)) if times else None,
        max(times, default=None),
        max((trial.speed for trial in flown), default=None),
        sum(trial.stood_in for trial in trials),
        0.5 * (sum(counted) / len(counted) + max(counted)),
    )
