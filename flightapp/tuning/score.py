"""What a vehicle file is worth over many vehicles that are not quite what it says."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flightapp.config import Config

LOST = 3.0
"""m off the line at which a vehicle is lost; what a flight in which it is counts."""


@dataclass(frozen=True, slots=True)
class Draw:
    """How one vehicle flew."""

    seed: int
    rmse: float
    """m off the line, root mean square over the line's duration; `LOST` where it was lost."""
    peak: float
    """m, the greatest distance from it."""
    lost: str = ""
    """Why it was lost; empty where it was not."""


FlyDraw = Callable[[Config, int], Draw]
"""Fly a line with the vehicle that a seed draws, and the controller that a configuration describes."""


@dataclass(frozen=True, slots=True)
class Score:
    """Many of these."""

    runs: int
    mean: float
    """m, RMSE of those that were not lost; NaN of none."""
    worst: float
    """m, the greatest RMSE of all."""
    peak: float
    """m, the greatest distance from the line of all."""
    lost: int

    @property
    def cost(self) -> float:
        """m, what tuning makes small: half the mean and half the worst, where who is lost counts `LOST`."""
        mean = 0.0 if math.isnan(self.mean) else self.mean
        of_all = (mean * (self.runs - self.lost) + LOST * self.lost) / self.runs
        return 0.5 * (of_all + self.worst)


def score(draws: Sequence[Draw]) -> Score:
    """The score of at least one of ``draws``."""
    kept = [draw.rmse for draw in draws if not draw.lost]
    return Score(
        len(draws),
        sum(kept) / len(kept) if kept else math.nan,
        max(draw.rmse for draw in draws),
        max(draw.peak for draw in draws),
        len(draws) - len(kept),
    )


def scored(fly: FlyDraw, config: Config, seeds: Sequence[int]) -> Score:
    """The score of ``config`` over the vehicles of ``seeds``."""
    return score([fly(config, seed) for seed in seeds])
