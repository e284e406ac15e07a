"""Poses of the body from another process, over a local datagram socket."""

import asyncio
import math
import socket
from collections.abc import AsyncIterator
from dataclasses import dataclass

import numpy as np

from flightapp.messages import PoseSample
from flightapp.sensors.address import forget, listen
from flightapp.sensors.intake import PoseIntake
from flightapp.timing import monotonic_origin

POSE_RECORD = np.dtype(
    [
        ("magic", "S4"),
        ("version", "<u2"),
        ("confidence", "<u2"),
        ("epoch", "<u8"),
        ("stamp", "<f8"),
        ("position", "<f8", 3),
        ("orientation", "<f8", 4),
        ("velocity", "<f8", 3),
        ("angular_velocity", "<f8", 3),
        ("acceleration", "<f8", 3),
    ]
)
"""One datagram, 152 bytes without padding, little-endian: a `PoseSample`.

`MAGIC` and `VERSION`; confidence 0 (failed) to 3 (high); epoch, any number that changes whenever the tracker's frame
has moved (it was started again, or has relocalised and knows it), else 0; time of capture by CLOCK_MONOTONIC in s;
position in m in the tracker's frame (z up); orientation as the unit quaternion w, x, y, z from the tracker's body
(forward, left, up) to that frame; velocity in m/s in that frame; angular velocity in rad/s in the tracker's body;
acceleration in m/s² in the tracker's frame, without gravity, three NaN where it is not known.
"""
MAGIC, VERSION = b"POSE", 2
UNMARKED = 116
"""Bytes of a record of version 1, which had no magic and no acceleration."""
HEAD, NUMBERS = 16, 17
"""Bytes before the stamp; numbers from there on."""
MAX_CONFIDENCE = 3
UNKNOWN = (math.nan,) * 3
BURST = 512
"""Datagrams taken at once, so that a flood of them holds nothing up for long."""


@dataclass(slots=True)
class DatagramCounts:
    """What became of the datagrams that arrived, besides what the intake counts."""

    delivered: int = 0
    skipped: int = 0
    """Good, but a newer one was there before anybody had asked."""
    malformed: int = 0
    """No `POSE_RECORD`: of another length, without its magic, or with a confidence that is none."""
    other_version: int = 0
    """Records of a sender that is older, or newer, than this program."""


def encode_pose(sample: PoseSample, origin: float) -> bytes:
    """``sample`` as a `POSE_RECORD`; ``origin`` is CLOCK_MONOTONIC (s) when the stamps' clock showed 0."""
    record = np.empty((), POSE_RECORD)
    record["magic"], record["version"] = MAGIC, VERSION
    record["confidence"], record["epoch"] = sample.confidence, sample.epoch
    record["stamp"] = sample.stamp + origin
    record["position"], record["orientation"] = sample.position, sample.orientation
    record["velocity"], record["angular_velocity"] = sample.velocity, sample.angular_velocity
    record["acceleration"] = UNKNOWN if sample.acceleration is None else sample.acceleration
    return record.tobytes()


def decode_pose(data: bytearray, length: int, origin: float, counts: DatagramCounts) -> PoseSample | None:
    """The sample in the first ``length`` bytes of ``data``, which holds at least a `POSE_RECORD`; None if it is none.

    ``origin`` as in `encode_pose`; what it is instead is counted.
    """
    marked = length > HEAD and data.startswith(MAGIC)
    if length == UNMARKED or (marked and int.from_bytes(data[4:6], "little") != VERSION):
        counts.other_version += 1
        return None
    confidence = int.from_bytes(data[6:8], "little")
    if length != POSE_RECORD.itemsize or not marked or confidence > MAX_CONFIDENCE:
        counts.malformed += 1
        return None
    n = np.frombuffer(data, "<f8", NUMBERS, HEAD).astype(np.float64)
    told = None if np.isnan(n[14:]).all() else n[14:]
    epoch = int.from_bytes(data[8:HEAD], "little")
    return PoseSample(float(n[0]) - origin, n[1:4], n[4:8], n[8:11], n[11:14], confidence, told, epoch)


class SocketPoses:
    """A source of poses that other processes send, each a datagram as `POSE_RECORD` says, through an ``intake``.

    Only the newest sample waits. Stamps become the event loop's time. Owns the ``receiver``.
    """

    def __init__(self, receiver: socket.socket, intake: PoseIntake) -> None:
        receiver.setblocking(False)
        self._receiver = receiver
        self.intake = intake
        """Counts what was refused."""
        self._origin = monotonic_origin(asyncio.get_running_loop())
        # One byte more than a record, to tell a longer datagram from it.
        self._buffer = bytearray(POSE_RECORD.itemsize + 1)
        self._newest: PoseSample | None = None
        self._arrived = asyncio.Event()
        self.counts = DatagramCounts()
        """What became of the datagrams so far."""

    @classmethod
    def at(cls, address: str, intake: PoseIntake) -> "SocketPoses":
        """Listen at ``address``, a path or HOST:PORT of this computer; raises `BadInputError`."""
        return cls(listen(address), intake)

    async def poses(self) -> AsyncIterator[PoseSample]:
        """The newest sample each time; what arrived between is skipped. For one consumer."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._receiver, self._take)
        try:
            while True:
                await self._arrived.wait()
                self._arrived.clear()
                sample, self._newest = self._newest, None
                if sample is not None:
                    self.counts.delivered += 1
                    yield sample
        finally:
            loop.remove_reader(self._receiver)

    def report(self) -> str:
        """What became of the samples so far, in one line."""
        return self.intake.report()

    def close(self) -> None:
        """Stop listening, and remove the path that was listened at."""
        if self._receiver.fileno() >= 0:
            asyncio.get_running_loop().remove_reader(self._receiver)
        forget(self._receiver)

    def _take(self) -> None:
        """Empty the socket."""
        now = asyncio.get_running_loop().time()
        for _ in range(BURST):
            try:
                length = self._receiver.recv_into(self._buffer)
            except OSError:  # empty, or the sender's end was closed
                break
            measured = decode_pose(self._buffer, length, self._origin, self.counts)
            sample = None if measured is None else self.intake.take(measured, now)
            if sample is None:
                continue
            if self._newest is not None:
                self.counts.skipped += 1
            self._newest = sample
        if self._newest is not None:
            self._arrived.set()
