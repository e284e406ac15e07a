"""Delay and lag of the body rates.

Output error: the commands that were sent go through the model, a delay and a first-order lag, and the answer is
compared with the rates that the vehicle had (L. Ljung, "System Identification", 1999, 4.2 and 13.4: unbiased in closed
loop where the vehicle does something between its measurement and the command). The vehicle's real rate loop is of
higher order, so what is found is what stands for it best at the frequencies that were flown.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from flightapp.identification.fitting import Fit, Start, explained, robust_fit
from flightapp.identification.lags import lagged
from flightapp.identification.series import Stretch

BLOCK = 2.0
"""s over which errors are correlated."""
DELAY_BOUNDS = (0.0, 0.2)
LAG_BOUNDS = (0.0, 1.0)
STEP = 0.01
"""s, how far a step of the search goes."""


@dataclass(frozen=True, slots=True)
class RateFit:
    """Delay and lag of some axes together; s."""

    delay: float
    delay_sigma: float
    lag: float
    lag_sigma: float
    explained: float
    """Share of the rates' variance."""


def fit_rates(parts: Sequence[Stretch], axes: Sequence[int], delay: float | None = None) -> RateFit:
    """Delay and lag of the body rates about ``axes`` (0 roll, 1 pitch, 2 yaw), or the lag behind a given ``delay``."""
    measured = np.concatenate([part.angular_velocity[:, axis] for part in parts for axis in axes])
    pairs = [(part, axis) for part in parts for axis in axes]
    kinds = np.concatenate([np.full(part.stamp.size, axis) for part, axis in pairs])
    blocks = np.concatenate([_blocks(part, 1_000_000 * i) for i, part in enumerate(parts) for _ in axes])

    def residuals(x: Vector) -> Vector:
        behind = delay if delay is not None else float(x[1])
        return np.concatenate([_error(part, axis, behind, float(x[0])) for part, axis in pairs])

    fit = robust_fit(residuals, _start(delay), kinds, blocks)
    return _result(fit, delay, measured)


def _error(part: Stretch, axis: int, delay: float, lag: float) -> Vector:
    """Model less measurement, without what is constant: a gyroscope's bias."""
    model = lagged(part.sent, np.ascontiguousarray(part.rates[:, axis]), delay, lag, part.stamp)
    error = model - part.angular_velocity[:, axis]
    return error - np.median(error)


def _blocks(part: Stretch, offset: int) -> Vector:
    return offset + (part.stamp // BLOCK).astype(int)


def _start(delay: float | None) -> Start:
    size = 1 if delay is not None else 2
    lower, upper = np.array((LAG_BOUNDS[0], DELAY_BOUNDS[0])), np.array((LAG_BOUNDS[1], DELAY_BOUNDS[1]))
    return Start(np.array((0.04, 0.02))[:size], np.full(size, STEP), lower[:size], upper[:size])


def _result(fit: Fit, delay: float | None, measured: Vector) -> RateFit:
    sigmas, share = fit.sigmas, explained(measured, fit.residuals)
    if delay is not None:
        return RateFit(delay, 0.0, float(fit.values[0]), float(sigmas[0]), share)
    return RateFit(float(fit.values[1]), float(sigmas[1]), float(fit.values[0]), float(sigmas[0]), share)
