"""The camera that the configuration names."""

from typing import Protocol

from flightapp.cameras.live import LiveCamera
from flightapp.cameras.names import HOW, parse_source
from flightapp.cameras.opencv import OpencvDevice
from flightapp.cameras.recordings import recorded_frames
from flightapp.cameras.replay import ReplayCamera
from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.interfaces import FrameSource


class OpenCamera(FrameSource, Protocol):
    """A source of frames that holds something until it is closed."""

    def close(self) -> None:
        """Give back what it holds."""
        ...


def open_camera(config: Config) -> OpenCamera:
    """The camera of ``config.camera.source``; raises `BadInputError` where there is none, or it is not as calibrated.

    It must be called within the running event loop, whose time is the wall clock's.
    """
    camera = config.camera
    if not camera.source:
        raise BadInputError(f"camera.source is empty: no camera is configured; {HOW}")
    source, model = parse_source(camera.source), camera.model()
    if source.kind.live:
        return LiveCamera(OpencvDevice(source, camera), model, camera.rate)
    frames = recorded_frames(source, camera.rate)
    return ReplayCamera(frames, model, source.text, camera.latency, threaded=True)
