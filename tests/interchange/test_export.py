"""What is exported is opened by the field's own tools, and says the same."""

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import synthetic_flight as synthetic
from evo.tools import file_interface
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from flightapp.evaluation.flight import Inertial, Poses, Stages
from flightapp.evaluation.rotations import from_yaw, rotate
from flightapp.inputs import BadInputError
from flightapp.interchange import export as exporting
from flightapp.interchange.bag_writer import nanoseconds, write_bag
from flightapp.interchange.export import Format, export
from flightapp.interchange.sources import paths_in, read_path
from flightapp.interchange.text_files import write_csv, write_tum
from flightapp.messages import AutopilotStatus, FlightMode, Stage
from flightapp.sensors.pose_files import read_poses


@pytest.fixture(scope="module")
def flight():
    made = synthetic.flight()
    rng, n = np.random.default_rng(5), 300
    stamp = 3.0 + np.arange(n) * 0.005
    turned = from_yaw(rng.uniform(-3.0, 3.0, n))
    velocity, turning = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    moving = (stamp, rng.normal(size=(n, 3)), turned, velocity, turning)
    poses = Poses(*moving, np.full(n, 3, np.uint32), rng.normal(size=(n, 3)), np.full(n, 1, np.uint32))
    states = dataclasses.replace(
        made.states, orientation=from_yaw(0.3 * made.states.stamp), angular_velocity=0.1 * made.states.velocity
    )
    imu = Inertial(stamp, rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))
    stages = Stages(stamp, np.full(n, Stage.COMMAND, np.uint32), stamp - 0.02, stamp - 0.01)
    status = AutopilotStatus(1.0, FlightMode.OFFBOARD, True, False, True, 15.5, 0.75)
    return dataclasses.replace(made, poses=poses, states=states, imu=imu, stages=stages, statuses=(status,))


@pytest.fixture(scope="module")
def bag(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "bag"
    write_bag(flight, path)
    return path


def read(bag):
    """Every message of a bag by topic, with its time."""
    found = {}
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time, message))
    return found


def test_a_bag_has_every_stream_with_stamps_and_frames(flight, bag):
    found = read(bag)
    sizes = {
        "/flightapp/state": flight.states.stamp.size,
        "/flightapp/truth": flight.truth.stamp.size,
        "/flightapp/pose": flight.poses.stamp.size,
        "/flightapp/setpoint": flight.setpoints.stamp.size,
        "/flightapp/command/rates": flight.commands.stamp.size,
        "/flightapp/command/thrust": flight.commands.stamp.size,
        "/flightapp/imu": flight.imu.stamp.size,
        "/flightapp/gates": len(flight.maps),
        "/flightapp/gates/true": 1,
        "/flightapp/events": len(flight.events),
        "/flightapp/battery": 1,
        "/tf": flight.states.stamp.size,
    }
    assert {topic: len(messages) for topic, messages in found.items()} == sizes
    for topic, messages in found.items():
        for time, message in messages:
            header = getattr(message, "header", None) or (message.transforms[0].header if topic == "/tf" else None)
            if header is not None:
                assert header.stamp.sec * 10**9 + header.stamp.nanosec == time
    i, (time, state) = 700, found["/flightapp/state"][700]
    assert time == nanoseconds(flight.states.stamp[i])
    assert (state.header.frame_id, state.child_frame_id) == ("world", "body")
    place, q = state.pose.pose.position, state.pose.pose.orientation
    assert (place.x, place.y, place.z) == tuple(flight.states.position[i])
    assert (q.w, q.x, q.y, q.z) == tuple(flight.states.orientation[i])
    v = state.twist.twist.linear  # in body axes: turned back it is the world's
    back = rotate(flight.states.orientation[i], np.array((v.x, v.y, v.z)))
    assert np.allclose(back, flight.states.velocity[i])
    assert state.pose.covariance[0] == flight.states.variance[i, 0]
    assert found["/flightapp/pose"][0][1].header.frame_id == "odom"
    rates, thrust = found["/flightapp/command/rates"][9][1], found["/flightapp/command/thrust"][9][1]
    assert rates.twist.angular.y == flight.commands.rates[9, 1]
    assert thrust.accel.linear.z == flight.commands.thrust[9]
    assert found["/flightapp/imu"][3][1].linear_acceleration.x == flight.imu.specific_force[3, 0]
    assert [pose.position.x for pose in found["/flightapp/gates/true"][0][1].poses] == [g[0] for g in synthetic.GATES]
    assert [m.msg for _, m in found["/flightapp/events"]] == [event.text for event in flight.events]


