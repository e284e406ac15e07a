"""Noticing that a gate was flown through, or missed."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import GateEstimate


@dataclass(frozen=True, slots=True)
class Crossing:
    """A passage through the plane of a gate, in its direction."""

    offset: float
    """m from the gate's centre, in its plane."""


def in_gate(position: Vector, gate: GateEstimate) -> Vector:
    """(3,) ``position`` in the gate's axes: behind its plane, to the left of its centre and above it, m."""
    c, s = math.cos(gate.yaw), math.sin(gate.yaw)
    x, y, z = position - gate.position
    return np.array((c * x + s * y, c * y - s * x, z))


def crossing(before: Vector, after: Vector) -> Crossing | None:
    """Whether the way from ``before`` to ``after`` (3,), both `in_gate`, crosses the plane in the gate's direction.

    Each point is seen from where the gate was believed to be at that moment: a correction of the map between them
    then moves the point, and doesn't hide the crossing.
    """
    a, b = float(before[0]), float(after[0])
    if not a < 0.0 <= b:
        return None
    at = before + (after - before) * (a / (a - b))
    return Crossing(math.hypot(at[1], at[2]))
