"""PX4's own logs (ULog, https://docs.px4.io/main/en/dev_log/ulog_file_format.html).

PX4 works in NED and FRD; here all is turned to FLU and to the world, whose x is PX4's north or, where external vision
says what north is, its x axis. Of several topics the first that was logged counts:

| stream    | topics of PX4                                                                  |
| --------- | ------------------------------------------------------------------------------ |
| states    | vehicle_odometry; vehicle_local_position with vehicle_attitude                 |
| truth     | vehicle_local_position_groundtruth with vehicle_attitude_groundtruth           |
| poses     | vehicle_visual_odometry                                                        |
| setpoints | trajectory_setpoint                                                            |
| commands  | vehicle_rates_setpoint; thrust in m/s² by MPC_THR_HOVER, NaN where that is not |
| imu       | sensor_combined                                                                |
| phases    | vehicle_status: "flying" while its mode is OFFBOARD                            |
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flightapp.evaluation.flight import Commands, Flight, Inertial, Motions, Poses, Setpoints, States
from flightapp.evaluation.paths import MAX_GAP, TimedPath, interpolate, path_of
from flightapp.evaluation.rotations import rotate
from flightapp.frames import GRAVITY, Vector
from flightapp.inputs import BadInputError
from flightapp.interchange.extra import load
from flightapp.messages import Event, Phase
from flightapp.sensors.pose_files import CONFIDENT

FLIP: Vector = np.array((1.0, -1.0, -1.0))
"""What `frames.flip_yz` does, for many vectors at once."""
FLIP_TURN: Vector = np.array((1.0, 1.0, -1.0, -1.0))
"""The same for quaternions: FRD to NED becomes FLU to the world."""
OFFBOARD = 14
"""vehicle_status.nav_state."""
FRAME_NED, FRAME_FRD = 1, 2
"""vehicle_odometry.pose_frame; FRD is level and turned about the vertical only."""
MICROSECONDS = 1e-6
_DROPPED = "timestamp_sample"


@dataclass(frozen=True, slots=True)
class _Topic:
    """The fields of one topic, and its stamps (n,) in s, ascending."""

    stamp: Vector
    fields: Mapping[str, Vector]

    def vectors(self, *names: str) -> Vector:
        """(n, k) of fields, or of the k parts of one; NaN where there is no such field."""
        if len(names) == 1:
            count = sum(name.startswith(f"{names[0]}[") for name in self.fields)
            names = tuple(f"{names[0]}[{i}]" for i in range(count or 3))
        nothing = np.full(self.stamp.size, np.nan)
        return np.column_stack([np.asarray(self.fields.get(name, nothing), float) for name in names])


def read_ulog(path: Path) -> Flight:
    """The flight in a ULog; raises `BadInputError`."""
    topics, hover, whole = _topics(path)
    return Flight(
        {"mission": path.stem},
        whole,
        _poses(topics),
        _states(topics),
        _setpoints(topics),
        _commands(topics, hover),
        _truth(topics),
        events=_phases(topics),
        imu=_imu(topics),
    )


def ulog_paths(path: Path) -> dict[str, TimedPath]:
    """Every path in a ULog by PX4's name for it; raises `BadInputError`."""
    topics, _, _ = _topics(path)
    made: dict[str, Motions | Setpoints] = {
        "vehicle_odometry": _odometry(topics.get("vehicle_odometry")),
        "vehicle_visual_odometry": _odometry(topics.get("vehicle_visual_odometry")),
        "vehicle_local_position": _located(topics, ""),
        "vehicle_local_position_groundtruth": _located(topics, "_groundtruth"),
        "trajectory_setpoint": _setpoints(topics),
    }
    paths = {name: path_of(name, motion) for name, motion in made.items()}
    return {name: found for name, found in paths.items() if found.stamp.size}


def _topics(path: Path) -> tuple[dict[str, _Topic], float | None, bool]:
    """The first instance of each topic, MPC_THR_HOVER, and whether nothing was found damaged."""
    library = load("pyulog", "reading a ULog")
    if not path.is_file():
        raise BadInputError(f"{path}: there is no such ULog")
    try:
        log = library.ULog(str(path))
        topics = {data.name: _topic(data.data) for data in log.data_list if data.multi_id == 0}
        hover = log.initial_parameters.get("MPC_THR_HOVER")
    except Exception as error:  # the library raises whatever a damaged file makes it run into
        raise BadInputError(f"{path}: cannot be read as a ULog: {error or type(error).__name__}") from None
    if not topics:
        raise BadInputError(f"{path}: a ULog without any data")
    return topics, hover, not log.file_corruption


def _topic(data: Mapping[str, Any]) -> _Topic:
    """By the time of measurement, where the topic has it."""
    taken = np.asarray(data["timestamp"], float)
    measured = np.asarray(data.get(_DROPPED, taken), float)
    stamp = MICROSECONDS * np.where(measured > 0.0, measured, taken)
    order = np.argsort(stamp, kind="stable")
    order = order[np.diff(stamp[order], prepend=-np.inf) > 0.0]
    return _Topic(stamp[order], {name: np.asarray(values)[order] for name, values in data.items()})


