"""Least squares that gusts do not spoil, with standard errors that can be believed.

Residuals count with Huber's weights (P. Huber, "Robust Estimation of a Location Parameter", 1964), over the scale that
the median of their amounts gives each kind of measurement. The errors of a flight are not white: gusts, tracker errors
and what a simple model lacks go on for a while. So the covariance is the "sandwich" that lets residuals within a block
of time be correlated in any way (K.-Y. Liang and S. Zeger, "Longitudinal data analysis using generalized linear
models", 1986).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flightapp.frames import Vector

HUBER = 1.345
"""Standard deviations from which residuals count less; costs 5 % of the efficiency where all is normal."""
ROUNDS = 6
"""Times that the weights are found anew."""
SETTLED = 1e-3
"""Of its standard error, by which no parameter may still move."""
MAD = 1.4826
"""Standard deviation over median amount, of the normal distribution."""

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Fit:
    """Parameters, and how well they are known."""

    values: Vector
    """(p,)."""
    covariance: Vector
    """(p, p)."""
    residuals: Vector
    """(n,), unweighted."""

    @property
    def sigmas(self) -> Vector:
        """(p,) standard errors."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True)
class Start:
    """Where the search begins, how far a step goes, and its bounds; each (p,)."""

    values: Vector
    steps: Vector
    lower: Vector
    upper: Vector


def robust_fit(residuals: Callable[[Vector], Vector], start: Start, kinds: Indices, blocks: Indices) -> Fit:
    """The parameters that make ``residuals`` (n,) smallest.

    ``kinds`` (n,) tells measurements of different noise apart, ``blocks`` (n,) the stretches of time over which their
    errors are correlated.
    """
    x = np.clip(start.values, start.lower, start.upper)
    scaled = np.empty(0)
    covariance = np.zeros((x.size, x.size))
    weights = np.ones(kinds.size)
    for _ in range(ROUNDS):
        scale = _scales(residuals(x), kinds)
        amount = np.maximum(np.abs(residuals(x)) / scale, 1e-12)
        weights = np.sqrt(np.minimum(1.0, HUBER / amount)) / scale
        before = x
        x, scaled, J = _solve(residuals, weights, x, start)
        covariance = sandwich(J, scaled, blocks)
        if np.all(np.abs(x - before) <= SETTLED * np.sqrt(np.diag(covariance)) + 1e-12):
            break
    return Fit(x, covariance, scaled / weights)


def _solve(
    residuals: Callable[[Vector], Vector], weights: Vector, x: Vector, start: Start
) -> tuple[Vector, Vector, Vector]:
    """The minimum, its weighted residuals, and their Jacobian by central differences."""
    found = least_squares(
        lambda y: weights * residuals(y),
        x,
        bounds=(start.lower, start.upper),
        x_scale=start.steps,
        ftol=1e-9,
        xtol=1e-7,
    )
    columns = []
    for k, step in enumerate(1e-2 * start.steps):
        up, down = found.x.copy(), found.x.copy()
        up[k] += step
        down[k] -= step
        columns.append(weights * (residuals(up) - residuals(down)) / (2.0 * step))
    return found.x, found.fun, np.stack(columns, axis=1)


def _scales(residuals: Vector, kinds: Indices) -> Vector:
    """(n,) standard deviation of each residual's kind."""
    scale = np.empty(residuals.size)
    for kind in np.unique(kinds):
        of_kind = kinds == kind
        scale[of_kind] = max(MAD * float(np.median(np.abs(residuals[of_kind]))), 1e-9)
    return scale


def sandwich(J: Vector, residuals: Vector, blocks: Indices) -> Vector:
    """(p, p) covariance for the Jacobian ``J`` (n, p), where ``residuals`` (n,) are correlated within ``blocks``."""
    _, index = np.unique(blocks, return_inverse=True)
    count = int(index.max()) + 1
    scores = np.zeros((count, J.shape[1]))
    np.add.at(scores, index, J * residuals[:, None])
    bread = np.linalg.pinv(J.T @ J)
    few = count / max(count - J.shape[1], 1)
    covariance: Vector = few * bread @ (scores.T @ scores) @ bread
    return covariance


def explained(measured: Vector, residuals: Vector) -> float:
    """Share of the variance of ``measured`` that the model explains."""
    return 1.0 - float(np.sum(residuals**2) / max(np.sum((measured - measured.mean()) ** 2), 1e-12))
