"""The script that sends a T265's poses: in a process of its own, with a camera that is played."""

import ast
import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from flightapp.frames import quat_from_yaw, quat_rotate_inverse
from flightapp.sensors import t265_bridge
from flightapp.sensors.poses import MAGIC, POSE_RECORD, VERSION

SCRIPT = Path(t265_bridge.__file__)
FAKE = Path(__file__).parent / "fake_t265"


@contextmanager
def bridge(address, fake=FAKE, **script):
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": str(fake), "FAKE_T265": json.dumps(script)}
    # -S: without this interpreter's packages, so without flightapp and numpy.
    command = [sys.executable, "-S", str(SCRIPT), address]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def receiver(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as opened:
        opened.bind(str(tmp_path / "poses"))
        opened.settimeout(5.0)
        yield opened


def test_the_record_is_the_receivers_byte_for_byte():
    assert t265_bridge.RECORD.size == POSE_RECORD.itemsize
    numbers = [float(n) for n in range(17)]
    data = t265_bridge.RECORD.pack(t265_bridge.MAGIC, t265_bridge.VERSION, 2, 1 << 40, *numbers)
    record = np.zeros((), POSE_RECORD)
    record["magic"], record["version"], record["confidence"], record["epoch"] = MAGIC, VERSION, 2, 1 << 40
    record["stamp"] = 0.0
    for name, begin, end in (("position", 1, 4), ("orientation", 4, 8), ("velocity", 8, 11)):
        record[name] = numbers[begin:end]
    record["angular_velocity"], record["acceleration"] = numbers[11:14], numbers[14:17]
    assert record.tobytes() == data


def test_it_reads_on_python_3_6_and_needs_nothing_of_ours():
    tree = ast.parse(SCRIPT.read_text(encoding="utf-8"), feature_version=(3, 6))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported <= {"argparse", "contextlib", "importlib", "signal", "socket", "struct", "sys", "time", "typing"}


def test_poses_arrive_turned_into_forward_left_up(receiver):
    with bridge(receiver.getsockname()):
        record = np.frombuffer(receiver.recv(512), POSE_RECORD)[0]
        now = time.monotonic()
    assert (record["magic"], record["version"], record["confidence"]) == (MAGIC, VERSION, 2)
    # Right 0.1, up 0.2, ahead 3 (back -3).
    np.testing.assert_allclose(record["position"], (3.0, -0.1, 0.2), atol=0.01)
    np.testing.assert_allclose(record["velocity"], (0.6, -0.4, 0.5))
    np.testing.assert_allclose(record["acceleration"], (0.9, -0.7, 0.8))
    # A turn about its up is a turn about ours.
    left = quat_from_yaw(0.5 * math.pi)
    np.testing.assert_allclose(record["orientation"], left, atol=1e-12)
    np.testing.assert_allclose(
        record["angular_velocity"], quat_rotate_inverse(left, np.array((3.0, -1.0, 2.0))), atol=1e-12
    )
    assert 0.006 <= now - record["stamp"] < 0.5


def test_stamps_of_another_clock_are_those_of_the_arrival(receiver):
    with bridge(receiver.getsockname(), domain=0):
        for _ in range(5):
            record = np.frombuffer(receiver.recv(512), POSE_RECORD)[0]
        assert abs(time.monotonic() - record["stamp"]) < 0.3


def test_it_waits_for_the_camera_and_opens_it_again_when_it_was_unplugged(receiver):
    with bridge(receiver.getsockname(), absent=1, frames=3) as process:
        records = [np.frombuffer(receiver.recv(512), POSE_RECORD)[0] for _ in range(7)]
        process.send_signal(signal.SIGTERM)
        told = process.stderr.read()
        assert process.wait(5.0) == 0
    epochs = np.array([record["epoch"] for record in records], np.int64)
    np.testing.assert_array_equal(epochs - epochs[0], [0, 0, 0, 1, 1, 1, 2])
    assert "No device connected" in told
    assert "gone" in told


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_well(receiver, number):
    with bridge(receiver.getsockname()) as process:
        receiver.recv(512)
        process.send_signal(number)
        assert process.wait(5.0) == 0


def test_a_receiver_may_come_later_and_by_a_port(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    path = tmp_path / "late"
    with bridge(f"127.0.0.1:{port}"), bridge(str(path)) as process:
        assert "nobody receives" in process.stderr.readline() + process.stderr.readline()
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as by_port,
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as by_path,
        ):
            by_port.bind(("127.0.0.1", port))
            by_path.bind(str(path))
            for receiving in (by_port, by_path):
                receiving.settimeout(5.0)
                assert len(receiving.recv(512)) == POSE_RECORD.itemsize


def test_without_its_library_it_says_which(tmp_path):
    with bridge("/run/nowhere", fake=tmp_path) as process:
        assert process.wait(5.0) == 2
        assert "pyrealsense2==2.50" in process.stderr.read()


def test_an_address_that_is_none_is_told():
    with bridge("nowhere") as process:
        assert process.wait(5.0) == 2
        assert "'nowhere' is not an address" in process.stderr.read()
