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


def crossing(before: Vector, after: Vector, gate: GateEstimate) -> Crossing | None:
    """Whether the way from ``before`` to ``after`` (3,) crosses ``gate``'s plane in its direction."""
    normal = np.array((math.cos(gate.yaw), math.sin(gate.yaw), 0.0))
    a = float(normal @ (before - gate.position))
    b = float(normal @ (after - gate.position))
    if not a < 0.0 <= b:
        return None
    at = before + (after - before) * (a / (a - b))
    return Crossing(float(np.linalg.norm(at - gate.position)))
