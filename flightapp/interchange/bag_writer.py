"""A flight as a ROS 2 bag (MCAP storage), in the standard messages that ROS's own tools know.

Frames follow REP 103: `world` is x forward, y left, z up; `body` is x forward, y left, z up; `odom` is the tracker's.
Stamps are the flight's own, in ns, in the headers and in the bag.

| topic                       | type                          | what                                                  |
| --------------------------- | ----------------------------- | ----------------------------------------------------- |
| /flightapp/state            | nav_msgs/Odometry             | estimate; its twist in body axes, as ROS wants it     |
| /flightapp/truth            | nav_msgs/Odometry             | ground truth                                          |
| /flightapp/pose             | nav_msgs/Odometry             | the tracker's samples, in odom                        |
| /flightapp/setpoint         | nav_msgs/Odometry             | reference, level                                      |
| /flightapp/command/rates    | geometry_msgs/TwistStamped    | body rates asked for                                  |
| /flightapp/command/thrust   | geometry_msgs/AccelStamped    | specific force asked for, along z                     |
| /flightapp/imu              | sensor_msgs/Imu               | specific force and turning, without orientation       |
| /flightapp/gates            | geometry_msgs/PoseArray       | the gate map, in the order of passage                 |
| /flightapp/gates/true       | geometry_msgs/PoseArray       | the true gates                                        |
| /flightapp/battery          | sensor_msgs/BatteryState      | voltage and charge                                    |
| /flightapp/events           | rcl_interfaces/Log            | phases, faults, gates …                               |
| /tf                         | tf2_msgs/TFMessage            | world → body, by the estimate                         |
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from flightapp.evaluation.flight import Flight, Motions
from flightapp.evaluation.rotations import conjugate, from_yaw, rotate
from flightapp.frames import Vector
from flightapp.interchange.extra import load
from flightapp.messages import GateEstimate

VERSION = 8
"""Of the bag's metadata: the newest that ROS 2 Jazzy reads."""
Message = tuple[str, str, float, Any]
"""Topic, type, stamp in s, and the message."""
Row = list[float]


def write_bag(flight: Flight, out: Path) -> None:
    """Write ``flight`` to the new directory ``out``; raises `BadInputError` where rosbags is missing."""
    rosbag2 = load("rosbags.rosbag2", "writing a ROS 2 bag")
    typesys = load("rosbags.typesys", "writing a ROS 2 bag")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    messages = sorted(_Maker(store.types).messages(flight), key=lambda message: message[2])
    with rosbag2.Writer(out, version=VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, stamp, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], nanoseconds(stamp), store.serialize_cdr(message, kind))


def nanoseconds(stamp: float) -> int:
    """``stamp`` in ns, 0 at least, as the bag has it."""
    return max(round(stamp * 1e9), 0)


