"""The simulated drone, as the application sees it: the only edge at which simulation enters."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Config
from flightapp.frames import quat_yaw
from flightapp.interfaces import Autopilot, Computer, FrameSource, GroundTruthFeed, PoseSource, Worker
from flightapp.messages import Frame, GroundTruth, PoseSample
from flightapp.perception.camera import CameraModel
from flightapp.sensors.intake import PoseIntake
from flightapp.track import Track
from flightapp.worker import ThreadWorker
from sim.calibration import true_camera
from sim.clock import RealtimeLoop, VirtualLoop
from sim.computer import FaultyWorker, SimComputer, hold_up, slow_down
from sim.corner_camera import CornerCamera
from sim.faults import SOURCES, Fault, named, read_faults
from sim.gate_faults import rearranged
from sim.px4.position_control import PositionController, turn
from sim.render import PoseAt, Renderer
from sim.scene import Scene
from sim.sensor_faults import CameraFaults, PoseFaults
from sim.survey import survey
from sim.t265 import make_tracker
from sim.world import World

T = TypeVar("T")

FAILS = "the driver fails, as simulated"
BACKLOG = 0.5
"""s, older measurements that could not be delivered are lost, as from a real sensor."""


class SimCamera:
    """A camera on the simulated vehicle, rendering images or finding corners itself."""

    def __init__(self, config: Config, track: Track, seed: int, world: World, faults: Sequence[Fault] = ()) -> None:
        self._config = config.camera
        self._world = world
        self._faults = CameraFaults(faults, seed)
        self._failures = failures(faults, "camera")
        self._track = track
        kind = Renderer if config.sim.camera == "rendered" else CornerCamera
        true, self.after = true_camera(config.camera.model(), config.sim.calibration, seed)
        """s by which the middle of the exposure is later than its stamp."""
        self._camera = kind(Scene.from_track(track), true, config.camera.exposure, seed)

    @property
    def model(self) -> CameraModel:
        """The calibration: what is left wrong with it is `sim.calibration`'s, unless more is by its fault."""
        told = self._config.model()
        return replace(told, focal=told.focal * np.array((self._faults.focal, self._faults.focal, 1.0, 1.0)))

    async def frames(self) -> AsyncIterator[Frame]:
        """Frames at the camera's rate, each delivered its latency after the middle of its exposure."""
        loop = asyncio.get_running_loop()
        origin = loop.time() + self._config.exposure + abs(self.after)
        sequence = 0
        while True:
            stamp = origin + sequence / self._config.rate
            least = self._config.exposure + max(self.after, 0.0)
            latency = max(self._config.latency, least) + self._faults.lateness(stamp)
            await asyncio.sleep(max(stamp + latency - loop.time(), 0.0))
            self._world.advance()
            if failing(self._failures, loop.time()):
                raise RuntimeError(FAILS)
            frame = self._faults.expose(stamp, self._world.pose_at, partial(self.expose, stamp, sequence))
            if frame is not None:
                yield frame
            sequence = max(sequence + 1, int((loop.time() - BACKLOG - origin) * self._config.rate))

    def expose(self, stamp: float, sequence: int, pose_at: PoseAt | None = None) -> Frame:
        """What the camera sees with the middle of the exposure, as far as is known, at a recent ``stamp``.

        ``pose_at`` tells the true pose around the stamp where the world itself may not be asked.
        """
        known = pose_at or self._world.pose_at
        if self._world.track is not self._track:
            self._track = self._world.track
            self._camera.look_at(Scene.from_track(self._track))
        exposed = stamp + self.after
        if isinstance(self._camera, CornerCamera):
            return Frame(stamp, sequence, None, self._camera.detect(exposed, known))
        return Frame(stamp, sequence, self._camera.render(exposed, known))


