"""External vision on its way to EKF2: which poses PX4 v1.16 takes, in which frames.

After handle_message_odometry and handle_message_vision_position_estimate in mavlink_receiver.cpp, and
EKF2::UpdateExtVisionSample. PX4's local frame has no north of its own here, so that NED and FRD are one.
"""

import math
from typing import NamedTuple

import numpy as np

from flightapp.frames import Vector, flip_yz, quat_from_euler, quat_rotate
from sim.mavlink.codec import Frame

LOCAL_NED, LOCAL_ENU, LOCAL_FRD, LOCAL_FLU = 1, 4, 20, 21
BODY = (8, 9, 12)
"""MAV_FRAME: BODY_NED and BODY_OFFSET_NED stand for BODY_FRD (12)."""
VISION_TYPES, MOCAP = (0, 1, 2, 3), 6
"""MAV_ESTIMATOR_TYPE: unknown, naive, vision and visual inertial; motion capture, which EKF2 doesn't use."""
UNIT = 1e-5
"""How far off 1 a quaternion's length may be."""


class Pose(NamedTuple):
    """A pose of the body (FLU) in the sender's frame, z up."""

    stamp: float
    """s by the sender's clock."""
    position: Vector
    orientation: Vector
    velocity: Vector | None
    """Along the axes of the sender's frame; None when it isn't told."""
    reset_counter: int


class UnsupportedError(Exception):
    """PX4 complains of such a message; the text is its own."""


def from_odometry(frame: Frame, least_quality: int = 0) -> Pose | None:
    """The pose in an ODOMETRY; None where PX4 takes no notice of it. Raises `UnsupportedError`."""
    values = frame.values()
    usec, position, q, velocity = values[0], values[1:4], values[4:8], values[8:11]
    pose_frame, twist_frame, reset_counter, estimator, quality = values[56:61]
    if estimator not in VISION_TYPES:
        if estimator == MOCAP:
            return None
        raise UnsupportedError(f"ODOMETRY: estimator_type {estimator} unsupported")
    if least_quality > 0 and quality < least_quality:
        return None
    place, orientation = _to_flu(position, pose_frame), _orientation(q)
    if place is None or orientation is None:
        return None
    moving = quat_rotate(orientation, flip_yz(np.array(velocity))) if twist_frame in BODY else None
    if moving is None:
        moving = _to_flu(velocity, twist_frame)
    elif not np.isfinite(moving).all():
        moving = None
    return Pose(1e-6 * usec, place, orientation, moving, reset_counter)


def from_position_estimate(frame: Frame) -> Pose | None:
    """The pose in a VISION_POSITION_ESTIMATE; None where it isn't finite."""
    values = frame.values()
    usec, position, (roll, pitch, yaw) = values[0], values[1:4], values[4:7]
    place = _to_flu(position, LOCAL_NED)
    if place is None or not math.isfinite(roll + pitch + yaw):
        return None
    return Pose(1e-6 * usec, place, quat_from_euler(roll, -pitch, -yaw), None, values[-1])


def _to_flu(vector: tuple[float, ...], frame: int) -> Vector | None:
    """(3,) with z up; None in another frame, or where it isn't finite."""
    x, y, z = vector
    if not math.isfinite(x + y + z):
        return None
    if frame in (LOCAL_NED, LOCAL_FRD):
        return np.array((x, -y, -z))
    if frame == LOCAL_FLU:
        return np.array((x, y, z))
    return np.array((y, -x, z)) if frame == LOCAL_ENU else None


def _orientation(q: tuple[float, ...]) -> Vector | None:
    """(4,) FLU to z up, of FRD to NED; None unless it has unit length."""
    w, x, y, z = q
    length = math.hypot(w, x, y, z)
    return np.array((w, x, -y, -z)) / length if abs(length - 1.0) <= UNIT else None
