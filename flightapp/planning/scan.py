"""Looking around on the spot."""

import itertools
import math

import numpy as np

from flightapp.frames import Vector
from flightapp.trajectory import ORDER, Trajectory


def yaw_scan(
    stamp: float, position: Vector, yaw: float, centre: float, half_width: float, yaw_rate: float
) -> Trajectory:
    """Rest at ``position`` (3,), turn from ``yaw`` to both sides of ``centre`` by ``half_width``, then to it.

    ``yaw_rate`` (rad/s) is the greatest rate. Each turn is a cubic that starts and ends at rest.
    """
    yaws = [yaw, centre + half_width, centre - half_width, centre]
    knots = [0.0]
    pieces = []
    for start, end in itertools.pairwise(yaws):
        turn = end - start
        duration = max(1.5 * abs(turn) / yaw_rate, 0.1)
        knots.append(knots[-1] + duration)
        pieces.append([start, 0.0, 3.0 * turn / duration**2, -2.0 * turn / duration**3])
    coefficients = np.zeros((1, 3, ORDER))
    coefficients[0, :, 0] = position
    ends = np.array([0.0, knots[-1]])
    return Trajectory(stamp, ends, coefficients, np.array(knots), np.array(pieces))


def heading(origin: Vector, target: Vector) -> float:
    """Yaw (rad) from ``origin`` (3,) to ``target`` (3,)."""
    return math.atan2(target[1] - origin[1], target[0] - origin[0])
