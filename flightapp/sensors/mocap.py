"""Ground truth of a real flight: a motion-capture system's poses, for the log and nobody else."""

import asyncio
import socket

import numpy as np

from flightapp.channel import Topic
from flightapp.interfaces import GroundTruthFeed
from flightapp.messages import GroundTruth, PoseSample
from flightapp.sensors.address import forget, listen
from flightapp.sensors.poses import BURST, POSE_RECORD, DatagramCounts, decode_pose
from flightapp.timing import monotonic_origin


class MocapTruth:
    """Publishes what another process sends, each datagram as `sensors.poses.POSE_RECORD` says, in `feed`.

    The poses must be the body's, in the world frame of the track (x forward at the start, y left, z up). Where only the
    vertical is sure, the errors that are aligned in yaw and place are the ones to look at. Nothing is smoothed: what is
    not finite, lost (confidence 0) or not newer than the last is left out. Owns the ``receiver``.
    """

    def __init__(self, receiver: socket.socket) -> None:
        receiver.setblocking(False)
        self._receiver = receiver
        self._origin = monotonic_origin(asyncio.get_running_loop())
        self._buffer = bytearray(POSE_RECORD.itemsize + 1)  # one byte more, to tell a longer datagram
        self._newest = -np.inf
        self.counts = DatagramCounts()
        """What became of the datagrams so far."""
        self.feed = GroundTruthFeed(
            Topic("truth"),
            Topic("truth_passage"),
            Topic("truth_collision"),
            Topic("truth_gates"),
            Topic("truth_arrivals"),
        )
        asyncio.get_running_loop().add_reader(receiver, self._take)

    @classmethod
    def at(cls, address: str) -> "MocapTruth":
        """Listen at ``address``, a path or HOST:PORT of this computer; raises `BadInputError`."""
        return cls(listen(address))

    def close(self) -> None:
        """Stop listening, and remove the path that was listened at."""
        if self._receiver.fileno() >= 0:
            asyncio.get_running_loop().remove_reader(self._receiver)
        forget(self._receiver)

    def _take(self) -> None:
        for _ in range(BURST):
            try:
                length = self._receiver.recv_into(self._buffer)
            except OSError:  # empty, or the sender's end was closed
                return
            sample = decode_pose(self._buffer, length, self._origin, self.counts)
            if sample is None or not self._good(sample):
                continue
            self._newest = sample.stamp
            self.counts.delivered += 1
            self.feed.motion.publish(
                GroundTruth(sample.stamp, sample.position, sample.orientation, sample.velocity, sample.angular_velocity)
            )

    def _good(self, sample: PoseSample) -> bool:
        numbers = (sample.position, sample.orientation, sample.velocity, sample.angular_velocity)
        finite = np.isfinite(sample.stamp) and all(np.isfinite(part).all() for part in numbers)
        return bool(finite) and sample.confidence > 0 and sample.stamp > self._newest