def _odometry(topic: _Topic | None) -> Motions:
    if topic is None:
        return Motions()
    q = topic.vectors("q") * FLIP_TURN
    velocity = topic.vectors("velocity") * FLIP
    body = topic.fields.get("velocity_frame", np.full(topic.stamp.size, FRAME_NED)) > FRAME_FRD
    if np.any(body):
        velocity[body] = rotate(q[body], velocity[body])
    turning = topic.vectors("angular_velocity") * FLIP
    return Motions(topic.stamp, topic.vectors("position") * FLIP, q, velocity, turning)


def _located(topics: Mapping[str, _Topic], suffix: str) -> Motions:
    """Positions, with the attitudes where these were logged too, else NaN."""
    topic, attitude = topics.get(f"vehicle_local_position{suffix}"), topics.get(f"vehicle_attitude{suffix}")
    if topic is None:
        return Motions()
    n = topic.stamp.size
    position, velocity = topic.vectors("x", "y", "z") * FLIP, topic.vectors("vx", "vy", "vz") * FLIP
    q, nothing = np.full((n, 4), np.nan), np.full((n, 3), np.nan)
    if attitude is None:
        return Motions(topic.stamp, position, np.zeros((0, 4)), velocity, nothing)
    nowhere = np.zeros((attitude.stamp.size, 3))
    turned = TimedPath("attitude", attitude.stamp, nowhere, attitude.vectors("q") * FLIP_TURN)
    kept, read = interpolate(TimedPath("position", topic.stamp, position), turned, MAX_GAP)
    q[np.searchsorted(topic.stamp, kept.stamp)] = read.orientation
    return Motions(topic.stamp, position, q, velocity, nothing)


def _states(topics: Mapping[str, _Topic]) -> States:
    topic = topics.get("vehicle_odometry")
    motion = _located(topics, "") if topic is None else _odometry(topic)
    n = motion.stamp.size
    if topic is None:
        variance = np.full((n, 9), np.nan)
    else:
        parts = [topic.vectors(f"{name}_variance") for name in ("position", "velocity", "orientation")]
        variance = np.hstack(parts)
        variance[variance <= 0.0] = np.nan
    turned = motion.orientation if motion.orientation.shape[0] == n else np.full((n, 4), np.nan)
    none = np.zeros(n, np.uint32)
    return States(
        motion.stamp,
        motion.position,
        turned,
        motion.velocity,
        motion.angular_velocity,
        variance,
        none,
        np.zeros((n, 3)),
    )


def _truth(topics: Mapping[str, _Topic]) -> Motions:
    return _located(topics, "_groundtruth")


def _poses(topics: Mapping[str, _Topic]) -> Poses:
    motion = _odometry(topics.get("vehicle_visual_odometry"))
    n = motion.stamp.size
    told, epochs = np.full(n, CONFIDENT, np.uint32), np.zeros(n, np.uint32)
    streams = (motion.stamp, motion.position, motion.orientation, motion.velocity, motion.angular_velocity)
    return Poses(*streams, told, np.full((n, 3), np.nan), epochs)


def _setpoints(topics: Mapping[str, _Topic]) -> Setpoints:
    topic = topics.get("trajectory_setpoint")
    if topic is None:
        return Setpoints()
    parts = [topic.vectors(name) * FLIP for name in ("position", "velocity", "acceleration", "jerk")]
    turn = -topic.vectors("yaw", "yawspeed")
    placed = np.isfinite(parts[0]).all(axis=1)  # what is not controlled is NaN
    position, velocity, acceleration, jerk = (part[placed] for part in parts)
    return Setpoints(topic.stamp[placed], position, velocity, acceleration, jerk, turn[placed, 0], turn[placed, 1])


def _commands(topics: Mapping[str, _Topic], hover: float | None) -> Commands:
    topic = topics.get("vehicle_rates_setpoint")
    if topic is None:
        return Commands()
    share = -topic.vectors("thrust_body")[:, 2]
    scale = GRAVITY / hover if hover and hover > 0.0 else np.nan
    return Commands(topic.stamp, topic.vectors("roll", "pitch", "yaw") * FLIP, scale * share)


def _imu(topics: Mapping[str, _Topic]) -> Inertial:
    topic = topics.get("sensor_combined")
    if topic is None:
        return Inertial()
    return Inertial(topic.stamp, topic.vectors("accelerometer_m_s2") * FLIP, topic.vectors("gyro_rad") * FLIP)


def _phases(topics: Mapping[str, _Topic]) -> tuple[Event, ...]:
    """When somebody steered in OFFBOARD, as this application's phases say it."""
    topic = topics.get("vehicle_status")
    if topic is None or "nav_state" not in topic.fields:
        return ()
    offboard = topic.fields["nav_state"] == OFFBOARD
    changes = np.flatnonzero(np.diff(offboard.astype(int), prepend=0))
    words = {True: f"{Phase.FLYING}: OFFBOARD", False: f"{Phase.LANDING}: OFFBOARD is over"}
    return tuple(Event(float(topic.stamp[i]), "phase", words[bool(offboard[i])]) for i in changes)
