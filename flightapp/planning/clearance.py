"""Whether a trajectory keeps clear of the frames of the gates that it passes or flies through."""

import math
from collections.abc import Sequence

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import GateEstimate
from flightapp.track import GateShape
from flightapp.trajectory import Trajectory

INTERVAL = 0.02
"""s between the points that are looked at."""


def touched_frame(
    trajectory: Trajectory, gates: Sequence[GateEstimate], shape: GateShape, radius: float
) -> GateEstimate | None:
    """The first of ``gates`` whose frame a ball of ``radius`` m would touch on its way; None where all is clear.

    A frame that the start touches already is left out: any way on from there leads out of it.
    """
    times = np.linspace(0.0, trajectory.duration, max(int(trajectory.duration / INTERVAL), 2))
    path = trajectory.sample(times).position
    for gate in gates:
        touching = _in_frame(path - gate.position, gate.yaw, shape, radius)
        if touching.any() and not touching[0]:
            return gate
    return None


def _in_frame(offset: Vector, yaw: float, shape: GateShape, radius: float) -> "np.typing.NDArray[np.bool_]":
    """Which of the ``offset`` (n, 3) m from a gate's centre, world, are within ``radius`` of its frame."""
    c, s = math.cos(yaw), math.sin(yaw)
    along = c * offset[:, 0] + s * offset[:, 1]
    across = np.maximum(np.abs(c * offset[:, 1] - s * offset[:, 0]), np.abs(offset[:, 2]))
    half = 0.5 * shape.opening
    touching: np.typing.NDArray[np.bool_] = (
        (np.abs(along) < radius) & (across > half - radius) & (across < half + shape.border + radius)
    )
    return touching
