"""The data that flows between tasks: frozen, stamped, with a shape and a unit on every field.

Stamps are monotonic seconds at *capture*. Frames and rotations are those of `frames`.
"""

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MarkerDetection:
    """One fiducial marker in an image."""

    marker_id: int
    corners: Vector
    """(4, 2) pixels: the marker's own top left, top right, bottom right, bottom left."""
    quality: float = 1.0
    """Of the reading, 0 to 1: the part of the contrast between black and white that is as the code wants it in the
    worst cell."""
    noise: float = math.nan
    """px, standard deviation of a corner that the detector expects; NaN where it does not tell."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One exposure of the camera."""

    stamp: float
    """Middle of the exposure."""
    sequence: int
    image: NDArray[np.uint8] | None
    """(height, width) grey; None from a camera that finds the markers itself."""
    markers: tuple[MarkerDetection, ...] = ()
    """What a camera that finds the markers itself has found."""


@dataclass(frozen=True, slots=True)
class GateSighting:
    """The pose of one gate relative to the body at the moment of exposure."""

    stamp: float
    gate_id: int
    position: Vector
    """(3,) m, gate centre in the body frame."""
    orientation: Vector
    """(4,) q_bg: gate to body."""
    covariance: Vector
    """(6, 6): position in body axes (m²), then rotation vector in gate axes (rad²)."""
    alternative: tuple[Vector, Vector] | None
    """The other pose (position, orientation) that explains an ambiguous square nearly as well."""
    markers: int
    """How many of the gate's markers were used."""
    reprojection: float
    """RMS distance between seen and reprojected corners, pixels."""


@dataclass(frozen=True, slots=True)
class Sightings:
    """All that was seen in one frame."""

    stamp: float
    sequence: int
    markers: tuple[MarkerDetection, ...]
    gates: tuple[GateSighting, ...]


@dataclass(frozen=True, slots=True)
class PoseSample:
    """The body's pose in the tracker's own drifting frame (odom), whose z is up."""

    stamp: float
    position: Vector
    """(3,) m, odom."""
    orientation: Vector
    """(4,) q_ob: body to odom."""
    velocity: Vector
    """(3,) m/s, odom."""
    angular_velocity: Vector
    """(3,) rad/s, body."""
    confidence: int
    """0 (failed) to 3 (high), as the T265 reports it."""
    acceleration: Vector | None = None
    """(3,) m/s², odom, without gravity; None where the tracker doesn't tell."""
    epoch: int = 0
    """Counts relocalisations: samples of one epoch share one frame, another epoch's frame lies elsewhere."""


@dataclass(frozen=True, slots=True)
class ImuSample:
    """What the autopilot's inertial sensors measured."""

    stamp: float
    specific_force: Vector
    """(3,) m/s², body: what an accelerometer feels, +g along z at rest."""
    angular_velocity: Vector
    """(3,) rad/s, body."""


@dataclass(frozen=True, slots=True)
class Drift:
    """Where the tracker's frame lies in the world: p_w = R_z(yaw) p_o + translation."""

    stamp: float
    translation: Vector
    """(3,) m."""
    yaw: float
    """rad."""
    covariance: Vector
    """(4, 4): translation (m²), yaw (rad²)."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The best estimate of the vehicle's motion."""

    stamp: float
    position: Vector
    """(3,) m, world."""
    orientation: Vector
    """(4,) q_wb."""
    velocity: Vector
    """(3,) m/s, world."""
    angular_velocity: Vector
    """(3,) rad/s, body."""
    covariance: Vector
    """(9, 9): position (m²), velocity (m²/s²), rotation vector in body axes (rad²)."""
    doubt: str = ""
    """Why it is not to be trusted; empty where it is."""


@dataclass(frozen=True, slots=True)
class GateEstimate:
    """What is known of one gate."""

    gate_id: int
    position: Vector
    """(3,) m, centre of the opening, world."""
    yaw: float
    """rad, direction of passage."""
    covariance: Vector
    """(4, 4): position (m²) and yaw (rad²) relative to the vehicle's, which is what flying through it takes."""
    sightings: int
    last_seen: float
    """Stamp of the last sighting used; -inf before the first."""
    surveyed: bool = False
    """Whether the survey alone says well enough where it is to fly through it."""


@dataclass(frozen=True, slots=True)
class GateMap:
    """The gates whose places are known, in the order of passage, and the tracker's drift estimated with them."""

    stamp: float
    version: int
    gates: tuple[GateEstimate, ...]
    drift: Drift


