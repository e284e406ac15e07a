"""Room for the numbers of a horizon, and the steps that it is cut into."""

from typing import NamedTuple

import numpy as np

from flightapp.control.mpc_cost import REFERENCE
from flightapp.control.mpc_model import CHANGES, INPUTS, STATE, TANGENT
from flightapp.control.parameters import Parameters
from flightapp.control.prediction import remainder
from flightapp.control.riccati import WIDE
from flightapp.frames import Vector

STEPS = 20


class Work(NamedTuple):
    """All that is remembered of a horizon of n steps, so that nothing is allocated in flight."""

    believed: Vector
    """`Parameters`, with the drag as it is known by now."""
    grid: Vector
    """(n, GRID) the steps; see `mpc_model`."""
    bounds: Vector
    """(2, 4) least and greatest inputs."""
    reference: Vector
    """(n + 1, REFERENCE) at the ends of the steps; the first is not used."""
    asked: Vector
    """(n, 4) body rates as a world vector, and thrust, that the reference needs in the middle of each step."""
    wanted: Vector
    """(n, 4) the same as inputs, seen from the planned attitudes."""
    off: Vector
    """(n, 4) inputs planned less those wanted: the plan that is carried on from tick to tick."""
    x: Vector
    """(n + 1, STATE) planned states."""
    u: Vector
    """(n, 4) planned inputs."""
    tried_x: Vector
    tried_u: Vector
    feed: Vector
    """(n, 4) change of the inputs that is best, as far as the model is linear."""
    gains: Vector
    """(n, 4 WIDE) and how the inputs answer to changes of the state; matrices as in `riccati`, as are the next ones."""
    changes: Vector
    """(CHANGES,) derivatives of one step."""
    value: Vector
    """(13 WIDE,) second derivative of the cost to go by the state, and the first as the column after it."""
    half: Vector
    """(17 WIDE,) the same seen from before the step, by state and input, on one side."""
    across: Vector
    """(13 WIDE,) transposed."""
    full: Vector
    """(17 WIDE,) on both sides."""
    small: Vector
    """(10, 4) of one input: second derivative, its factor, two bounds."""
    lines: Vector
    """(4, 4) of one input: first derivative, which are free, room."""
    difference: Vector
    """(13,) of two states."""


def room(p: Parameters, grid: Vector) -> Work:
    """For the steps ``grid`` (n, GRID) of the vehicle ``p``."""
    n, both = len(grid), TANGENT + INPUTS
    sizes = (
        *((2, INPUTS), (n + 1, REFERENCE), (n, INPUTS), (n, INPUTS), (n, INPUTS)),
        *((n + 1, STATE), (n, INPUTS)) * 2,
        *((n, INPUTS), (n, INPUTS * WIDE), (CHANGES,)),
        *((TANGENT * WIDE,), (both * WIDE,), (TANGENT * WIDE,), (both * WIDE,)),
        *((10, INPUTS), (4, INPUTS), (TANGENT,)),
    )
    return Work._make([np.array(p), grid, *(np.zeros(size) for size in sizes)])


def steps_of(p: Parameters, first: float, horizon: float) -> Vector:
    """`STEPS` steps (n, GRID) that add up to ``horizon`` s.

    The first lasts ``first`` s, as long as one command acts, so that it is planned for just that; each is longer
    than the one before by the same factor.
    """
    low, high = 1.0, 2.0
    for _ in range(60):
        growth = 0.5 * (low + high)
        low, high = (growth, high) if first * (growth ** np.arange(STEPS)).sum() < horizon else (low, growth)
    h = first * growth ** np.arange(STEPS)
    lags = (p.rate_lag, p.yaw_rate_lag, p.motor_lag)
    left = [[remainder(float(step), lag) for lag in lags] for step in h]
    return np.column_stack((h, left, np.cumsum(h) - 0.5 * h))
