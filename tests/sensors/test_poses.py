"""Poses over local sockets."""

import asyncio
import math
import socket
import time

import numpy as np
import pytest

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.messages import PoseSample
from flightapp.sensors.address import parse_address
from flightapp.sensors.intake import PoseFault, PoseIntake
from flightapp.sensors.poses import POSE_RECORD, DatagramCounts, SocketPoses, encode_pose
from flightapp.timing import monotonic_origin
from sim.clock import RealtimeLoop

PLACE = np.array((1.0, -2.0, 3.0))
TURNED = np.array((math.cos(0.3), 0.0, math.sin(0.3), 0.0))


def intake(max_age=0.1):
    return PoseIntake(load_config(None, None, [f"sensors.pose_max_age={max_age}"]))


def make(stamp, **changes):
    fields = {
        "position": PLACE,
        "orientation": TURNED,
        "velocity": np.array((0.1, 0.2, 0.3)),
        "angular_velocity": np.array((-1.0, 0.5, 0.25)),
        "confidence": 3,
        "acceleration": np.array((0.5, -0.5, 0.25)),
        "epoch": 7,
    }
    return PoseSample(stamp, **(fields | changes))


@pytest.fixture
async def line():
    """A source, the other end of its socket, and the loop's origin by CLOCK_MONOTONIC."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    source = SocketPoses(here, intake())
    yield source, there, monotonic_origin(asyncio.get_running_loop())
    source.close()
    there.close()


async def soon(source, wait=0.2):
    """The next sample; None if none comes."""
    samples = source.poses()
    try:
        async with asyncio.timeout(wait):
            return await anext(samples)
    except TimeoutError:
        return None
    finally:
        await samples.aclose()


async def test_a_record_arrives_as_it_was_measured(line):
    source, there, origin = line
    sent = make(asyncio.get_running_loop().time())
    there.send(encode_pose(sent, origin))
    got = await soon(source)
    assert abs(got.stamp - sent.stamp) < 1e-5
    for name in ("position", "orientation", "velocity", "angular_velocity", "acceleration"):
        np.testing.assert_allclose(getattr(got, name), getattr(sent, name), rtol=1e-15, err_msg=name)
        # What later steps are compiled for.
        assert getattr(got, name).flags.writeable
        assert getattr(got, name).dtype == np.float64
    assert (got.confidence, got.epoch) == (3, 0)
    assert source.counts == DatagramCounts(delivered=1)
    assert source.intake.taken == 1


async def test_what_the_tracker_does_not_tell_is_none(line):
    source, there, origin = line
    there.send(encode_pose(make(asyncio.get_running_loop().time(), acceleration=None), origin))
    assert (await soon(source)).acceleration is None


def test_the_record_is_what_its_text_says():
    data = encode_pose(make(2.0, confidence=1), 40.0)
    assert len(data) == 152 == POSE_RECORD.itemsize
    assert data[:16] == b"POSE\x02\0\x01\0\x07" + 7 * b"\0"
    numbers = [42.0, 1, -2, 3, *TURNED, 0.1, 0.2, 0.3, -1.0, 0.5, 0.25, 0.5, -0.5, 0.25]
    assert np.array_equal(np.frombuffer(data[16:]), numbers)


def test_stamps_become_the_loops_own_time():
    async def main():
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        source = SocketPoses(here, intake(1.0))
        captured = time.monotonic()
        there.send(encode_pose(make(captured), 0.0))
        got = await soon(source)
        now = asyncio.get_running_loop().time()
        source.close()
        there.close()
        return now - got.stamp, time.monotonic() - captured, now

    with asyncio.Runner(loop_factory=lambda: RealtimeLoop(time.monotonic() - 7.0)) as runner:
        age, elapsed, now = runner.run(main())
    assert 7.0 <= now < 8.0
    assert 0.0 <= age <= elapsed


async def test_the_newest_is_taken_and_the_rest_skipped(line):
    source, there, origin = line
    now = asyncio.get_running_loop().time()
    for k in range(5):
        there.send(encode_pose(make(now - 0.05 + 0.01 * k, position=np.full(3, 0.01 * k)), origin))
    got = await soon(source)
    assert got.position[0] == 0.04
    assert await soon(source, 0.02) is None
    assert source.counts == DatagramCounts(delivered=1, skipped=4)


@pytest.mark.parametrize(
    ("fault", "changes"),
    [
        (PoseFault.NOT_FINITE, {"position": np.array((0.0, math.nan, 0.0))}),
        (PoseFault.NOT_FINITE, {"acceleration": np.array((0.0, math.nan, 0.0))}),
        (PoseFault.NOT_FINITE, {"stamp": math.nan}),
        (PoseFault.NOT_UNIT, {"orientation": 1.01 * TURNED}),
        (PoseFault.STALE, {"stamp": -0.15}),
        (PoseFault.FUTURE, {"stamp": 0.05}),
        (PoseFault.LOST, {"confidence": 0}),
    ],
)
async def test_what_the_intake_refuses_does_not_come(line, fault, changes):
    source, there, origin = line
    stamp = asyncio.get_running_loop().time() + changes.pop("stamp", 0.0)
    there.send(encode_pose(make(stamp, **changes), origin))
    assert await soon(source, 0.02) is None
    assert source.counts == DatagramCounts()
    assert source.intake.refused[fault] == 1


@pytest.mark.parametrize("length", [0, 1, 15, 17, 151, 153, 5000])
async def test_other_lengths_are_malformed(line, length):
    source, there, origin = line
    record = encode_pose(make(asyncio.get_running_loop().time()), origin)
    there.send((record * 50)[:length])
    assert await soon(source, 0.02) is None
    assert source.counts == DatagramCounts(malformed=1)


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("malformed", lambda data: b"PASE" + data[4:]),
        ("malformed", lambda data: data[:6] + b"\x04" + data[7:]),
        ("other_version", lambda data: data[:4] + b"\x03" + data[5:]),
        ("other_version", lambda data: data[:4] + b"\x03" + data[5:] + bytes(8)),
        # Version 1: stamp first, no magic, no acceleration, confidence last.
        ("other_version", lambda data: data[16:128] + b"\x03\0\0\0"),
    ],
)
async def test_records_of_others_are_told_apart_and_not_misread(line, what, change):
    source, there, origin = line
    there.send(change(encode_pose(make(asyncio.get_running_loop().time()), origin)))
    assert await soon(source, 0.02) is None
    assert source.counts == DatagramCounts(**{what: 1})
    assert source.intake.taken == 0


async def test_a_flood_of_random_datagrams_lets_the_good_ones_through(line):
    source, there, origin = line
    loop, rng = asyncio.get_running_loop(), np.random.default_rng(20002)
    there.setblocking(False)
    got, good, sent = [], 0, 0

    async def follow():
        async for sample in source.poses():
            got.append(sample.position)  # noqa: PERF401  # one by one, as they come

    task = asyncio.create_task(follow())
    template = encode_pose(make(0.0), 0.0)
    noise = rng.integers(0, 256, 400_000, np.uint8).tobytes()
    places, sizes = rng.integers(0, 390_000, 101_000).tolist(), rng.integers(0, 400, 101_000).tolist()
    while sent < 100_000:
        for _ in range(200):
            begin, size = places[sent], sizes[sent]
            junk = noise[begin : begin + size]
            if sent % 3 == 0:  # a record whose head is right, and the rest random
                junk = template[:16] + noise[begin : begin + 136]
            try:
                there.send(junk)
            except BlockingIOError:
                break
            sent += 1
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        there.send(encode_pose(make(loop.time(), position=PLACE + 1e-6 * good), origin))
        good += 1
        await asyncio.sleep(0.0005)
    await asyncio.sleep(0.02)
    task.cancel()
    assert np.abs(np.array(got) - PLACE).max() < 0.1
    counts = source.counts
    assert counts.delivered == len(got)
    assert counts.delivered + counts.skipped > 0.5 * good
    everything = counts.malformed + counts.other_version + source.intake.taken + sum(source.intake.refused.values())
    assert everything == sent + good


async def test_a_sender_that_ends_and_another_that_begins(tmp_path):
    path = tmp_path / "poses"
    source = SocketPoses.at(str(path), intake(1.0))
    loop = asyncio.get_running_loop()
    origin = monotonic_origin(loop)
    for epoch, away in ((1, 0.0), (2, 50.0), (3, -50.0)):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(encode_pose(make(loop.time(), epoch=epoch, position=np.full(3, away)), origin), str(path))
            got = await soon(source)
        assert (got.position[0], got.epoch) == (away, epoch - 1)
    source.close()


async def test_out_of_order_and_repeated_samples_do_not_come(line):
    source, there, origin = line
    now = asyncio.get_running_loop().time()
    for offset in (-0.01, -0.02, -0.01):
        there.send(encode_pose(make(now + offset), origin))
    got = await soon(source)
    assert abs(got.stamp - (now - 0.01)) < 1e-5
    assert source.counts == DatagramCounts(delivered=1)
    assert source.intake.refused[PoseFault.OUT_OF_ORDER] == source.intake.refused[PoseFault.DUPLICATE] == 1


async def test_after_bad_ones_the_next_good_one_passes(line):
    source, there, origin = line
    there.send(b"nonsense")
    there.send(encode_pose(make(math.nan), origin))
    there.send(encode_pose(make(asyncio.get_running_loop().time()), origin))
    assert await soon(source) is not None


async def test_a_path_is_listened_at_and_removed(tmp_path):
    path = tmp_path / "poses"
    source = SocketPoses.at(str(path), intake())
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(encode_pose(make(loop.time()), time.monotonic() - loop.time()), str(path))
    assert await soon(source) is not None
    with pytest.raises(BadInputError, match="receives there already"):
        SocketPoses.at(str(path), intake())
    source.close()
    assert not path.exists()


async def test_a_path_that_was_left_behind_is_taken_over(tmp_path):
    path = tmp_path / "poses"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as left:
        left.bind(str(path))
    assert path.exists()
    SocketPoses.at(str(path), intake()).close()


async def test_a_file_in_the_way_is_kept(tmp_path):
    path = tmp_path / "poses"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(BadInputError):
        SocketPoses.at(str(path), intake())
    assert path.read_text(encoding="utf-8") == "mine"


async def test_a_udp_port_is_listened_at_and_a_taken_one_told():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        with pytest.raises(BadInputError, match="receives there already"):
            SocketPoses.at(f"127.0.0.1:{port}", intake())
    source = SocketPoses.at(f"127.0.0.1:{port}", intake())
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(encode_pose(make(loop.time()), time.monotonic() - loop.time()), ("127.0.0.1", port))
    assert await soon(source) is not None
    source.close()


@pytest.mark.parametrize(
    "text", ["", "poses", "0.0.0.0:5601", "192.168.1.2:5601", "127.0.0.1:0", "127.0.0.1:65536", "a:b"]
)
def test_addresses_beyond_this_computer_are_refused(text):
    with pytest.raises(ValueError, match=r"address|port"):
        parse_address(text)
