"""A recording as a source of frames, at the pace at which it was recorded."""

import asyncio
import itertools
from collections.abc import AsyncIterator, Iterator

from flightapp.cameras.shots import check_size
from flightapp.messages import Frame
from flightapp.perception.camera import CameraModel


class ReplayCamera:
    """Recorded ``frames`` of the camera ``name`` with the calibrated ``model``; raises `BadInputError`.

    Stamps and waits are by the event loop's time, real or virtual: the first is captured when the first one is asked
    for, and arrives ``latency`` s later. Frames that are late already are skipped. With ``threaded`` they are read in a
    worker thread, which a loop of virtual time has no use for. The source ends with the recording.
    """

    def __init__(
        self, frames: Iterator[Frame], model: CameraModel, name: str, latency: float = 0.0, threaded: bool = False
    ) -> None:
        first = next(frames)
        if first.image is not None:
            check_size(first.image, model, name)
        self._frames = itertools.chain((first,), frames)
        self._model, self._name, self._latency, self._threaded = model, name, latency, threaded
        self._begin = first.stamp
        self.skipped = 0
        """Frames for which there was no time."""

    @property
    def model(self) -> CameraModel:
        """The calibration, of which the recording is believed to be."""
        return self._model

    async def frames(self) -> AsyncIterator[Frame]:
        """Each frame when it would have arrived; raises `BadInputError` where the recording cannot be read on."""
        loop = asyncio.get_running_loop()
        origin = loop.time() - self._begin
        upcoming = await self._next()
        while (frame := upcoming) is not None:
            if frame.image is not None:
                check_size(frame.image, self._model, self._name)
            stamp = frame.stamp + origin
            await asyncio.sleep(max(stamp + self._latency - loop.time(), 0.0))
            upcoming = await self._next()
            if upcoming is not None and upcoming.stamp + origin + self._latency <= loop.time():
                self.skipped += 1
                continue
            yield Frame(stamp, frame.sequence, frame.image)

    async def _next(self) -> Frame | None:
        return await asyncio.to_thread(next, self._frames, None) if self._threaded else next(self._frames, None)

    def close(self) -> None:
        """Nothing to give back."""
