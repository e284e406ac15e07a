"""What there is to say of a plan: its tables and its numbers."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flightapp.config import Config
from flightapp.evaluation.tables import NONE, TextTable, number
from flightapp.frames import Vector
from flightapp.interfaces import PlanRequest
from flightapp.track import Track
from flightapp.trajectory import Trajectory

LENGTH_STEP = 5e-3
"""s between the points whose distances make the length."""
TOLERANCE = 1e-3
"""Relative excess over a limit that counts as none."""


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A trajectory, what it was asked for, and what it took."""

    trajectory: Trajectory
    request: PlanRequest
    track: Track
    config: Config
    planner: str
    first: float
    """s that the first plan took, compilation included."""
    again: float | None
    """s that the same plan took when it was made again, the least of some; None where once was long enough."""

    @property
    def length(self) -> float:
        """m, of the path."""
        count = math.ceil(self.trajectory.duration / LENGTH_STEP) + 1
        path = self.trajectory.sample(np.linspace(0.0, self.trajectory.duration, count)).position
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True)
class Bound:
    """How close a plan comes to one limit."""

    name: str
    unit: str
    peak: float
    limit: float
    least: bool = False
    """Whether ``peak`` may not be less than ``limit``, rather than not more."""

    @property
    def kept(self) -> bool:
        """Whether the plan keeps to it."""
        if self.least:
            return self.peak >= self.limit * (1.0 - TOLERANCE)
        return self.peak <= self.limit * (1.0 + TOLERANCE)


@dataclass(frozen=True, slots=True)
class PlannedGate:
    """How a plan flies through one gate."""

    gate_id: int
    time: float
    """s since the start."""
    offset: float
    """m from the gate's centre."""
    angle: float
    """rad between the velocity and the direction of passage."""
    speed: float
    """m/s."""


def bounds(planned: Planned) -> tuple[Bound, ...]:
    """Peaks by dense check beside the limits of the request and of the vehicle."""
    config, limits, peaks = planned.config, planned.request.limits, planned.trajectory.limits()
    thrust = config.planning.thrust_share * config.vehicle.thrust_max
    rate = config.planning.rate_share * config.vehicle.rate_max
    return (
        Bound("speed", "m/s", peaks.speed, limits.v_max),
        Bound("acceleration", "m/s²", peaks.acceleration, limits.a_max),
        Bound("specific force", "m/s²", peaks.specific_force, thrust),
        Bound("least specific force", "m/s²", peaks.specific_force_min, config.guard.thrust_min, least=True),
        Bound("body rate", "rad/s", peaks.body_rate, rate),
        Bound("yaw rate", "rad/s", peaks.yaw_rate, limits.yaw_rate_max),
        Bound("yaw acceleration", "rad/s²", peaks.yaw_acceleration, config.planning.yaw_acceleration),
    )


def planned_gates(planned: Planned) -> tuple[PlannedGate, ...]:
    """Each passage of a gate, in order."""
    trajectory = planned.trajectory
    made = []
    for gate, time in zip(planned.request.gates, trajectory.gate_times, strict=False):
        at = trajectory.sample(time)
        speed = float(np.linalg.norm(at.velocity))
        along = float(at.velocity[0] * math.cos(gate.yaw) + at.velocity[1] * math.sin(gate.yaw))
        angle = math.acos(min(max(along / speed, -1.0), 1.0)) if speed > 0.0 else 0.0
        offset = float(np.linalg.norm(at.position - gate.position))
        made.append(PlannedGate(gate.gate_id, time, offset, angle, speed))
    return tuple(made)


def plan_tables(planned: Planned) -> tuple[TextTable, ...]:
    """The plan as a whole, its limits, its gates."""
    duration, length = planned.trajectory.duration, planned.length
    row = [planned.planner, number(duration, 3), number(length, 2), number(length / duration, 2)]
    row += [number(planned.first, 3, 1e3), number(planned.again, 3, 1e3)]
    columns = ("planner", "duration s", "length m", "mean speed m/s", "first plan ms", "again ms")
    tables = [TextTable(f"Plan of {planned.track.name}", columns, [row]), _limit_table(bounds(planned))]
    gates = planned_gates(planned)
    rows = [
        [str(g.gate_id), *(number(v, 3) for v in (g.time, g.speed, g.offset)), number(math.degrees(g.angle), 1)]
        for g in gates
    ]
    if rows:
        tables.append(TextTable("Gates", ("gate", "time s", "speed m/s", "offset m", "angle °"), rows))
    return tuple(tables)


def _limit_table(found: Sequence[Bound]) -> TextTable:
    rows = []
    for bound in found:
        limited = math.isfinite(bound.limit)
        limit, share = NONE, NONE
        if limited:
            limit = number(bound.limit, 3)
            share = NONE if bound.least else f"{100.0 * bound.peak / bound.limit:.1f} %"
        kept = "yes" if bound.kept else "NO"
        rows.append([f"{bound.name}, {bound.unit}", number(bound.peak, 3), limit, share, kept])
    return TextTable("Peaks", ("", "peak", "limit", "share", "kept"), rows)


def plan_json(planned: Planned) -> dict[str, Any]:
    """The same as the tables say, with SI units; a limit that there is not is null."""
    return {
        "track": planned.track.name,
        "planner": planned.planner,
        "duration": planned.trajectory.duration,
        "length": planned.length,
        "plan_time": {"first": planned.first, "again": planned.again},
        "limits": [
            {
                "name": bound.name,
                "peak": bound.peak,
                "limit": bound.limit if math.isfinite(bound.limit) else None,
                "kept": bound.kept,
            }
            for bound in bounds(planned)
        ],
        "gates": [asdict(gate) for gate in planned_gates(planned)],
    }


def heading_ticks(trajectory: Trajectory, interval: float, length: float) -> Vector:
    """(2, n, 2) m, starts and ends in the plane of short lines that show where the camera looks."""
    samples = trajectory.sample(np.arange(0.0, trajectory.duration, interval))
    feet = samples.position[:, :2]
    return np.stack((feet, feet + length * np.column_stack((np.cos(samples.yaw), np.sin(samples.yaw)))))
