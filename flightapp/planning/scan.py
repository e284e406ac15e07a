"""Looking around on the spot."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.trajectory import ORDER, Trajectory

BLUR = 1.5
"""px that a marker may be smeared by the turning within an exposure, and is still surely read."""
TURN_SHARE = 0.5
"""Of the vehicle's greatest yaw rate, at which looking around leaves the position undisturbed."""
TURN_RAMP = 0.5
"""s to reach the rate of a turn, and to stop."""


def turn_rate(config: Config) -> float:
    """Greatest yaw rate (rad/s) at which the vehicle turns gently and the camera sees markers sharply."""
    sharp = BLUR / (max(config.camera.focal[:2]) * config.camera.exposure)
    return min(TURN_SHARE * config.vehicle.yaw_rate_max, sharp)


def turns(stamp: float, position: Vector, yaws: Sequence[float], yaw_rate: float) -> Trajectory:
    """Rest at ``position`` (3,) and turn from the first of ``yaws`` (rad) to each of the others.

    ``yaw_rate`` (rad/s) is the greatest rate: each turn speeds up to it, keeps it, and slows down to rest.
    """
    knots, pieces = [0.0], []
    for start, end in itertools.pairwise(yaws):
        way, side = abs(end - start), math.copysign(1.0, end - start)
        rate = min(yaw_rate, way / TURN_RAMP)
        steady = max(way / rate - TURN_RAMP, 0.0) if rate > 0.0 else 0.0
        slope = 0.5 * side * rate / TURN_RAMP
        ramp = slope * TURN_RAMP**2
        turn = [(TURN_RAMP, [start, 0.0, slope, 0.0]), (steady, [start + ramp, side * rate, 0.0, 0.0])]
        turn.append((TURN_RAMP, [end - ramp, side * rate, -slope, 0.0]))
        for duration, piece in turn:
            if duration > 0.0:
                knots.append(knots[-1] + duration)
                pieces.append(piece)
    coefficients = np.zeros((1, 3, ORDER))
    coefficients[0, :, 0] = position
    ends = np.array([0.0, knots[-1]])
    return Trajectory(stamp, ends, coefficients, np.array(knots), np.array(pieces))


def around(yaw: float, centre: float, half_width: float) -> tuple[float, ...]:
    """Headings (rad) of a scan from ``yaw`` on: to the nearer side of ``centre``, over to the other and all round."""
    centre = yaw + math.remainder(centre - yaw, 2.0 * math.pi)
    side = half_width if yaw > centre else -half_width
    return yaw, centre + side, centre + side - math.copysign(2.0 * math.pi, side)


def heading(origin: Vector, target: Vector) -> float:
    """Yaw (rad) from ``origin`` (3,) to ``target`` (3,)."""
    return math.atan2(target[1] - origin[1], target[0] - origin[0])
