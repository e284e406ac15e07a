"""A live camera as a source of frames: captured in a thread of its own, the newest to the event loop."""

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TypeVar

from flightapp.cameras.shots import CameraError, DamagedImageError, Device, Shot, check_size, size_problem
from flightapp.channel import Topic
from flightapp.inputs import BadInputError
from flightapp.messages import Event, Frame
from flightapp.perception.camera import CameraModel
from flightapp.timing import monotonic_origin

T = TypeVar("T")

BACK_OFF, BACK_OFF_MAX = 0.25, 4.0
"""s between attempts to open a camera that is gone: each waits twice as long as the one before, up to the second."""
GAP = 1.5
"""Periods between two images, from which on images are missing."""
TRIES = 10
"""Images of which one must be whole when a camera is opened."""
END = 2.0
"""s that the thread may take to end: a read of a camera that hangs is left alone."""


@dataclass(slots=True)
class Counts:
    """What became of the images."""

    taken: int = 0
    """Captured and of use."""
    skipped: int = 0
    """Overtaken by a newer one before the event loop had time for them."""
    missing: int = 0
    """Expected at the camera's rate, and never arrived."""
    refused: int = 0
    """Damaged, of another size, or with a stamp that is not later than the one before."""
    reopened: int = 0
    """Times that the camera came back."""


def first_shot(device: Device) -> Shot:
    """The first image of ``device`` that is of use; raises `CameraError`."""
    for _ in range(TRIES):
        try:
            return device.read()
        except DamagedImageError as error:
            reason = str(error)
    raise CameraError(f"camera '{device.name}' delivers damaged images only: {reason}")


class LiveCamera:
    """Frames of ``device``, of the calibrated ``model``; raises `BadInputError` where it is not there or not of it.

    One that is lost is opened again, with a growing pause between attempts; what happens is told in `notices`.
    """

    def __init__(self, device: Device, model: CameraModel, rate: float) -> None:
        self._device, self._model, self._rate = device, model, rate
        self._loop = asyncio.get_running_loop()
        self._origin = monotonic_origin(self._loop)
        self.notices: Topic[Event] = Topic("camera_notice")
        self.counts = Counts()
        self._newest: Frame | None = None
        self._arrived = asyncio.Event()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._last = float("-inf")
        self._told_size = False
        with ExitStack() as failed:
            failed.callback(device.close)
            try:
                self._refused = device.open()
                first = first_shot(device)
            except CameraError as error:
                raise BadInputError(str(error)) from None
            check_size(first.image, model, device.name)
            failed.pop_all()

    @property
    def model(self) -> CameraModel:
        """The calibration."""
        return self._model

    async def frames(self) -> AsyncIterator[Frame]:
        """The newest frame each time; what was captured between is skipped. For one consumer."""
        for text in (self.stamping(), *self._refused):
            self._tell(text)
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            frame, self._newest = self._newest, None
            if frame is not None:
                yield frame

    def stamping(self) -> str:
        """How images are stamped, in words."""
        if self._device.hardware_stamps:
            return f"camera '{self._device.name}' opened: stamps are the driver's, less camera.driver_delay"
        return f"camera '{self._device.name}' opened: stamps are those of arrival, less camera.latency"

    def report(self) -> str:
        """What became of the images so far, in one line."""
        c = self.counts
        return (
            f"{c.taken} images, {c.skipped} overtaken by newer ones, {c.missing} never arrived, {c.refused} refused;"
            f" the camera was lost and came back {c.reopened} times"
        )

    def close(self) -> None:
        """End the capture and give the camera back."""
        self._stop.set()
        if self._thread is None:
            self._device.close()
            return
        self._thread.join(END)
        self._thread = None
        self._tell(self.report())

    def _run(self) -> None:
        """On the thread: read until told to end."""
        while not self._stop.is_set():
            try:
                shot = self._device.read()
            except CameraError as error:
                self._device.close()
                self._post(f"{error}; it is looked for")
                self._await_return()
            except DamagedImageError:
                self.counts.refused += 1
            else:
                self._take(shot)
        self._device.close()

    def _await_return(self) -> None:
        """Open the camera again, as often as it takes."""
        pause = BACK_OFF
        while not self._stop.wait(pause):
            try:
                self._device.open()
            except CameraError:
                pause = min(2.0 * pause, BACK_OFF_MAX)
                continue
            self.counts.reopened += 1
            self._last = float("-inf")
            self._post(f"camera '{self._device.name}' is back")
            return

    def _take(self, shot: Shot) -> None:
        """Hand ``shot`` on to the event loop if it is of use."""
        problem = size_problem(shot.image, self._model, self._device.name)
        if problem or shot.stamp <= self._last:
            self.counts.refused += 1
            if problem and not self._told_size:
                self._told_size = True
                self._post(problem)
            return
        periods = (shot.stamp - self._last) * self._rate
        if GAP < periods < float("inf"):
            self.counts.missing += round(periods) - 1
        self._last = shot.stamp
        frame = Frame(shot.stamp - self._origin, self.counts.taken, shot.image)
        self.counts.taken += 1
        self._call(self._hand_over, frame)

    def _hand_over(self, frame: Frame) -> None:
        if self._newest is not None:
            self.counts.skipped += 1
        self._newest = frame
        self._arrived.set()

    def _post(self, text: str) -> None:
        self._call(self._tell, text)

    def _call(self, function: Callable[[T], None], argument: T) -> None:
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function, argument)

    def _tell(self, text: str) -> None:
        self.notices.publish(Event(self._loop.time(), "camera", text))
