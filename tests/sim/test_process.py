"""The simulated world in its own process, and its rig."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from processes import ended, wait_until

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.messages import Collision, CommandArrivals, GatePassage, GroundTruth, MarkerDetection
from flightapp.sensors.intake import PoseIntake
from flightapp.sensors.poses import SocketPoses
from flightapp.track import Gate, Start, Track
from sim.clock import RealtimeLoop
from sim.orders import Order
from sim.outbox import Outbox
from sim.remote import RemoteCamera, RemoteTruth, RemoteWorld, WorldEndedError, drain
from sim.ring import SLOTS, FrameRing
from sim.wire import Notice, pack_arrivals, pack_motions, pack_notice, pack_verdict, unpack_notice, unpack_truth

TRACK = Track(
    name="near",
    start=Start(position=(0.0, 0.0, 0.0)),
    gates=(Gate(id=7, position=(4.0, 0.0, 1.2), yaw_deg=0.0, markers=(1, 2, 3, 4)),),
)
CONFIG = load_config(None, None, ["camera.width=160", "camera.height=120", "camera.focal=[80.0, 80.0, 79.5, 59.5]"])


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def order(config=CONFIG):
    origin = time.monotonic() - asyncio.get_running_loop().time()
    return Order(config, TRACK, 3, origin, ("127.0.0.1", free_port()))


def left_open():
    """Named shared memory, and this process's file descriptors."""
    return sorted(p.name for place in ("/dev/shm", "/proc/self/fd") for p in Path(place).iterdir())


def on_the_wall(coroutine):
    with asyncio.Runner(loop_factory=RealtimeLoop) as runner:
        return runner.run(coroutine)


def test_poses_images_and_truth_arrive_with_the_applications_stamps():
    async def main():
        before = left_open()
        world = RemoteWorld(order())
        poses = SocketPoses(world.poses, PoseIntake.of_body(CONFIG))
        camera, truth = RemoteCamera(CONFIG, world), RemoteTruth(world)
        loop = asyncio.get_running_loop()
        ages, frames = [], []

        async def follow(source, arrivals):
            async for message in source:
                arrivals.append((loop.time() - message.stamp, message))

        tasks = [asyncio.create_task(follow(*line)) for line in ((poses.poses(), ages), (camera.frames(), frames))]
        await asyncio.sleep(0.5)
        ages.clear()
        frames.clear()
        truth.feed.motion.count = 0
        await asyncio.sleep(1.0)
        counts = len(ages), len(frames), truth.feed.motion.count
        state = world.state()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        truth.close()
        poses.close()
        world.close()
        after = left_open()
        return counts, ages, frames, truth.feed.motion.latest, state, before == after, world.process_id

    counts, ages, frames, motion, state, nothing_left, process_id = on_the_wall(main())
    assert counts[0] > 120, "of 200 poses a second"
    assert counts[1] > 20, "of 30 frames a second"
    assert 180 <= counts[2] <= 220, "no truth is lost"
    # Younger than its latency a sample cannot be, unless the clocks differ.
    assert 0.004 <= np.median([age for age, _ in ages]) < 0.05
    assert CONFIG.camera.latency <= np.median([age for age, _ in frames]) < 0.1
    pose, frame = ages[-1][1], frames[-1][1]
    assert np.linalg.norm(pose.position - motion.position) < 0.05
    assert abs(motion.stamp - pose.stamp) < 0.3
    assert frame.image.shape == (120, 160)
    assert frame.image.std() > 5.0, "there is something to be seen"
    sequences = [f.sequence for _, f in frames]
    assert sequences == sorted(set(sequences))
    assert not state.armed
    assert abs(state.motion.position[2]) < 0.05
    assert nothing_left
    assert ended(process_id)


def test_the_process_ends_with_its_parent():
    code = (
        "import asyncio, os, sys, time\n"
        "sys.path[:0] = os.environ['TESTS'].split(':')\n"
        "from test_process import RemoteWorld, on_the_wall, order\n"
        "async def main():\n"
        "    world = RemoteWorld(order())\n"
        "    print(world.process_id, flush=True)\n"
        "    time.sleep(60)\n"
        "on_the_wall(main())\n"
    )
    environment = os.environ | {"TESTS": ":".join(map(str, Path(__file__).parents[:2]))}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment) as parent:
        child = int(parent.stdout.readline())
        assert not ended(child)
        parent.kill()
        parent.wait()
        wait_until(lambda: ended(child))


