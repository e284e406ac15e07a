"""A recorded flight: every stream as arrays or tuples, ready for metrics and figures."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.messages import (
    AutopilotStatus,
    Collision,
    CommandArrivals,
    Event,
    GateEstimate,
    GateMap,
    GatePassage,
    PlanReport,
    ProcessLoad,
    Sightings,
)
from flightapp.trajectory import Trajectory


def _empty(*shape: int) -> Vector:
    return np.zeros((0, *shape))


@dataclass(frozen=True, slots=True)
class Motions:
    """Positions and velocities over time, n rows; world frame, but the angular velocity (body)."""

    stamp: Vector = field(default_factory=_empty)
    """(n,) s."""
    position: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m."""
    orientation: Vector = field(default_factory=lambda: _empty(4))
    """(n, 4) q_wb."""
    velocity: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m/s."""
    angular_velocity: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) rad/s."""


@dataclass(frozen=True, slots=True)
class Poses(Motions):
    """The tracker's samples, in its own frame."""

    confidence: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    """(n,)."""
    acceleration: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m/s², without gravity; NaN where the tracker did not tell."""
    epoch: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    """(n,), another number for another place of the tracker's frame."""


@dataclass(frozen=True, slots=True)
class States(Motions):
    """The estimates."""

    variance: Vector = field(default_factory=lambda: _empty(9))
    """(n, 9): position (m²), velocity (m²/s²), rotation vector in body axes (rad²)."""
    doubtful: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    """(n,), 1 where the estimator said that it is not to be trusted."""
    position_covariance: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m²: of the position's covariance xy, xz and yz."""


@dataclass(frozen=True, slots=True)
class Setpoints:
    """The references, n rows; world frame."""

    stamp: Vector = field(default_factory=_empty)
    """(n,) s."""
    position: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m."""
    velocity: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m/s."""
    acceleration: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m/s²."""
    jerk: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m/s³."""
    yaw: Vector = field(default_factory=_empty)
    """(n,) rad."""
    yaw_rate: Vector = field(default_factory=_empty)
    """(n,) rad/s."""


@dataclass(frozen=True, slots=True)
class Inertial:
    """What the autopilot's inertial sensors measured, n rows; body."""

    stamp: Vector = field(default_factory=_empty)
    """(n,) s."""
    specific_force: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) m/s²."""
    angular_velocity: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) rad/s."""


@dataclass(frozen=True, slots=True)
class Commands:
    """What was sent to the autopilot, n rows."""

    stamp: Vector = field(default_factory=_empty)
    """(n,) s."""
    rates: Vector = field(default_factory=lambda: _empty(3))
    """(n, 3) rad/s, body."""
    thrust: Vector = field(default_factory=_empty)
    """(n,) m/s²."""


@dataclass(frozen=True, slots=True)
class Stages:
    """How old measurements were when stages had their results, n rows."""

    stamp: Vector = field(default_factory=_empty)
    """(n,) s, when the result was there."""
    stage: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    """(n,), a `Stage`."""
    captured: Vector = field(default_factory=_empty)
    """(n,) s, stamps of the measurements."""
    begun: Vector = field(default_factory=_empty)
    """(n,) s, when the stage set to work."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A camera image as it was recorded."""

    stamp: float
    """Of its exposure."""
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class Flight:
    """All that a log holds; a stream that was not recorded is empty. Each stream is in the order of its stamps."""

    header: Mapping[str, str] = field(default_factory=dict)
    """What the application noted: "mission", "seed", "track" (JSON), "config" (TOML), "outcome" …"""
    complete: bool = True
    """Whether the log was closed; a log that was cut off holds what was whole."""
    poses: Poses = field(default_factory=Poses)
    states: States = field(default_factory=States)
    setpoints: Setpoints = field(default_factory=Setpoints)
    commands: Commands = field(default_factory=Commands)
    truth: Motions = field(default_factory=Motions)
    maps: tuple[GateMap, ...] = ()
    true_gates: tuple[tuple[GateEstimate, ...], ...] = ()
    """The true gates, as often as they were reported."""
    sightings: tuple[Sightings, ...] = ()
    trajectories: tuple[Trajectory, ...] = ()
    statuses: tuple[AutopilotStatus, ...] = ()
    events: tuple[Event, ...] = ()
    plans: tuple[PlanReport, ...] = ()
    passages: tuple[GatePassage, ...] = ()
    collisions: tuple[Collision, ...] = ()
    arrivals: tuple[CommandArrivals, ...] = ()
    loads: tuple[ProcessLoad, ...] = ()
    imu: Inertial = field(default_factory=Inertial)
    stages: Stages = field(default_factory=Stages)
    pictures: tuple[Picture, ...] = ()

    @property
    def has_truth(self) -> bool:
        """Whether ground truth was recorded."""
        return self.truth.stamp.size > 0
