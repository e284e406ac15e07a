"""The simulated drone, as the application sees it: the only edge at which simulation enters."""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import TypeVar

import numpy as np

from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Config
from flightapp.frames import quat_yaw
from flightapp.inputs import BadInputError
from flightapp.interfaces import Autopilot, FrameSource, GroundTruthFeed, PoseSource, Worker
from flightapp.messages import Frame, PoseSample
from flightapp.perception.camera import CameraModel
from flightapp.track import Track
from flightapp.worker import ThreadWorker
from sim.clock import RealtimeLoop, VirtualLoop
from sim.corner_camera import CornerCamera
from sim.px4.position_control import PositionController, turn
from sim.render import PoseAt, Renderer
from sim.scene import Scene
from sim.survey import survey
from sim.t265 import make_tracker
from sim.world import World

T = TypeVar("T")

BACKLOG = 0.5
"""s, older measurements that could not be delivered are lost, as from a real sensor."""


class SimCamera:
    """A camera on the simulated vehicle, rendering images or finding corners itself."""

    def __init__(self, config: Config, track: Track, seed: int, world: World) -> None:
        self._config = config.camera
        self._world = world
        self._model = config.camera.model()
        scene = Scene.from_track(track)
        kind = Renderer if config.sim.camera == "rendered" else CornerCamera
        self._camera = kind(scene, self._model, config.camera.exposure, seed)

    @property
    def model(self) -> CameraModel:
        """The calibration; the simulated camera is calibrated perfectly."""
        return self._model

    async def frames(self) -> AsyncIterator[Frame]:
        """Frames at the camera's rate, each delivered its latency after the middle of its exposure."""
        loop = asyncio.get_running_loop()
        origin = loop.time() + self._config.exposure
        sequence = 0
        while True:
            stamp = origin + sequence / self._config.rate
            await asyncio.sleep(max(stamp + max(self._config.latency, self._config.exposure) - loop.time(), 0.0))
            self._world.advance()
            yield self.expose(stamp, sequence)
            sequence = max(sequence + 1, int((loop.time() - BACKLOG - origin) * self._config.rate))

    def expose(self, stamp: float, sequence: int, pose_at: PoseAt | None = None) -> Frame:
        """What the camera sees with the middle of the exposure at a recent ``stamp``.

        ``pose_at`` tells the true pose around the stamp where the world itself may not be asked.
        """
        known = pose_at or self._world.pose_at
        if isinstance(self._camera, CornerCamera):
            return Frame(stamp, sequence, None, self._camera.detect(stamp, known))
        return Frame(stamp, sequence, self._camera.render(stamp, known))


class SimTracker:
    """A tracker on the simulated vehicle; also publishes the truth, for the log, as often."""

    def __init__(self, config: Config, seed: int, world: World) -> None:
        self._world = world
        self._tracker = make_tracker(config, seed)

    async def poses(self) -> AsyncIterator[PoseSample]:
        """Samples at the tracker's rate, in order, each when it would arrive."""
        loop = asyncio.get_running_loop()
        origin = loop.time()
        count = 0
        while True:
            stamp = origin + count / self._tracker.rate
            # The plant remembers the motion at the stamp, so that nothing need be done before the arrival.
            await asyncio.sleep(max(stamp + self._tracker.next_latency - loop.time(), 0.0))
            self._world.advance()
            truth = self._world.state_at(stamp)
            self._world.truth.motion.publish(truth)
            self._world.feel(stamp)
            measured = self._tracker.sample(truth)
            if measured is not None:
                yield measured[0]
            count = max(count + 1, int((loop.time() - BACKLOG - origin) * self._tracker.rate))


class ModelledWorker:
    """Computes at once and lets the time pass that the configuration says it costs on the target."""

    def __init__(self, config: Config) -> None:
        self._costs = config.compute.model_dump()

    async def run(self, name: str, function: Callable[[], T]) -> T:
        """``function()``, available after the configured seconds for ``name``."""
        result = function()
        await asyncio.sleep(self._costs[name])
        return result

    def close(self) -> None:
        """Nothing to give back."""


class SimRig:
    """A simulated drone in a simulated world, the same for the same ``seed``."""

    def __init__(self, config: Config, track: Track, seed: int) -> None:
        if config.sim.faults:
            raise BadInputError("sim.faults are of the link and the vehicle behind it; fly with --sim --mavlink")
        seeds = np.random.SeedSequence(seed)
        world_seed, camera_seed, tracker_seed, survey_seed = seeds.spawn(4)
        loop = asyncio.get_running_loop()
        exercise(config, track)
        self._world = World(config, track, world_seed, loop.time)
        self._survey_seed, self._exact = survey_seed, config.sim.survey == "exact"
        self.autopilot: Autopilot = self._world.autopilot
        self.camera: FrameSource = SimCamera(config, track, number(camera_seed), self._world)
        self.tracker: PoseSource = SimTracker(config, number(tracker_seed), self._world)
        self.worker: Worker = ModelledWorker(config) if isinstance(loop, VirtualLoop) else ThreadWorker()
        self.truth: GroundTruthFeed | None = self._world.truth

    @staticmethod
    def loop_factory(realtime: bool) -> Callable[[], asyncio.AbstractEventLoop]:
        """The event loop to fly in: on the wall clock, or as fast as it computes."""
        return RealtimeLoop if realtime else VirtualLoop

    def survey(self, track: Track) -> Track:
        """``track`` as it is known before the flight."""
        self._world.announce()
        return survey(track, np.random.default_rng(self._survey_seed), self._exact)

    async def close(self) -> None:
        """Nothing to give back but what has a close of its own."""


def exercise(config: Config, track: Track) -> None:
    """Use everything that is compiled on first use once, in a world of its own, so that the flight need not wait."""
    now = [0.0]
    world = World(config, track, np.random.SeedSequence(0), lambda: now[0])
    camera = SimCamera(config, track, 0, world)
    now[0] = 0.1
    world.advance()
    camera.expose(0.05, 0)
    truth = world.state_at(0.05)
    measured = make_tracker(config, 0).sample(truth)
    if measured is not None:
        world.autopilot.send_pose(measured[0])
    world.autopilot.px4.estimate()
    controller = PositionController(ThrustMap(config.vehicle.hover_thrust, config.vehicle.thrust_curve))
    controller.reset(truth.position, truth.velocity, float(quat_yaw(truth.orientation)))
    controller.command(truth.position.copy(), truth.velocity.copy(), truth.orientation.copy(), 0.01)
    controller.command_level(0.0, 0.0, truth.orientation.copy(), 0.01)
    turn(truth.orientation.copy(), truth.orientation.copy())


def number(seed: np.random.SeedSequence) -> int:
    """A plain number from ``seed``."""
    return int(seed.generate_state(1)[0])