def test_requests_signals_and_death():
    async def main():
        world = RemoteWorld(order())
        try:
            # What ends the application must not end its world: it lands first.
            for number in (signal.SIGINT, signal.SIGTERM):
                os.kill(world.process_id, number)
            assert os.getpgid(world.process_id) != os.getpgid(0), "a terminal's ^C does not reach it"
            with pytest.raises(BadInputError, match="earthquake"):
                world.fault("earthquake", 1.0)
            world.fault("silence", 0.1)
            assert world.failure() is None
            camera = RemoteCamera(CONFIG, world)
            os.kill(world.process_id, signal.SIGKILL)
            with pytest.raises(WorldEndedError, match="exit status -9"):
                async for _ in camera.frames():
                    pass
            with pytest.raises(WorldEndedError, match="exit status -9"):
                world.state()
        finally:
            world.close()

    on_the_wall(main())


@pytest.mark.parametrize(
    ("changes", "told"),
    [({"vehicle": "zeppelin"}, "zeppelin"), ({"faults": ((1.0, "earthquake", 1.0),)}, "earthquake")],
)
def test_what_the_world_cannot_do_is_told_at_its_start(changes, told):
    async def main():
        with pytest.raises(BadInputError, match=told):
            RemoteWorld(order(CONFIG.model_copy(update={"sim": CONFIG.sim.model_copy(update=changes)})))

    on_the_wall(main())


def test_notices_and_truth_survive_the_wire():
    corners = np.arange(8.0).reshape(4, 2)
    notice = Notice(1.5, 12, 4, (MarkerDetection(3, corners), MarkerDetection(9, corners + 0.5)))
    got = unpack_notice(pack_notice(notice))
    assert (got.stamp, got.sequence, got.slot) == (1.5, 12, 4)
    assert [(m.marker_id, m.corners.tolist()) for m in got.markers] == [
        (3, corners.tolist()),
        (9, (corners + 0.5).tolist()),
    ]
    assert unpack_notice(pack_notice(Notice(1.0, 2, 0))) == Notice(1.0, 2, 0)
    for verdict in (GatePassage(2.0, 7, 0.25), Collision(3.0, "gate 7 – frame", 1.5)):
        assert list(unpack_truth(pack_verdict(verdict))) == [verdict]
    (arrivals,) = unpack_truth(pack_arrivals(CommandArrivals(2.0, np.array((1.5, 1.75)))))
    assert (arrivals.stamp, arrivals.stamps.tolist()) == (2.0, [1.5, 1.75])
    motions = [
        GroundTruth(t, np.full(3, t), np.array((1.0, 0.0, 0.0, t)), np.full(3, -t), np.full(3, 2 * t))
        for t in (1.0, 2.0)
    ]
    back = list(unpack_truth(pack_motions(motions)))
    assert [m.stamp for m in back] == [1.0, 2.0]
    for a, b in zip(motions, back, strict=True):
        for name in ("position", "orientation", "velocity", "angular_velocity"):
            assert np.array_equal(getattr(a, name), getattr(b, name)), name


def test_a_ring_tells_who_comes_too_late():
    ring = FrameRing.make(8, 4)
    images = [np.full((4, 8), k, np.uint8) for k in range(SLOTS + 1)]
    slots = [ring.write(k, image) for k, image in enumerate(images[:SLOTS])]
    assert np.array_equal(ring.read(slots[0], 0), images[0])
    kept = ring.read(slots[1], 1)
    assert ring.write(SLOTS, images[SLOTS]) == slots[0]
    assert ring.read(slots[0], 0) is None
    assert np.array_equal(ring.read(slots[0], SLOTS), images[SLOTS])
    ring.write(SLOTS + 1, images[0])
    assert np.array_equal(kept, images[1]), "a copy, which later images leave alone"
    ring.close()


def test_an_outbox_never_waits_and_loses_the_oldest():
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    there.setblocking(False)
    here.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    outbox = Outbox(here, 3)
    for k in range(100):
        outbox.send(b"%03d" % k)
    taken = drain(there)
    assert 0 < len(taken) < 90
    assert outbox.lost == 100 - 3 - len(taken)
    outbox.send(b"last")
    assert taken + drain(there) == [b"%03d" % k for k in range(len(taken))] + [b"097", b"098", b"099", b"last"]
    there.close()
    outbox.send(b"to nobody")
    outbox.close()
