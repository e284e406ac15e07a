"""ROS 2 bags: their paths, by topic."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightapp.evaluation.paths import TimedPath
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.interchange.extra import load

Row = tuple[str, float, Any]
"""Where it goes (behind the topic's name), stamp in s, and a pose or a transform."""
SMALLEST = 0.5
"""Length of the shortest quaternion that is one; some programs leave those that they do not know zero."""


def is_bag(path: Path) -> bool:
    """Whether ``path`` is a directory that ROS 2 recorded into."""
    return (path / "metadata.yaml").is_file()


def bag_paths(path: Path) -> dict[str, TimedPath]:
    """Every path in the bag ``path``, a directory or one of its files; raises `BadInputError`.

    Topics of nav_msgs/Odometry, geometry_msgs/PoseStamped, PoseWithCovarianceStamped and TransformStamped by their
    names, each transform of tf2_msgs/TFMessage as "TOPIC:PARENT.CHILD", by the stamps in their headers. What is in no
    header's time order is put in order; of poses with the same stamp the first counts.
    """
    load("rosbags", "reading a ROS 2 bag")
    highlevel = load("rosbags.highlevel", "reading a ROS 2 bag")
    typesys = load("rosbags.typesys", "reading a ROS 2 bag")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    rows: dict[str, list[Row]] = defaultdict(list)
    try:
        with highlevel.AnyReader([path], default_typestore=store) as reader:
            wanted = [connection for connection in reader.connections if connection.msgtype in _READERS]
            for connection, _, data in reader.messages(connections=wanted) if wanted else ():
                message = reader.deserialize(data, connection.msgtype)
                for row in _READERS[connection.msgtype](message):
                    rows[connection.topic + row[0]].append(row)
        return {name: _path(name, found) for name, found in rows.items()}
    except Exception as error:  # the library raises whatever a damaged file makes it run into
        raise BadInputError(f"{path}: cannot be read as a ROS 2 bag: {error or type(error).__name__}") from None


def _stamp(header: Any) -> float:
    return float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)


def _transformed(message: Any) -> Row:
    transform = message.transform
    return f":{message.header.frame_id}.{message.child_frame_id}", _stamp(message.header), transform


def _one(pose: Callable[[Any], Any]) -> Callable[[Any], Iterator[Row]]:
    def read(message: Any) -> Iterator[Row]:
        yield "", _stamp(message.header), pose(message)

    return read


_READERS: Mapping[str, Callable[[Any], Iterator[Row]]] = {
    "nav_msgs/msg/Odometry": _one(lambda message: message.pose.pose),
    "geometry_msgs/msg/PoseStamped": _one(lambda message: message.pose),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _one(lambda message: message.pose.pose),
    "geometry_msgs/msg/TransformStamped": _one(lambda message: message.transform),
    "tf2_msgs/msg/TFMessage": lambda message: map(_transformed, message.transforms),
}


def _path(name: str, rows: list[Row]) -> TimedPath:
    stamps = np.array([stamp for _, stamp, _ in rows])
    order = np.argsort(stamps, kind="stable")
    order = order[np.diff(stamps[order], prepend=-np.inf) > 0.0]
    table = np.array([_numbers(pose) for _, _, pose in rows])[order]
    position, q = table[:, :3], table[:, 3:]
    length = np.linalg.norm(q, axis=1)
    known = bool(np.all(length > SMALLEST))
    return TimedPath(name, stamps[order], position, q / length[:, None] if known else None)


def _numbers(pose: Any) -> Vector:
    """x, y, z, then w, x, y, z of a geometry_msgs Pose or Transform."""
    place = pose.position if hasattr(pose, "position") else pose.translation
    turn = pose.orientation if hasattr(pose, "orientation") else pose.rotation
    return np.array((place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z))
