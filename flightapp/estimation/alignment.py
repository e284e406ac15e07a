"""Where the tracker's frame lies: at the start, and after it has relocalised."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.config import Estimation, GateMapping
from flightapp.estimation.process import BIAS, CLIMB, DRIFT, MOUNT, POSITION, RANGE, SCALE, SLIP, TILT, VELOCITY, YAW
from flightapp.frames import Vector, quat_from_rotvec, quat_from_yaw, quat_multiply, quat_rotate, quat_yaw, wrap_angle
from flightapp.messages import PoseSample

FIRST_SPEED = 0.2
"""m/s, deviation of the velocity before the first correction."""
FIRST_SLIP = 0.003
"""m/s, deviation of the tracker's horizontal velocity error at rest."""
MOVED = 0.02
"""m, least deviation of the position after a relocalisation."""
MOVED_SHARE = 0.1
"""Deviation of the way between the last pose before it and the first one after it, as a share."""
TURNED = 0.01
"""rad, deviation of the heading after a relocalisation."""


@dataclass(frozen=True, slots=True)
class Start:
    """How well things are known when the first pose arrives; standard deviations."""

    position: float
    yaw: float
    scale: float
    bias: float
    tilt: float
    climb: float
    mount: float
    range: float

    @classmethod
    def of(cls, e: Estimation, m: GateMapping) -> "Start":
        """As configured."""
        tracker = e.start_position, e.start_yaw, e.scale_error, e.accelerometer_bias, e.tilt_error, e.slip_up
        return cls(*tracker, m.attitude_error, m.range_error)


def begin(x: Vector, P: Vector, sample: PoseSample, start: Start) -> None:
    """Let the tracker's frame be the world's, as well as ``start`` says; gates in ``x``, ``P`` are kept."""
    for i in range(3):
        x[POSITION + i], x[VELOCITY + i] = sample.position[i], sample.velocity[i]
        P[VELOCITY + i, VELOCITY + i] = FIRST_SPEED**2
        P[BIAS + i, BIAS + i] = start.bias**2
        P[MOUNT + i, MOUNT + i] = start.mount**2
        for a in (POSITION, DRIFT):
            for b in (POSITION, DRIFT):
                P[a + i, b + i] = start.position**2
    P[YAW, YAW], P[SCALE, SCALE] = start.yaw**2, start.scale**2
    P[SLIP, SLIP] = P[SLIP + 1, SLIP + 1] = FIRST_SLIP**2
    P[TILT, TILT] = P[TILT + 1, TILT + 1] = start.tilt**2
    P[CLIMB, CLIMB] = start.climb**2
    P[RANGE, RANGE] = start.range**2
    # The start's heading is off about the start itself, so a tracker that is elsewhere in its frame is off, too.
    _follow_position(P, sample.position)


def relocate(x: Vector, P: Vector, before: Vector, sample: PoseSample, dt: float) -> None:
    """Take over that the tracker's frame lies elsewhere from ``sample`` on.

    The vehicle itself has gone on from where it was ``dt`` seconds ago, with the attitude ``before`` (4,) q_wb.
    """
    turn = quat_from_rotvec(dt * sample.angular_velocity)
    heading = float(quat_yaw(quat_multiply(before, turn))) - float(quat_yaw(sample.orientation))
    x[YAW] = wrap_angle(heading)
    arm = quat_rotate(quat_from_yaw(x[YAW]), sample.position)
    way = dt * x[VELOCITY : VELOCITY + 3]
    x[DRIFT : DRIFT + 3] = x[POSITION : POSITION + 3] + way - arm
    P[YAW, YAW] += TURNED**2
    _follow_position(P, arm)
    noise = math.hypot(MOVED, MOVED_SHARE * float(np.linalg.norm(way)))
    for i in range(3):
        P[DRIFT + i, DRIFT + i] += noise**2


def _follow_position(P: Vector, arm: Vector) -> None:
    """Make the drift's error what those of position and heading leave for it, ``arm`` (3,) from odom's origin."""
    for rows in (P, P.T):
        rows[DRIFT : DRIFT + 3] = rows[POSITION : POSITION + 3]
        rows[DRIFT] += arm[1] * rows[YAW]
        rows[DRIFT + 1] -= arm[0] * rows[YAW]
