"""The Protocols that modules and rigs implement.

Algorithms (detector, estimator, planner, controller) are pure and synchronous: stamped data in,
data out, no clock and no asyncio. A rig (the real drone or the simulation) supplies the sensors, the
autopilot, the survey of the track and the worker that pays for computation.
"""

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass
from io import RawIOBase
from pathlib import Path
from typing import Protocol, TypeVar, runtime_checkable

from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import (
    AutopilotStatus,
    Collision,
    CommandArrivals,
    Event,
    Frame,
    GateEstimate,
    GateMap,
    GatePassage,
    GroundTruth,
    ImuSample,
    MarkerDetection,
    PoseSample,
    RateCommand,
    Sightings,
    VehicleState,
)
from flightapp.perception.camera import CameraModel
from flightapp.track import Box, Cylinder, GateShape, Track
from flightapp.trajectory import Trajectory

T = TypeVar("T")


class Detector(Protocol):
    """Finds fiducial markers in a frame."""

    def detect(self, frame: Frame, regions: Sequence[Vector] | None) -> tuple[MarkerDetection, ...]:
        """Markers in ``frame``; ``regions`` are (4,) x0, y0, x1, y1 pixel boxes to search, None for all of it."""
        ...


class Estimator(Protocol):
    """Estimates the vehicle's state and the gates' places from all that is measured. Times ascend."""

    def on_pose(self, sample: PoseSample) -> VehicleState | None:
        """The state at ``sample``'s stamp; None where that is not newer than what is known."""
        ...

    def on_imu(self, sample: ImuSample) -> VehicleState | None:
        """Take ``sample`` over; the state at its stamp where it stands in for poses that are missing, else None."""
        ...

    def on_sightings(self, seen: Sightings) -> bool:
        """Use what was seen at an exposure that the poses have passed; whether that changed the gate map."""
        ...

    def gate_map(self, stamp: float) -> GateMap:
        """The gates as they stand, stamped ``stamp``."""
        ...

    def places(self) -> tuple[GateEstimate, ...]:
        """The same gates with their covariances in the world, to be kept for another flight."""
        ...

    def take_notices(self) -> tuple[str, ...]:
        """What there is to tell since the last call, in words."""
        ...


@dataclass(frozen=True, slots=True)
class Motion:
    """A point of a trajectory to start or end with; world frame, each (3,) but the yaws."""

    position: Vector
    velocity: Vector
    acceleration: Vector
    jerk: Vector
    yaw: float
    yaw_rate: float


@dataclass(frozen=True, slots=True)
class Limits:
    """What a plan must keep to, besides what the vehicle can do."""

    v_max: float
    """m/s, length of the velocity vector; infinite for no limit."""
    a_max: float
    """m/s², length of the acceleration vector; infinite for no limit."""
    yaw_rate_max: float
    """rad/s."""


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Fly from ``start`` through ``gates`` in order to rest at ``end``."""

    stamp: float
    """The moment at which the trajectory starts."""
    start: Motion
    gates: tuple[GateEstimate, ...]
    end: Vector
    """(3,) m, where to come to rest."""
    limits: Limits
    look_at: Vector | None = None
    """(3,) m, what the camera should watch after the last gate; None to look along the path."""
    arrival: Vector | None = None
    """(3, 3) velocity, acceleration and jerk with which to arrive at `end`; None to rest there."""
    shape: GateShape | None = None
    """Of the gates; None where only their centres are known to be free."""
    obstacles: tuple[Box | Cylinder, ...] = ()
    """What to keep clear of."""
    frames: tuple[GateEstimate, ...] = ()
    """Other gates, such as those that were passed, whose frames are to be kept clear of as well."""


class PlanningError(Exception):
    """No trajectory could be found; the text says why."""


class Planner(Protocol):
    """Finds trajectories."""

    def plan(self, request: PlanRequest) -> Trajectory:
        """A trajectory that answers ``request``; raises `PlanningError`."""
        ...

    def through(self, waypoints: Vector, request: PlanRequest) -> Trajectory:
        """A trajectory through ``waypoints`` (n, 3), then to ``request.end``; its gates are not used."""
        ...


class Controller(Protocol):
    """Tracks a trajectory."""

    @property
    def push(self) -> float:
        """m/s², the steady horizontal push, such as the wind's, that it has learnt to lean against."""
        ...

    @property
    def report(self) -> str:
        """What there is to tell of its commands so far, in one line; empty for nothing."""
        ...

    def reset(self) -> None:
        """Forget integrators and filters, at the start of a new flight."""
        ...

    def command(self, stamp: float, state: VehicleState, trajectory: Trajectory) -> RateCommand:
        """Body rates and specific force to send at ``stamp``, from the newest ``state``."""
        ...


