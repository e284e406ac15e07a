"""A vehicle that races to and fro, with a simulated tracker and simulated inertial sensors."""

import math

import numpy as np

from flightapp.frames import (
    GRAVITY,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
    quat_rotate_inverse,
    quat_to_rotvec,
)
from flightapp.messages import GroundTruth
from sim.imu import Imu
from sim.t265 import T265

RATE = 200.0
UP = np.array((0.0, 0.0, GRAVITY))
SIZE, PACE = np.array((4.0, 1.5, 0.6)), np.array((1.5, 3.0, 2.0))
"""m and rad/s of the three oscillations: up to 17 m/s² and 8 m/s."""
STEP = 1e-3


class Racing:
    """Truth, and what the sensors measure of it."""

    def __init__(self, seed, begin=0.0):
        self.stamp, self._begin = 0.0, begin
        self.tracker, self.imu = T265(seed), Imu(seed + 1000)

    def _place(self, t):
        s = t - 1.0
        ease = 0.0 if s <= 0.0 else s - (1.0 - math.exp(-s))
        return SIZE * np.sin(PACE * ease + self._begin) - SIZE * np.sin(self._begin)

    def motion(self, t):
        """Position, velocity, acceleration and q_wb at ``t``: at rest for 1 s, thrust along the body's z."""
        before, here, after = self._place(t - STEP), self._place(t), self._place(t + STEP)
        velocity, acceleration = (after - before) / (2.0 * STEP), (after - 2.0 * here + before) / STEP**2
        up = (acceleration + UP) / np.linalg.norm(acceleration + UP)
        left = np.cross(up, (1.0, 0.0, 0.0))
        left /= np.linalg.norm(left)
        return here, velocity, acceleration, quat_from_matrix(np.column_stack((np.cross(left, up), left, up)))

    def _rates(self, t):
        q = self.motion(t)[3]
        return quat_to_rotvec(quat_multiply(quat_conjugate(q), self.motion(t + STEP)[3])) / STEP

    def advance(self):
        """One period; the tracker's pose, or None where it was lost, and what the inertial sensors felt."""
        self.stamp += 1.0 / RATE
        p, v, a, q = self.motion(self.stamp)
        w = self._rates(self.stamp)
        measured = self.tracker.sample(GroundTruth(self.stamp, p, q, v, w))
        felt = self.imu.sample(self.stamp, quat_rotate_inverse(q, a + UP), w)
        return None if measured is None else measured[0], felt