class SimTracker:
    """A tracker on the simulated vehicle; also publishes the truth, for the log, as often.

    Its samples go through ``intake``, if there is one.
    """

    def __init__(
        self,
        config: Config,
        seed: int,
        world: World,
        faults: Sequence[Fault] = (),
        intake: PoseIntake | None = None,
    ) -> None:
        self._world = world
        self._tracker = make_tracker(config, seed)
        self._faults = PoseFaults(faults)
        self._failures = failures(faults, "tracker")
        self._intake = intake
        self._beside: asyncio.Task[None] | None = None

    async def poses(self) -> AsyncIterator[PoseSample]:
        """Samples at the tracker's rate, in order, each when it would arrive."""
        loop = asyncio.get_running_loop()
        origin = loop.time()
        count = 0
        while True:
            stamp = origin + count / self._tracker.rate
            truth = await self._arrive(stamp)
            if failing(self._failures, loop.time()):
                self._beside = asyncio.create_task(self._go_on(stamp), name="world")
                raise RuntimeError(FAILS)
            measured = self._tracker.sample(truth)
            sample = self._faults.apply(measured[0]) if measured is not None else None
            if sample is not None and self._intake is not None:
                sample = self._intake.take(sample, loop.time())
            if sample is not None:
                yield sample
            count = max(count + 1, int((loop.time() - BACKLOG - origin) * self._tracker.rate))

    async def _arrive(self, stamp: float) -> GroundTruth:
        """Let the world go on until what is measured at ``stamp`` arrives; its truth is published and felt."""
        # The plant remembers the motion at the stamp, so that nothing need be done before the arrival.
        await asyncio.sleep(max(stamp + self._tracker.next_latency - asyncio.get_running_loop().time(), 0.0))
        self._world.advance()
        truth = self._world.state_at(stamp)
        self._world.truth.motion.publish(truth)
        self._world.feel(stamp)
        return truth

    async def _go_on(self, stamp: float) -> None:
        """The world does not end with its tracker's driver."""
        while True:
            now = asyncio.get_running_loop().time()
            stamp = max(stamp + 1.0 / self._tracker.rate, now - BACKLOG)
            await self._arrive(stamp)

    async def close(self) -> None:
        """End what goes on beside the driver."""
        if self._beside is not None:
            self._beside.cancel()
            await asyncio.gather(self._beside, return_exceptions=True)

    def report(self) -> str:
        """What became of the samples so far, in one line."""
        return self._intake.report() if self._intake is not None else "poses: not looked at here"


class ModelledWorker:
    """Computes at once and lets the time pass that the configuration says it costs on the target."""

    def __init__(self, config: Config, faults: Sequence[Fault] = ()) -> None:
        self._costs = config.compute.model_dump()
        self._faults = named(faults, "compute_slow")

    async def run(self, name: str, function: Callable[[], T]) -> T:
        """``function()``, available after the configured seconds for ``name``."""
        result = function()
        now = asyncio.get_running_loop().time()
        await asyncio.sleep(self._costs[name] * slow_down(self._faults, now))
        return result

    def close(self) -> None:
        """Nothing to give back."""


class SimRig:
    """A simulated drone in a simulated world, the same for the same ``seed``."""

    def __init__(self, config: Config, track: Track, seed: int) -> None:
        faults = read_faults(config.sim.faults)
        (_, track), *later = rearranged(track, faults)
        seeds = np.random.SeedSequence(seed)
        world_seed, camera_seed, tracker_seed, survey_seed = seeds.spawn(4)
        loop = asyncio.get_running_loop()
        exercise(config, track)
        self._world = World(config, track, world_seed, loop.time, faults)
        for stamp, another in later:
            self._world.rearrange(stamp, another)
        self._survey_seed, self._exact = survey_seed, config.sim.survey == "exact"
        self.autopilot: Autopilot = self._world.autopilot
        self.camera: FrameSource = SimCamera(config, track, number(camera_seed), self._world, faults)
        intake = PoseIntake.of_body(config)
        self._tracker = SimTracker(config, number(tracker_seed), self._world, faults, intake)
        self.tracker: PoseSource = self._tracker
        worker: Worker = ModelledWorker(config, faults) if isinstance(loop, VirtualLoop) else ThreadWorker()
        self.worker: Worker = FaultyWorker(worker, faults, loop.time)
        self.computer: Computer = SimComputer(faults, loop.time)
        if isinstance(loop, VirtualLoop | RealtimeLoop):
            hold_up(loop, faults)
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
        """End what goes on beside the application."""
        await self._tracker.close()


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


def failures(faults: Sequence[Fault], source: str) -> tuple[Fault, ...]:
    """The faults by which the driver of ``source`` raises."""
    return tuple(fault for fault in named(faults, "task_failing") if SOURCES[int(fault.amount[0])] == source)


def failing(failures: Sequence[Fault], now: float) -> bool:
    """Whether the driver fails by ``now``."""
    return any(fault.acts(now) for fault in failures)


def number(seed: np.random.SeedSequence) -> int:
    """A plain number from ``seed``."""
    return int(seed.generate_state(1)[0])