@runtime_checkable
class Tunable(Protocol):
    """A controller whose gains may change in flight."""

    def retune(self, config: Config) -> None:
        """Go on with the control section of ``config``: all of it from the next command on, and nothing forgotten."""
        ...


@runtime_checkable
class WithFallback(Protocol):
    """A controller that plans its commands, and for which another stands in where it cannot."""

    @property
    def fallbacks(self) -> Mapping[str, int]:
        """Commands of the one that stands in, by their reason, since this was made."""
        ...


class FrameSource(Protocol):
    """A camera."""

    @property
    def model(self) -> CameraModel:
        """Its calibration, as the flight code believes it to be."""
        ...

    def frames(self) -> AsyncIterator[Frame]:
        """Frames as they become available."""
        ...


@runtime_checkable
class Telling(Protocol):
    """A camera that has things to tell, such as that it was unplugged."""

    @property
    def notices(self) -> Topic[Event]:
        """In words, for the log."""
        ...


class PoseSource(Protocol):
    """A tracker, with its mount already taken out: poses of the body."""

    def poses(self) -> AsyncIterator[PoseSample]:
        """Samples as they arrive."""
        ...

    def report(self) -> str:
        """What became of the samples so far, in one line."""
        ...


class AutopilotError(Exception):
    """The autopilot refused or did not answer; the text says what and why."""


class Autopilot(Protocol):
    """The autopilot behind its link."""

    @property
    def status(self) -> Topic[AutopilotStatus]:
        """What it last said of itself."""
        ...

    @property
    def imu(self) -> Topic[ImuSample]:
        """What its inertial sensors measured."""
        ...

    @property
    def notices(self) -> Topic[Event]:
        """What it, or its link, has to tell in words, for the log."""
        ...

    async def connect(self) -> None:
        """Find the vehicle; raises `AutopilotError`."""
        ...

    async def takeoff(self, height: float) -> None:
        """Select the autopilot's own takeoff to ``height`` m above the ground; it begins when armed."""
        ...

    async def arm(self) -> None:
        """Arm; raises `AutopilotError` with the autopilot's reason."""
        ...

    async def disarm(self) -> None:
        """Disarm on the ground; raises `AutopilotError` with the autopilot's reason."""
        ...

    async def kill(self) -> None:
        """Stop the motors at once, in the air too; raises `AutopilotError`."""
        ...

    async def hold(self) -> None:
        """Stop and hold the position by the autopilot's own means."""
        ...

    async def land(self) -> None:
        """Land here and disarm by the autopilot's own means."""
        ...

    async def start_offboard(self) -> None:
        """Follow `send`; at least one command must have been sent just before."""
        ...

    def send(self, command: RateCommand) -> None:
        """Send one command at once, without blocking."""
        ...

    def send_pose(self, sample: PoseSample) -> None:
        """Offer the tracker's newest pose to the autopilot's own estimator, without blocking."""
        ...

    async def close(self) -> None:
        """Give the link back."""
        ...


class Worker(Protocol):
    """Runs computation that takes more than half a millisecond."""

    async def run(self, name: str, function: Callable[[], T]) -> T:
        """``function()``'s result, computed where it holds nothing up; ``name`` says what it is."""
        ...

    def close(self) -> None:
        """Give back what it holds."""
        ...


class Computer(Protocol):
    """The computer that the application runs on."""

    def disk_free(self, directory: Path) -> float:
        """MB that are free where ``directory`` is; NaN where that can't be told."""
        ...

    def clock_offset(self) -> float:
        """s by which the wall clock is ahead of the event loop's time."""
        ...

    def create(self, path: Path) -> RawIOBase:
        """A new file to write to, unbuffered; raises OSError, also later at each write."""
        ...


@dataclass(frozen=True, slots=True)
class GroundTruthFeed:
    """Truth for the log, from the simulator or motion capture; no flight code may read it."""

    motion: Topic[GroundTruth]
    passages: Topic[GatePassage]
    collisions: Topic[Collision]
    gates: Topic[tuple[GateEstimate, ...]]
    arrivals: Topic[CommandArrivals]


class Rig(Protocol):
    """A drone, real or simulated, and how the world around it is known."""

    autopilot: Autopilot
    camera: FrameSource
    tracker: PoseSource
    worker: Worker
    computer: Computer
    truth: GroundTruthFeed | None

    def survey(self, track: Track) -> Track:
        """``track`` as it is known before the flight."""
        ...

    async def close(self) -> None:
        """Give back what the rig itself holds, after the autopilot and the worker have been closed."""
        ...