@dataclass(frozen=True, slots=True)
class Setpoint:
    """The reference at one moment, as the controller was given it."""

    stamp: float
    position: Vector
    """(3,) m, world."""
    velocity: Vector
    """(3,) m/s."""
    acceleration: Vector
    """(3,) m/s²."""
    jerk: Vector
    """(3,) m/s³."""
    yaw: float
    """rad."""
    yaw_rate: float
    """rad/s."""


@dataclass(frozen=True, slots=True)
class RateCommand:
    """What the autopilot is asked to do."""

    stamp: float
    rates: Vector
    """(3,) rad/s, body (FLU)."""
    thrust: float
    """Collective specific force along body z, m/s²."""


class FlightMode(StrEnum):
    """The autopilot's flight modes that the application knows."""

    MANUAL = "manual"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    OFFBOARD = "offboard"
    LAND = "land"
    DESCEND = "descend"
    STABILIZED = "stabilized"
    ACRO = "acro"
    ALTITUDE = "altitude"
    POSITION = "position"
    MISSION = "mission"
    RETURN = "return"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class AutopilotStatus:
    """What the autopilot says of itself."""

    stamp: float
    mode: FlightMode
    armed: bool
    landed: bool
    ready: bool
    """It has a local position."""
    voltage: float
    """V, battery under load."""
    battery: float
    """0..1, charge left."""


class Outcome(StrEnum):
    """How a behavior, or a whole mission, ended."""

    GOAL_ACHIEVED = "GOAL_ACHIEVED"
    WRONG_PROGRESS = "WRONG_PROGRESS"
    PROCESS_FAILURE = "PROCESS_FAILURE"
    TIME_OUT = "TIME_OUT"
    INTERRUPTED = "INTERRUPTED"


class Phase(StrEnum):
    """States of the mission state machine."""

    IDLE = "idle"
    PREFLIGHT = "preflight"
    ARMED = "armed"
    TAKEOFF = "takeoff"
    FLYING = "flying"
    LANDING = "landing"
    LANDED = "landed"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth knowing: a phase, a behavior's end, a fault, a plan that was refused."""

    stamp: float
    kind: str
    """One of: phase, behavior, fault, plan, gate, poses, camera, realtime, referee, autopilot, guard, tuning."""
    text: str


@dataclass(frozen=True, slots=True)
class PlanReport:
    """One call of the planner."""

    stamp: float
    elapsed: float
    """s from the request to the trajectory's being available."""
    accepted: bool
    reason: str
    """Why it was refused; empty when accepted."""


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """The true motion of the body, from the simulator or a motion-capture system. For the log only."""

    stamp: float
    position: Vector
    """(3,) m, world."""
    orientation: Vector
    """(4,) q_wb."""
    velocity: Vector
    """(3,) m/s, world."""
    angular_velocity: Vector
    """(3,) rad/s, body."""


@dataclass(frozen=True, slots=True)
class GatePassage:
    """A referee's verdict by ground truth: the body went through a gate's opening."""

    stamp: float
    gate_id: int
    offset: float
    """m from the gate's centre, in its plane."""


@dataclass(frozen=True, slots=True)
class Collision:
    """A referee's verdict by ground truth: the body touched something."""

    stamp: float
    obstacle: str
    speed: float
    """m/s at the touch."""


@dataclass(frozen=True, slots=True)
class CommandArrivals:
    """When commands reached a simulated autopilot at the other end of its link. For the log only."""

    stamp: float
    """The newest arrival."""
    stamps: Vector
    """(n,) s, arrivals since the last message."""


class Stage(IntEnum):
    """Where on the way from a measurement to a command the time is taken."""

    DETECTION = 0
    """A frame's sightings are there."""
    COMMAND = 1
    """A command has been handed to the autopilot."""


@dataclass(frozen=True, slots=True)
class StageTime:
    """How old a measurement was when a stage had its result. For the log only."""

    stamp: float
    """When the result was there."""
    stage: Stage
    captured: float
    """Stamp of the measurement: the frame's exposure, or the pose behind the state that was steered by."""
    begun: float
    """When the stage set to work on it."""


@dataclass(frozen=True, slots=True)
class ProcessLoad:
    """What the application's process takes of its computer."""

    stamp: float
    cpu: float
    """s of CPU time since it was started, all threads."""
    memory: float
    """bytes that are resident."""
