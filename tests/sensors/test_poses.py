"""Poses over local sockets."""

import asyncio
import math
import socket
import time

import numpy as np
import pytest

from flightapp.inputs import BadInputError
from flightapp.messages import PoseSample
from flightapp.sensors.address import parse_address
from flightapp.sensors.poses import POSE_RECORD, PoseCounts, SocketPoses, encode_pose
from sim.clock import RealtimeLoop

TURNED = np.array((math.cos(0.3), 0.0, math.sin(0.3), 0.0))


def make(stamp, **changes):
    fields = {
        "position": np.array((1.0, -2.0, 3.0)),
        "orientation": TURNED,
        "velocity": np.array((0.1, 0.2, 0.3)),
        "angular_velocity": np.array((-1.0, 0.5, 0.25)),
        "confidence": 3,
    }
    return PoseSample(stamp, **(fields | changes))


@pytest.fixture
async def line():
    """A source, the other end of its socket, and the loop's origin by CLOCK_MONOTONIC."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    source = SocketPoses(here, max_age=0.1)
    yield source, there, time.monotonic() - asyncio.get_running_loop().time()
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
    for name in ("position", "orientation", "velocity", "angular_velocity"):
        assert np.array_equal(getattr(got, name), getattr(sent, name)), name
        # What later steps are compiled for.
        assert getattr(got, name).flags.writeable
        assert getattr(got, name).dtype == np.float64
    assert got.confidence == 3
    assert source.counts == PoseCounts(delivered=1)


def test_the_record_is_what_its_text_says():
    data = encode_pose(make(2.0, confidence=1), 40.0)
    assert len(data) == 116 == POSE_RECORD.itemsize
    assert np.array_equal(np.frombuffer(data[:112]), [42.0, 1, -2, 3, *TURNED, 0.1, 0.2, 0.3, -1.0, 0.5, 0.25])
    assert data[112:] == b"\x01\0\0\0"


def test_stamps_become_the_loops_own_time():
    async def main():
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        source = SocketPoses(here, max_age=1.0)
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
        there.send(encode_pose(make(now - 0.05 + 0.01 * k, position=np.full(3, float(k))), origin))
    got = await soon(source)
    assert got.position[0] == 4.0
    assert await soon(source, 0.02) is None
    assert source.counts == PoseCounts(delivered=1, skipped=4)


@pytest.mark.parametrize(
    ("what", "changes"),
    [
        ("not_finite", {"position": np.array((0.0, math.nan, 0.0))}),
        ("not_finite", {"velocity": np.array((math.inf, 0.0, -math.inf))}),
        ("not_finite", {"stamp": math.nan}),
        ("malformed", {"orientation": np.zeros(4)}),
        ("malformed", {"orientation": 1.01 * TURNED}),
        ("malformed", {"confidence": 4}),
        ("stale", {"stamp": -0.15}),
        ("stale", {"stamp": 0.05}),
    ],
)
async def test_what_cannot_be_used_is_counted_and_refused(line, what, changes):
    source, there, origin = line
    now = asyncio.get_running_loop().time()
    stamp = now + changes.pop("stamp", 0.0)
    there.send(encode_pose(make(stamp, **changes), origin))
    assert await soon(source, 0.02) is None
    assert source.counts == PoseCounts(**{what: 1})


@pytest.mark.parametrize("length", [0, 1, 115, 117, 5000])
async def test_other_lengths_are_malformed(line, length):
    source, there, origin = line
    record = encode_pose(make(asyncio.get_running_loop().time()), origin)
    there.send((record * 50)[:length])
    assert await soon(source, 0.02) is None
    assert source.counts == PoseCounts(malformed=1)


async def test_out_of_order_and_repeated_samples_are_stale(line):
    source, there, origin = line
    now = asyncio.get_running_loop().time()
    for offset in (-0.01, -0.02, -0.01):
        there.send(encode_pose(make(now + offset), origin))
    got = await soon(source)
    assert abs(got.stamp - (now - 0.01)) < 1e-5
    assert source.counts == PoseCounts(delivered=1, stale=2)


async def test_after_bad_ones_the_next_good_one_passes(line):
    source, there, origin = line
    there.send(b"nonsense")
    there.send(encode_pose(make(math.nan), origin))
    there.send(encode_pose(make(asyncio.get_running_loop().time()), origin))
    assert await soon(source) is not None


async def test_a_path_is_listened_at_and_removed(tmp_path):
    path = tmp_path / "poses"
    source = SocketPoses.at(str(path), 0.1)
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(encode_pose(make(loop.time()), time.monotonic() - loop.time()), str(path))
    assert await soon(source) is not None
    with pytest.raises(BadInputError, match="receives there already"):
        SocketPoses.at(str(path), 0.1)
    source.close()
    assert not path.exists()


async def test_a_path_that_was_left_behind_is_taken_over(tmp_path):
    path = tmp_path / "poses"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as left:
        left.bind(str(path))
    assert path.exists()
    SocketPoses.at(str(path), 0.1).close()


async def test_a_file_in_the_way_is_kept(tmp_path):
    path = tmp_path / "poses"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(BadInputError):
        SocketPoses.at(str(path), 0.1)
    assert path.read_text(encoding="utf-8") == "mine"


async def test_a_udp_port_is_listened_at_and_a_taken_one_told():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        with pytest.raises(BadInputError, match="receives there already"):
            SocketPoses.at(f"127.0.0.1:{port}", 0.1)
    source = SocketPoses.at(f"127.0.0.1:{port}", 0.1)
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