class _Maker:
    """Makes messages of ROS's ``types``, by name."""

    def __init__(self, types: Any) -> None:
        self._types = types

    def messages(self, flight: Flight) -> Iterator[Message]:
        """All of them, stream by stream."""
        yield from self._odometry("/flightapp/state", "world", flight.states, flight.states.variance)
        yield from self._odometry("/flightapp/truth", "world", flight.truth)
        yield from self._odometry("/flightapp/pose", "odom", flight.poses)
        s = flight.setpoints
        turning = np.column_stack((np.zeros((s.stamp.size, 2)), s.yaw_rate))
        reference = Motions(s.stamp, s.position, from_yaw(s.yaw), s.velocity, turning)
        yield from self._odometry("/flightapp/setpoint", "world", reference)
        yield from self._commands(flight)
        yield from self._imu(flight)
        yield from self._gates(flight)
        yield from self._rest(flight)
        yield from self._transforms(flight)

    def _new(self, kind: str, *parts: Any) -> Any:
        return self._types[kind](*parts)

    def _time(self, stamp: float) -> Any:
        seconds, rest = divmod(nanoseconds(stamp), 1_000_000_000)
        return self._new("builtin_interfaces/msg/Time", seconds, rest)

    def _header(self, stamp: float, frame: str) -> Any:
        return self._new("std_msgs/msg/Header", self._time(stamp), frame)

    def _vector(self, v: Row) -> Any:
        return self._new("geometry_msgs/msg/Vector3", *v)

    def _turn(self, q: Row) -> Any:
        """ROS has the scalar last."""
        return self._new("geometry_msgs/msg/Quaternion", q[1], q[2], q[3], q[0])

    def _pose(self, p: Row, q: Row) -> Any:
        return self._new("geometry_msgs/msg/Pose", self._new("geometry_msgs/msg/Point", *p), self._turn(q))

    def _odometry(self, topic: str, frame: str, motion: Motions, variance: Vector | None = None) -> Iterator[Message]:
        n, kind = motion.stamp.size, "nav_msgs/msg/Odometry"
        q = _oriented(motion)
        spread = np.zeros((n, 9)) if variance is None or len(variance) != n else variance
        velocity = rotate(conjugate(q), motion.velocity)
        columns = (motion.stamp, motion.position, q, velocity, motion.angular_velocity, spread)
        for stamp, p, turn, v, w, told in zip(*(column.tolist() for column in columns), strict=True):
            pose = self._new("geometry_msgs/msg/PoseWithCovariance", self._pose(p, turn), _diagonal(told[:3], told[6:]))
            twist = self._new("geometry_msgs/msg/Twist", self._vector(v), self._vector(w))
            moving = self._new("geometry_msgs/msg/TwistWithCovariance", twist, _diagonal(told[3:6], [0.0] * 3))
            yield topic, kind, stamp, self._new(kind, self._header(stamp, frame), "body", pose, moving)

    def _commands(self, flight: Flight) -> Iterator[Message]:
        c, nothing = flight.commands, self._vector([0.0, 0.0, 0.0])
        rates, force = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/AccelStamped"
        for stamp, w, thrust in zip(c.stamp.tolist(), c.rates.tolist(), c.thrust.tolist(), strict=True):
            header = self._header(stamp, "body")
            twist = self._new("geometry_msgs/msg/Twist", nothing, self._vector(w))
            yield "/flightapp/command/rates", rates, stamp, self._new(rates, header, twist)
            accel = self._new("geometry_msgs/msg/Accel", self._vector([0.0, 0.0, thrust]), nothing)
            yield "/flightapp/command/thrust", force, stamp, self._new(force, header, accel)

    def _imu(self, flight: Flight) -> Iterator[Message]:
        m, kind = flight.imu, "sensor_msgs/msg/Imu"
        none, unknown = (
            np.concatenate(((-1.0,), np.zeros(8))),
            np.zeros(9),
        )  # REP 145: -1 says that there is no orientation
        level = self._turn([1.0, 0.0, 0.0, 0.0])
        rows = zip(m.stamp.tolist(), m.specific_force.tolist(), m.angular_velocity.tolist(), strict=True)
        for stamp, f, w in rows:
            turning, felt = self._vector(w), self._vector(f)
            message = self._new(kind, self._header(stamp, "body"), level, none, turning, unknown, felt, unknown)
            yield "/flightapp/imu", kind, stamp, message

    def _gates(self, flight: Flight) -> Iterator[Message]:
        for found in flight.maps:
            yield self._array("/flightapp/gates", found.stamp, found.gates)
        if flight.true_gates:
            first = float(flight.truth.stamp[0]) if flight.has_truth else 0.0
            yield self._array("/flightapp/gates/true", first, flight.true_gates[-1])

    def _array(self, topic: str, stamp: float, gates: Iterable[GateEstimate]) -> Message:
        kind = "geometry_msgs/msg/PoseArray"
        poses = [self._pose(gate.position.tolist(), from_yaw(np.array(gate.yaw)).tolist()) for gate in gates]
        return topic, kind, stamp, self._new(kind, self._header(stamp, "world"), poses)

    def _rest(self, flight: Flight) -> Iterator[Message]:
        log, battery, nan = "rcl_interfaces/msg/Log", "sensor_msgs/msg/BatteryState", float("nan")
        for event in flight.events:
            level = self._types[log].WARN if event.kind == "fault" else self._types[log].INFO
            said = self._new(log, self._time(event.stamp), level, event.kind, event.text, "", "", 0)
            yield "/flightapp/events", log, event.stamp, said
        cells = np.zeros(0, np.float32)
        for status in flight.statuses:
            measured = (status.voltage, nan, nan, nan, nan, nan, status.battery, 0, 0, 0, True, cells, cells, "", "")
            told = self._new(battery, self._header(status.stamp, "body"), *measured)
            yield "/flightapp/battery", battery, status.stamp, told

    def _transforms(self, flight: Flight) -> Iterator[Message]:
        kind, states = "tf2_msgs/msg/TFMessage", flight.states
        rows = zip(states.stamp.tolist(), states.position.tolist(), _oriented(states).tolist(), strict=True)
        for stamp, p, q in rows:
            motion = self._new("geometry_msgs/msg/Transform", self._vector(p), self._turn(q))
            header = self._header(stamp, "world")
            moved = self._new("geometry_msgs/msg/TransformStamped", header, "body", motion)
            yield "/tf", kind, stamp, self._new(kind, [moved])


def _oriented(motion: Motions) -> Vector:
    """(n, 4), level where no orientation was recorded."""
    n = motion.stamp.size
    return motion.orientation if len(motion.orientation) == n else np.tile((1.0, 0.0, 0.0, 0.0), (n, 1))


def _diagonal(first: Row, second: Row) -> Vector:
    """(36,) of a covariance (6, 6) with nothing but its diagonal."""
    covariance = np.zeros(36)
    covariance[::7] = (*first, *second)
    return covariance
