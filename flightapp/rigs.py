"""The rig of a real vehicle with PX4."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack

from flightapp.autopilot.link import Px4Link
from flightapp.channel import Reader, Topic
from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.interfaces import Autopilot, FrameSource, GroundTruthFeed, PoseSource, Worker
from flightapp.messages import Frame, PoseSample
from flightapp.perception.camera import CameraModel
from flightapp.sensors.poses import SocketPoses
from flightapp.track import Track
from flightapp.worker import ThreadWorker


class Blind:
    """No camera: never a frame."""

    def __init__(self, config: Config) -> None:
        self._model = config.camera.model()

    @property
    def model(self) -> CameraModel:
        """The calibration that a camera would have."""
        return self._model

    async def frames(self) -> AsyncIterator[Frame]:
        """Nothing, for ever."""
        nothing: asyncio.Future[Frame] = asyncio.get_running_loop().create_future()
        yield await nothing


class TopicPoses:
    """Poses from a topic, the newest each time."""

    def __init__(self, topic: Topic[PoseSample]) -> None:
        self._topic = topic

    async def poses(self) -> AsyncIterator[PoseSample]:
        """Samples as they are published; what comes while one is being worked on is skipped."""
        reader = Reader(self._topic)
        while True:
            yield await reader.newest()


class SelfPositionedLink(Px4Link):
    """A vehicle that finds its position by its own means: its estimate is never fed back to it as a measurement."""

    def send_pose(self, sample: PoseSample) -> None:
        """Nothing is sent."""


class Px4Rig:
    """A vehicle with PX4 that flies through waypoints: poses from a socket or from PX4 itself, and no camera.

    Raises `BadInputError` for a track with gates, which take a camera to find.
    """

    def __init__(self, config: Config, track: Track, seed: int) -> None:
        if track.gates:
            raise BadInputError(
                f"track '{track.name}' has gates, which take a camera to find, and the rig 'px4' has none;"
                " fly a track of waypoints, or this one in simulation"
            )
        self._socket: SocketPoses | None = None
        if config.sensors.poses == "autopilot":
            link: Px4Link = SelfPositionedLink(config)
            self.tracker: PoseSource = TopicPoses(link.odometry)
        else:
            self._socket = SocketPoses.at(config.sensors.pose_address, config.sensors.pose_max_age)
            with ExitStack() as failed:
                failed.callback(self._socket.close)
                link = Px4Link(config)
                failed.pop_all()
            self.tracker = self._socket
        self.autopilot: Autopilot = link
        self.camera: FrameSource = Blind(config)
        self.worker: Worker = ThreadWorker()
        self.truth: GroundTruthFeed | None = None

    @staticmethod
    def loop_factory(realtime: bool) -> Callable[[], asyncio.AbstractEventLoop]:
        """The event loop to fly in: always on the wall clock, monotonic."""
        return asyncio.SelectorEventLoop

    def survey(self, track: Track) -> Track:
        """``track`` itself: what was surveyed is what is known."""
        return track

    async def close(self) -> None:
        """Give back the socket of the poses."""
        if self._socket is not None:
            self._socket.close()
