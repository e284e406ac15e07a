"""Poses from a file, as fast as they were recorded."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np

from flightapp.config import Config
from flightapp.evaluation.flight import Poses
from flightapp.messages import PoseSample
from flightapp.sensors.intake import PoseIntake
from flightapp.sensors.pose_files import read_poses
from flightapp.track import Start


class ReplayPoses:
    """A source of recorded poses, through an intake; raises `BadInputError` for a file that is none.

    Stamps and waits are by the event loop's time, real or virtual: the first sample is captured when the first one is
    asked for. What a recording of a tracker holds goes through the whole intake; a flight log's poses are the body's.
    The source ends with the file.
    """

    def __init__(self, path: Path, config: Config, start: Start | None = None) -> None:
        recording = read_poses(path)
        self._poses = recording.poses
        self.intake = PoseIntake.of_body(config) if recording.of_body else PoseIntake(config, start)
        """Counts what was refused."""
        # A tracker whose stamps are early has not even captured them by then.
        self._lag = 0.0 if recording.of_body else max(-config.sensors.delay, 0.0)

    async def poses(self) -> AsyncIterator[PoseSample]:
        """Each sample when it was captured; the newest, where the consumer is behind."""
        loop = asyncio.get_running_loop()
        stamps = self._poses.stamp
        origin = loop.time() - float(stamps[0])
        i = 0
        while i < len(stamps):
            await asyncio.sleep(max(origin + float(stamps[i]) + self._lag - loop.time(), 0.0))
            now = loop.time()
            i = max(i, int(np.searchsorted(stamps, now - origin - self._lag, "right")) - 1)
            sample = self.intake.take(row(self._poses, i, origin), now)
            i += 1
            if sample is not None:
                yield sample

    def report(self) -> str:
        """What became of the samples so far, in one line."""
        return self.intake.report()

    def close(self) -> None:
        """Nothing to give back."""


def row(poses: Poses, i: int, origin: float = 0.0) -> PoseSample:
    """Sample ``i`` of ``poses``, its stamp ``origin`` s later."""
    told = poses.acceleration[i]
    return PoseSample(
        float(poses.stamp[i]) + origin,
        poses.position[i],
        poses.orientation[i],
        poses.velocity[i],
        poses.angular_velocity[i],
        int(poses.confidence[i]),
        None if np.isnan(told).all() else told,
        int(poses.epoch[i]),
    )
