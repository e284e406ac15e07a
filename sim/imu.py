"""The autopilot's inertial sensors, as it passes their samples on."""

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import ImuSample

FORCE_NOISE = np.array((0.5, 1.7, 1.4))
"""m/s², white, of a sample: measured on PX4's simulated sensors, which stand for vibration too."""
RATE_NOISE = np.array((0.14, 0.07, 0.03))
"""rad/s, white, of a sample: measured likewise."""
FORCE_BIAS = 0.1
"""m/s², from flight to flight on each axis (assumption: half of what EKF2 expects, EKF2_ABIAS_INIT)."""
RATE_BIAS = 0.01
"""rad/s, from flight to flight on each axis (assumption: a tenth of EKF2_GBIAS_INIT: PX4 calibrates gyros at rest)."""
BLOCK = 256
"""Samples whose noise is drawn at once."""


class Imu:
    """Accelerometer and gyroscope of one flight; ``seed`` gives their biases and noise."""

    def __init__(self, seed: int | np.random.SeedSequence) -> None:
        self._random = np.random.default_rng(seed)
        self._bias = np.concatenate(
            (FORCE_BIAS * self._random.standard_normal(3), RATE_BIAS * self._random.standard_normal(3))
        )
        self._scale = np.concatenate((FORCE_NOISE, RATE_NOISE))
        self._draw()

    def _draw(self) -> None:
        self._errors = self._bias + self._scale * self._random.standard_normal((BLOCK, 6))
        self._next = 0

    def sample(self, stamp: float, specific_force: Vector, angular_velocity: Vector) -> ImuSample:
        """What is measured of the true ``specific_force`` (m/s², body) and ``angular_velocity`` (rad/s, body)."""
        errors = self._errors[self._next]
        self._next += 1
        if self._next == BLOCK:
            self._draw()
        return ImuSample(stamp, specific_force + errors[:3], angular_velocity + errors[3:])
