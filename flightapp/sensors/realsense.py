"""Poses of a T265 that is plugged into this computer, where `pyrealsense2` still knows it."""

import asyncio
import importlib
import importlib.metadata
import re
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any

import numpy as np

from flightapp.inputs import BadInputError
from flightapp.messages import PoseSample
from flightapp.sensors import t265_bridge
from flightapp.sensors.intake import PoseIntake
from flightapp.timing import monotonic_origin

LAST = (2, 53)
"""The last version of librealsense with the T265's code."""
BOOT = 6.0
"""s that a T265 may take from the first look at the USB until it is there: it is given its firmware first."""
SILENT = 0.5
"""s without a pose after which the camera is opened again."""
RETRY = 1.0
BRIDGE = (
    f"{t265_bridge.MEND}; or let an interpreter that has it run flightapp/sensors/t265_bridge.py,"
    " with sensors.poses = 'socket'"
)


def import_realsense() -> Any:
    """The module pyrealsense2, of a version that knows the T265; raises `BadInputError`."""
    try:
        module = importlib.import_module("pyrealsense2")
    except ImportError as error:
        raise BadInputError(
            f"sensors.poses = 'realsense': pyrealsense2 cannot be imported ({error}); {BRIDGE}"
        ) from None
    version = _version(module)
    numbers = tuple(int(part) for part in re.findall(r"\d+", version)[:2])
    if numbers > LAST:
        raise BadInputError(f"sensors.poses = 'realsense': pyrealsense2 {version} no longer knows the T265; {BRIDGE}")
    return module


def _version(module: Any) -> str:
    told = getattr(module, "__version__", None)
    if told is None:
        with suppress(importlib.metadata.PackageNotFoundError):
            told = importlib.metadata.version("pyrealsense2")
    return str(told or "")


class RealSensePoses:
    """A source of a T265's poses, through an ``intake``; raises `BadInputError` where there is none.

    Only the newest sample waits. Where the camera falls silent it is opened again: its frame then is another, which
    the intake tells as a relocalisation. Stamps are the event loop's time.
    """

    def __init__(self, intake: PoseIntake, patience: float = BOOT) -> None:
        """``patience`` is how long (s) to look for the camera."""
        self._rs = import_realsense()
        self.intake = intake
        """Counts what was refused."""
        self._loop = asyncio.get_running_loop()
        self._origin = monotonic_origin(self._loop)
        self._newest: PoseSample | None = None
        self._arrived = asyncio.Event()
        self._opened = 0
        self._heard = -1
        self._pipeline: Any = None
        self._find(patience)
        try:
            self._open()
        except RuntimeError as error:
            raise BadInputError(f"sensors.poses = 'realsense': the T265 cannot be opened: {error}") from None

    async def poses(self) -> AsyncIterator[PoseSample]:
        """The newest sample each time; what arrived between is skipped. For one consumer."""
        while True:
            try:
                async with asyncio.timeout(SILENT):
                    await self._arrived.wait()
            except TimeoutError:
                await self._reopen()
                continue
            self._arrived.clear()
            sample, self._newest = self._newest, None
            if sample is not None:
                yield sample

    def report(self) -> str:
        """What became of the samples so far, in one line."""
        return self.intake.report()

    def close(self) -> None:
        """Give the camera back."""
        self._heard = -1
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            with suppress(RuntimeError):  # one that was unplugged has stopped by itself
                pipeline.stop()

    def _find(self, patience: float) -> None:
        context, deadline = self._rs.context(), time.monotonic() + patience
        while True:
            names = [str(device.get_info(self._rs.camera_info.name)) for device in context.query_devices()]
            if any("T265" in name for name in names):
                return
            if time.monotonic() > deadline:
                found = f"found {', '.join(names)}" if names else "no RealSense camera was found"
                raise BadInputError(f"sensors.poses = 'realsense': no T265 is plugged in: {found}")
            time.sleep(0.25)

    def _open(self) -> None:
        """Raises RuntimeError where the camera is not there."""
        self._opened += 1
        self._heard = opened = self._opened
        self._pipeline = t265_bridge.opened(self._rs, lambda frame: self._on_frame(opened, frame))

    async def _reopen(self) -> None:
        def again() -> None:
            self.close()
            self._open()

        try:
            await asyncio.to_thread(again)
        except RuntimeError:  # not plugged in again yet
            await asyncio.sleep(RETRY)

    def _on_frame(self, opened: int, frame: Any) -> None:
        """On the camera's thread."""
        stamp = t265_bridge.captured(frame, self._rs.timestamp_domain, time.monotonic()) - self._origin
        moved = frame.as_frameset().get_pose_frame() if frame.is_frameset() else frame.as_pose_frame()
        pose = moved.get_pose_data()
        position, turn, velocity, omega, pushed = (np.array(numbers, float) for numbers in t265_bridge.measured(pose))
        sample = PoseSample(stamp, position, turn, velocity, omega, int(pose.tracker_confidence), pushed, opened)
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._take, sample)

    def _take(self, sample: PoseSample) -> None:
        if sample.epoch != self._heard:
            return
        taken = self.intake.take(sample, self._loop.time())
        if taken is not None:
            self._newest = taken
            self._arrived.set()
