"""The rig of a real vehicle."""

import asyncio
import socket

import cv2
import numpy as np
import pytest
from fakes import virtually

from flightapp import rigs
from flightapp.channel import Topic
from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.messages import PoseSample
from flightapp.rigs import Px4Rig, SelfPositionedLink, TopicPoses
from flightapp.sensors.intake import PoseFault, PoseIntake
from flightapp.sensors.poses import SocketPoses
from flightapp.sensors.replay import ReplayPoses
from flightapp.track import Gate, Start, Track
from sim.remote import MavlinkRig
from sim.rig import SimRig

OPEN = Track(name="open", start=Start(position=(0.0, 0.0, 0.0)), waypoints=((1.0, 0.0, 1.0),))
GATED = Track(
    name="gated",
    start=Start(position=(0.0, 0.0, 0.0)),
    gates=(Gate(id=1, position=(4.0, 0.0, 1.2), yaw_deg=0.0, markers=(1, 2, 3, 4)),),
)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def settings(*more):
    return load_config(None, None, [f"link.connection=udpin://127.0.0.1:{free_port()}", *more])


def pose(stamp):
    return PoseSample(stamp, np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3), np.zeros(3), 3)


async def test_gates_need_a_camera():
    with pytest.raises(BadInputError, match=r"'gated' has gates.*camera\.source is empty"):
        Px4Rig(settings(), GATED, 0)
    with pytest.raises(BadInputError, match="/dev/video99"):
        Px4Rig(settings("camera.source=/dev/video99"), GATED, 0)


async def test_gates_are_flown_with_a_camera(tmp_path):
    for i in range(2):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.full((480, 640), 40 * i, np.uint8))
    path = tmp_path / "poses"
    rig = Px4Rig(settings(f"camera.source={tmp_path}", f"sensors.pose_address={path}"), GATED, 0)
    images = [frame.image async for frame in rig.camera.frames()]
    assert [image.mean() for image in images] == [0.0, 40.0]
    await rig.autopilot.close()
    await rig.close()


async def test_a_camera_that_is_missing_leaves_nothing_behind(tmp_path):
    path = tmp_path / "poses"
    with pytest.raises(BadInputError, match="no such file or directory"):
        Px4Rig(settings("camera.source=nowhere.mp4", f"sensors.pose_address={path}"), GATED, 0)
    assert not path.exists()


async def test_poses_from_a_socket_and_no_frames(tmp_path):
    path = tmp_path / "poses"
    rig = Px4Rig(settings(f"sensors.pose_address={path}"), OPEN, 0)
    assert isinstance(rig.tracker, SocketPoses)
    assert path.is_socket()
    assert rig.survey(OPEN) is OPEN
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.05):
            async for _ in rig.camera.frames():
                pass
    await rig.autopilot.close()
    await rig.close()
    assert not path.exists()


async def test_poses_from_a_file(tmp_path):
    path = tmp_path / "poses.tum"
    path.write_text("1.0 0 0 0 0 0 0 1\n1.1 0.1 0 0 0 0 0 1\n", encoding="utf-8")
    rig = Px4Rig(settings("sensors.poses=replay", f"sensors.replay={path}"), OPEN, 0)
    assert isinstance(rig.tracker, ReplayPoses)
    assert [round(sample.position[0], 3) async for sample in rig.tracker.poses()] == [0.0, 0.1]
    await rig.autopilot.close()
    await rig.close()


def test_a_replay_needs_its_file():
    with pytest.raises(BadInputError, match=r"sensors\.replay"):
        load_config(None, None, ["sensors.poses=replay"])


async def test_a_t265_needs_its_library():
    with pytest.raises(BadInputError, match="t265_bridge"):
        Px4Rig(settings("sensors.poses=realsense"), OPEN, 0)


async def test_a_link_that_cannot_be_opened_leaves_no_socket_behind(tmp_path):
    path = tmp_path / "poses"
    config = load_config(None, None, ["link.connection=udpin://nowhere", f"sensors.pose_address={path}"])
    with pytest.raises(BadInputError, match="nowhere"):
        Px4Rig(config, OPEN, 0)
    assert not path.exists()


async def test_the_autopilots_own_position_is_never_fed_back_to_it(monkeypatch):
    made = []

    class Link(SelfPositionedLink):
        def __init__(self, config):
            made.append(self)
            self.odometry = Topic("pose")

        def _post(self, message):
            raise AssertionError("something was sent")

    monkeypatch.setattr(rigs, "SelfPositionedLink", Link)
    rig = Px4Rig(settings("sensors.poses=autopilot"), OPEN, 0)
    assert rig.autopilot is made[0]
    loop = asyncio.get_running_loop()
    stamp = loop.time()
    loop.call_soon(made[0].odometry.publish, pose(stamp - 10.0))
    loop.call_later(0.01, made[0].odometry.publish, pose(stamp))
    got = await anext(rig.tracker.poses())
    assert got.stamp == stamp
    assert rig.tracker.intake.refused[PoseFault.STALE] == 1
    rig.autopilot.send_pose(got)
    await rig.close()


async def test_topic_poses_skip_to_the_newest():
    topic = Topic("pose")
    poses = TopicPoses(topic, PoseIntake.of_body(load_config())).poses()
    first = asyncio.ensure_future(anext(poses))
    await asyncio.sleep(0)
    now = asyncio.get_running_loop().time()
    for stamp in (now - 0.03, now - 0.02, now - 0.01):
        topic.publish(pose(stamp))
    assert (await first).stamp == now - 0.01
    topic.publish(pose(now))
    assert (await anext(poses)).stamp == now


def test_faults_of_the_link_need_a_link():
    async def main():
        with pytest.raises(BadInputError, match="--mavlink"):
            SimRig(load_config(None, None, ["sim.faults=[[1.0, 'silence', 1.0]]"]), OPEN, 0)

    virtually(main())


@pytest.mark.parametrize("connection", ["serial:///dev/ttyTHS1:921600", "udpin://10.0.0.3:14540"])
async def test_the_simulated_vehicle_is_on_this_computer(connection):
    with pytest.raises(BadInputError, match="on this computer"):
        MavlinkRig(load_config(None, None, [f"link.connection={connection}"]), OPEN, 0)
