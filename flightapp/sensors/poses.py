"""Poses of the body from another process, over a local datagram socket."""

import asyncio
import math
import socket
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass

import numpy as np

from flightapp.messages import PoseSample
from flightapp.sensors.address import forget, listen

POSE_RECORD = np.dtype(
    [
        ("stamp", "<f8"),
        ("position", "<f8", 3),
        ("orientation", "<f8", 4),
        ("velocity", "<f8", 3),
        ("angular_velocity", "<f8", 3),
        ("confidence", "<u4"),
    ]
)
"""One datagram, 116 bytes without padding: a `PoseSample` with the time of capture by CLOCK_MONOTONIC in s.

Position in m and velocity in m/s in the tracker's frame (z up), orientation as the unit quaternion w, x, y, z from body
(FLU) to that frame, angular velocity in rad/s in the body frame, confidence 0 (failed) to 3 (high).
"""
NUMBERS = 14
MAX_CONFIDENCE = 3
UNIT = 1e-3
"""By how much the length of a quaternion may differ from 1."""
AHEAD = 0.005
"""s, a stamp further in the future than this is not believed."""
BURST = 512
"""Datagrams taken at once, so that a flood of them holds nothing up for long."""


@dataclass(slots=True)
class PoseCounts:
    """What became of the datagrams that arrived."""

    delivered: int = 0
    skipped: int = 0
    """Good, but a newer one was there before anybody had asked."""
    malformed: int = 0
    """Of the wrong length, or with a confidence or a quaternion that is none."""
    not_finite: int = 0
    stale: int = 0
    """Too old, out of order, repeated, or from the future."""


def encode_pose(sample: PoseSample, origin: float) -> bytes:
    """``sample`` as a `POSE_RECORD`; ``origin`` is CLOCK_MONOTONIC (s) when the stamps' clock showed 0."""
    record = np.empty((), POSE_RECORD)
    record["stamp"] = sample.stamp + origin
    record["position"], record["orientation"] = sample.position, sample.orientation
    record["velocity"], record["angular_velocity"] = sample.velocity, sample.angular_velocity
    record["confidence"] = sample.confidence
    return record.tobytes()


class SocketPoses:
    """A source of poses that other processes send, each a datagram as `POSE_RECORD` says.

    Only the newest sample waits. What is malformed, not finite, out of order or older than ``max_age`` (s) on arrival
    is counted and refused. Stamps become the event loop's time. Owns the ``receiver``.
    """

    def __init__(self, receiver: socket.socket, max_age: float) -> None:
        receiver.setblocking(False)
        self._receiver = receiver
        self._max_age = max_age
        self._origin = time.monotonic() - asyncio.get_running_loop().time()
        # One byte more than a record, to tell a longer datagram from it.
        self._buffer = bytearray(POSE_RECORD.itemsize + 1)
        self._last = -math.inf
        self._newest: PoseSample | None = None
        self._arrived = asyncio.Event()
        self.counts = PoseCounts()
        """What became of the datagrams so far."""

    @classmethod
    def at(cls, address: str, max_age: float) -> "SocketPoses":
        """Listen at ``address``, a path or HOST:PORT of this computer; raises `BadInputError`."""
        return cls(listen(address), max_age)

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
            sample = self._decode(length, now)
            if sample is None:
                continue
            if self._newest is not None:
                self.counts.skipped += 1
            self._last, self._newest = sample.stamp, sample
        if self._newest is not None:
            self._arrived.set()

    def _decode(self, length: int, now: float) -> PoseSample | None:
        counts = self.counts
        if length != POSE_RECORD.itemsize:
            counts.malformed += 1
            return None
        numbers = np.frombuffer(self._buffer, "<f8", NUMBERS).astype(np.float64)
        if not math.isfinite(sum(numbers.tolist())):
            counts.not_finite += 1
            return None
        confidence = int.from_bytes(self._buffer[8 * NUMBERS : 8 * NUMBERS + 4], "little")
        q = numbers[4:8]
        if confidence > MAX_CONFIDENCE or abs(math.sqrt(q @ q) - 1.0) > UNIT:
            counts.malformed += 1
            return None
        stamp = float(numbers[0]) - self._origin
        if not max(self._last, now - self._max_age) < stamp <= now + AHEAD:
            counts.stale += 1
            return None
        return PoseSample(stamp, numbers[1:4], q, numbers[8:11], numbers[11:14], confidence)
