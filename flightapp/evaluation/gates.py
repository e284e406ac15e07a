"""Gates as squares in space: their outline, and where a path goes through them."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector


@dataclass(frozen=True, slots=True)
class Crossing:
    """A passage through a gate's opening in its direction."""

    stamp: float
    offset: float
    """m from the gate's centre, in its plane."""


def gate_outline(position: Vector, yaw: float, opening: float) -> Vector:
    """(5, 3) m, world: the closed square of side ``opening`` of a gate at ``position`` (3,), facing ``yaw``."""
    square = 0.5 * opening * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)], float)
    across = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    outline: Vector = position + square[:, :1] * across + square[:, 1:] * np.array([0.0, 0.0, 1.0])
    return outline


def crossings(stamps: Vector, path: Vector, position: Vector, yaw: float, opening: float) -> tuple[Crossing, ...]:
    """Where ``path`` (n, 3), at ``stamps`` (n,), goes forward through the gate's opening."""
    if stamps.size < 2:
        return ()
    c, s = math.cos(yaw), math.sin(yaw)
    relative = path - position
    ahead = relative[:, 0] * c + relative[:, 1] * s
    left = relative[:, 1] * c - relative[:, 0] * s
    found = []
    for i in np.flatnonzero((ahead[:-1] < 0.0) & (ahead[1:] >= 0.0)):
        part = ahead[i] / (ahead[i] - ahead[i + 1])
        y = left[i] + part * (left[i + 1] - left[i])
        z = relative[i, 2] + part * (relative[i + 1, 2] - relative[i, 2])
        if max(abs(y), abs(z)) <= 0.5 * opening:
            found.append(Crossing(float(stamps[i] + part * (stamps[i + 1] - stamps[i])), math.hypot(y, z)))
    return tuple(found)
