"""The rig of a real vehicle with PX4."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from flightapp.autopilot.link import Px4Link
from flightapp.cameras.choice import OpenCamera, open_camera
from flightapp.channel import Reader, Topic
from flightapp.computer import OwnComputer
from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.interfaces import Autopilot, Computer, FrameSource, GroundTruthFeed, PoseSource, Worker
from flightapp.messages import Frame, PoseSample
from flightapp.perception.camera import CameraModel
from flightapp.sensors.intake import PoseIntake
from flightapp.sensors.mocap import MocapTruth
from flightapp.sensors.poses import SocketPoses
from flightapp.sensors.realsense import RealSensePoses
from flightapp.sensors.replay import ReplayPoses
from flightapp.track import Start, Track
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

    def close(self) -> None:
        """Nothing to give back."""


class Tracker(PoseSource, Protocol):
    """A source of poses that is there from its making until it is closed."""

    intake: PoseIntake

    def close(self) -> None:
        """Give back what it holds."""
        ...


class TopicPoses:
    """Poses of the body from a topic, through an ``intake``, the newest each time."""

    def __init__(self, topic: Topic[PoseSample], intake: PoseIntake) -> None:
        self._topic = topic
        self.intake = intake
        """Counts what was refused."""

    async def poses(self) -> AsyncIterator[PoseSample]:
        """Samples as they are published; what comes while one is being worked on is skipped."""
        reader, loop = Reader(self._topic), asyncio.get_running_loop()
        while True:
            sample = self.intake.take(await reader.newest(), loop.time())
            if sample is not None:
                yield sample

    def report(self) -> str:
        """What became of the samples so far, in one line."""
        return self.intake.report()

    def close(self) -> None:
        """Nothing to give back."""


def open_tracker(config: Config, start: Start) -> Tracker:
    """The tracker that config.sensors.poses names, but for the autopilot's own; raises `BadInputError`."""
    sensors = config.sensors
    if sensors.poses == "replay":
        return ReplayPoses(Path(sensors.replay), config, start)
    intake = PoseIntake(config, start)
    return RealSensePoses(intake) if sensors.poses == "realsense" else SocketPoses.at(sensors.pose_address, intake)


class SelfPositionedLink(Px4Link):
    """A vehicle that finds its position by its own means: its estimate is never fed back to it as a measurement."""

    def send_pose(self, sample: PoseSample) -> None:
        """Nothing is sent."""


class Px4Rig:
    """A vehicle with PX4: poses from a tracker or from PX4 itself, images from the camera that is configured.

    Raises `BadInputError`, so for a track with gates, which take a camera to find, where none is configured.
    """

    def __init__(self, config: Config, track: Track, seed: int) -> None:
        if track.passage and not config.camera.source:
            raise BadInputError(
                f"track '{track.name}' has gates, which take a camera to find, and camera.source is empty: name the"
                " camera in the vehicle file, fly a track of waypoints, or this one in simulation"
            )
        with ExitStack() as failed:
            camera: OpenCamera = open_camera(config) if config.camera.source else Blind(config)
            failed.callback(camera.close)
            if config.sensors.poses == "autopilot":
                link: Px4Link = SelfPositionedLink(config)
                self._tracker: Tracker = TopicPoses(link.odometry, PoseIntake.of_body(config))
            else:
                self._tracker = open_tracker(config, track.start)
                failed.callback(self._tracker.close)
                link = Px4Link(config)
            address = config.recording.truth_address
            self._mocap = MocapTruth.at(address) if address else None
            failed.pop_all()
        self._camera = camera
        self.tracker: PoseSource = self._tracker
        self.autopilot: Autopilot = link
        self.camera: FrameSource = camera
        self.worker: Worker = ThreadWorker()
        self.computer: Computer = OwnComputer()
        self.truth: GroundTruthFeed | None = None if self._mocap is None else self._mocap.feed

    @staticmethod
    def loop_factory(realtime: bool) -> Callable[[], asyncio.AbstractEventLoop]:
        """The event loop to fly in: always on the wall clock, monotonic."""
        return asyncio.SelectorEventLoop

    def survey(self, track: Track) -> Track:
        """``track`` itself: what was surveyed is what is known."""
        return track

    async def close(self) -> None:
        """Give back the camera, the tracker and what motion capture sends to."""
        self._camera.close()
        self._tracker.close()
        if self._mocap is not None:
            self._mocap.close()