def test_a_bag_opens_with_mcap_and_its_paths_come_back(flight, bag):
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert {schema.name for schema in summary.schemas.values()} >= {"nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"}
    for source in (bag, file):
        paths = paths_in(source)
        streams = {"/flightapp/truth": flight.truth, "/flightapp/state": flight.states, "/flightapp/pose": flight.poses}
        assert set(paths) == {*streams, "/flightapp/setpoint", "/tf:world.body"}
        for name, motion in streams.items():
            assert np.allclose(paths[name].stamp, motion.stamp, atol=1e-9)
            assert np.array_equal(paths[name].position, motion.position)
            assert np.allclose(paths[name].orientation, motion.orientation, atol=1e-15)
        assert np.array_equal(paths["/tf:world.body"].position, flight.states.position)
    assert read_path(f"{bag}:/tf:world.body").stamp.size == flight.states.stamp.size


def test_evo_reads_the_bag(flight, bag):
    with Reader(bag) as reader:
        theirs = file_interface.read_bag_trajectory(reader, "/flightapp/state")
    assert np.allclose(theirs.timestamps, flight.states.stamp, atol=1e-9)
    assert np.array_equal(theirs.positions_xyz, flight.states.position)
    assert theirs.meta["frame_id"] == "world"


def test_a_bag_of_somebody_elses_making_is_read(tmp_path):
    """PoseStamped in sqlite, out of order, one stamp twice, orientations left zero."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    t = store.types
    kind = "geometry_msgs/msg/PoseStamped"
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/vrpn/drone/pose", kind, typestore=store)
        for second in (5, 4, 6, 6):
            header = t["std_msgs/msg/Header"](t["builtin_interfaces/msg/Time"](second, 500_000_000), "map")
            point, q = (
                t["geometry_msgs/msg/Point"](float(second), 0.0, 1.0),
                t["geometry_msgs/msg/Quaternion"](0, 0, 0, 0),
            )
            message = t[kind](header, t["geometry_msgs/msg/Pose"](point, q))
            writer.write(connection, second * 10**9, store.serialize_cdr(message, kind))
    path = read_path(str(tmp_path / "bag"))
    assert path.stamp.tolist() == [4.5, 5.5, 6.5]
    assert path.position[:, 0].tolist() == [4.0, 5.0, 6.0]
    assert path.orientation is None


def test_tum_files_open_in_evo(flight, tmp_path):
    written = write_tum(flight, tmp_path)
    assert [path.name for path in written] == ["truth.tum", "state.tum", "pose.tum", "setpoint.tum"]
    for name, motion in (("truth", flight.truth), ("state", flight.states), ("pose", flight.poses)):
        theirs = file_interface.read_tum_trajectory_file(str(tmp_path / f"{name}.tum"))
        assert np.allclose(theirs.timestamps, motion.stamp, atol=1e-9)
        assert np.array_equal(theirs.positions_xyz, motion.position)
        assert np.allclose(theirs.orientations_quat_wxyz, motion.orientation, atol=1e-15)
        assert np.array_equal(read_path(str(tmp_path / f"{name}.tum")).position, motion.position)


def test_csv_files_hold_every_stream_and_lead_back(flight, tmp_path):
    written = {path.stem: path for path in write_csv(flight, tmp_path)}
    expected = {"state", "truth", "pose", "setpoint", "command", "imu", "gates", "true_gates", "events", "plans"}
    assert set(written) == expected | {"status", "passages", "collisions", "stages"}
    back = read_poses(written["pose"]).poses
    for field in dataclasses.fields(back):
        assert np.array_equal(getattr(back, field.name), getattr(flight.poses, field.name)), field.name
    with written["command"].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["thrust"]) for row in rows] == flight.commands.thrust.tolist()
    assert [float(row["wy"]) for row in rows] == flight.commands.rates[:, 1].tolist()
    with written["events"].open(encoding="utf-8", newline="") as file:
        assert [row["text"] for row in csv.DictReader(file)] == [event.text for event in flight.events]
    with written["status"].open(encoding="utf-8", newline="") as file:
        assert list(csv.reader(file))[1] == ["1.0", "offboard", "1", "0", "1", "15.5", "0.75"]


def test_an_export_never_overwrites(flight, tmp_path, monkeypatch):
    monkeypatch.setattr(exporting, "read_any_flight", lambda run: flight)
    first = export(tmp_path, Format.TUM, None)
    assert first == tmp_path / "tum"
    with pytest.raises(BadInputError, match="exists; name a new directory"):
        export(tmp_path, Format.TUM, None)
    (tmp_path / "empty").mkdir()
    assert (export(tmp_path, Format.ROSBAG2, tmp_path / "empty") / "metadata.yaml").is_file()
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="exists"):
        export(tmp_path, Format.CSV, tmp_path / "file")


def test_a_damaged_bag_is_refused_in_words(bag, tmp_path):
    (file,) = bag.glob("*.mcap")
    data = file.read_bytes()
    for name, content in (("cut.mcap", data[: len(data) // 2]), ("x.db3", b"hello"), ("y.mcap", b"hello")):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(BadInputError, match=name):
            paths_in(path)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("nothing: here\n")
    with pytest.raises(BadInputError, match="cannot be read as a ROS 2 bag"):
        paths_in(tmp_path / "bag")
    with pytest.raises(BadInputError, match="no such file"):
        paths_in(Path("nowhere.ulg"))
