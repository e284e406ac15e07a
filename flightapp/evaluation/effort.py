"""What a flight asked of its vehicle: how much was commanded, and how much of the time at a limit."""

from dataclasses import dataclass

import numpy as np

from flightapp.evaluation.flight import Commands
from flightapp.evaluation.metrics import Window
from flightapp.evaluation.told import Told
from flightapp.frames import GRAVITY, Vector

AT_LIMIT = 1e-6
"""Share of a limit by which a command may miss it and still counts as at it."""


@dataclass(frozen=True, slots=True)
class Effort:
    """What was commanded."""

    rates: float
    """rad²/s, ∫ ‖ω‖² dt."""
    thrust_mean: float
    """m/s², over time."""
    thrust_variance: float
    """m²/s⁴, over time."""
    rates_variation: float
    """rad/s per second: the total variation of the three rates over the time; what chatters is large."""
    thrust_variation: float
    """m/s² per second, of the thrust."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """The limits of commands."""

    rate: float
    """rad/s, of roll and pitch: of each, and of both together for the controllers that bound those."""
    yaw_rate: float
    """rad/s."""
    thrust_min: float
    """m/s², 0 for none."""
    thrust_max: float
    """m/s²."""


@dataclass(frozen=True, slots=True)
class Saturation:
    """Shares of the commands that were at a limit, 0 to 1."""

    rates: float
    yaw_rate: float
    thrust_max: float
    thrust_min: float


def bounds_of(told: Told) -> Bounds | None:
    """The limits in a flight's effective config; None where it does not tell."""
    v, least = told.vehicle, told.guard.thrust_min
    if v.thrust_to_weight is None or v.rate_max is None or v.yaw_rate_max is None or least is None:
        return None
    return Bounds(v.rate_max, v.yaw_rate_max, least, v.thrust_to_weight * GRAVITY)


def control_effort(commands: Commands, window: Window) -> Effort | None:
    """Of the commands inside ``window``, each held until the next; None of fewer than two."""
    inside = window.holds(commands.stamp)
    stamps, rates, thrust = commands.stamp[inside], commands.rates[inside], commands.thrust[inside]
    if stamps.size < 2 or stamps[-1] <= stamps[0]:
        return None
    held, duration = np.diff(stamps), float(stamps[-1] - stamps[0])
    mean = float(held @ thrust[:-1]) / duration
    return Effort(
        float(held @ np.sum(rates[:-1] ** 2, axis=1)),
        mean,
        float(held @ (thrust[:-1] - mean) ** 2) / duration,
        float(np.abs(np.diff(rates, axis=0)).sum()) / duration,
        float(np.abs(np.diff(thrust)).sum()) / duration,
    )


def saturation(commands: Commands, window: Window, bounds: Bounds) -> Saturation | None:
    """Of the commands inside ``window``; None of none."""
    inside = window.holds(commands.stamp)
    if not np.any(inside):
        return None
    rates, thrust = commands.rates[inside], commands.thrust[inside]

    def share(values: Vector, limit: float) -> float:
        return float(np.mean(values >= limit * (1.0 - AT_LIMIT)))

    least = float(np.mean(thrust <= bounds.thrust_min * (1.0 + AT_LIMIT)))
    together = np.abs(np.hypot(rates[:, 0], rates[:, 1]) / bounds.rate - 1.0) <= AT_LIMIT
    alone = np.abs(rates[:, :2]).max(axis=1) >= bounds.rate * (1.0 - AT_LIMIT)
    return Saturation(
        float(np.mean(together | alone)),
        share(np.abs(rates[:, 2]), bounds.yaw_rate),
        share(thrust, bounds.thrust_max),
        least if bounds.thrust_min > 0.0 else 0.0,
    )
