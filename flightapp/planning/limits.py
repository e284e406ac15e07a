"""How close a trajectory comes to what a vehicle can do."""

from dataclasses import dataclass

import numpy as np

from flightapp.frames import GRAVITY
from flightapp.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Peaks:
    """Greatest lengths over a trajectory."""

    speed: float
    """m/s."""
    acceleration: float
    """m/s²."""
    jerk: float
    """m/s³."""
    specific_force: float
    """m/s², with gravity."""
    body_rate: float
    """rad/s of roll and pitch together: the jerk across the specific force, over the specific force."""
    yaw_rate: float
    """rad/s."""


def trajectory_peaks(trajectory: Trajectory, step: float = 2e-3) -> Peaks:
    """Peaks of ``trajectory`` sampled every ``step`` s, its knots included.

    The specific force and the body rate are those of a vehicle without drag (differential flatness: D.
    Mellinger and V. Kumar, 2011).
    """
    end = max(trajectory.duration, float(trajectory.yaw_knots[-1]))
    times = np.unique(np.concatenate((np.arange(0.0, end, step), trajectory.knots, trajectory.yaw_knots)))
    samples = trajectory.sample(times)
    force = samples.acceleration + np.array([0.0, 0.0, GRAVITY])
    length = np.maximum(np.linalg.norm(force, axis=1), 1e-9)
    axis = force / length[:, None]
    across = samples.jerk - np.sum(samples.jerk * axis, axis=1)[:, None] * axis
    return Peaks(
        float(np.linalg.norm(samples.velocity, axis=1).max()),
        float(np.linalg.norm(samples.acceleration, axis=1).max()),
        float(np.linalg.norm(samples.jerk, axis=1).max()),
        float(length.max()),
        float((np.linalg.norm(across, axis=1) / length).max()),
        float(np.abs(samples.yaw_rate).max()),
    )
