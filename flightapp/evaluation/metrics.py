"""The racing metrics of one flight.

Errors are the paper's: the reference against the estimator (tracking), the estimator against ground truth
(estimation), per axis. "total" is √(mean ‖e‖²), the root of the summed squares of the axes' RMSEs. The
paper's own totals are near that but not it (its Table 1, v_max 3: 0.138 m where the axes give 0.155 m), and
it doesn't say how it makes them.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.evaluation.flight import Flight, Motions, Setpoints, States
from flightapp.frames import Vector
from flightapp.messages import Phase, PlanReport
from flightapp.timing import TickStatistics


@dataclass(frozen=True, slots=True)
class Window:
    """The part of a flight that is judged, in stamps."""

    start: float
    end: float

    @property
    def duration(self) -> float:
        """s."""
        return self.end - self.start

    def holds(self, stamps: Vector) -> NDArray[np.bool_]:
        """Whether each of ``stamps`` (n,) lies inside."""
        inside: NDArray[np.bool_] = (stamps >= self.start) & (stamps <= self.end)
        return inside


@dataclass(frozen=True, slots=True)
class Rmse:
    """Root mean square of an error: per axis, and √(mean ‖e‖²)."""

    x: float
    y: float
    z: float
    total: float


@dataclass(frozen=True, slots=True)
class Speeds:
    """Peak speed, and mean speed over time; m/s."""

    peak: float
    mean: float


@dataclass(frozen=True, slots=True)
class PlanStatistics:
    """Plans flown and refused, and how long all of them took (s from request to availability; NaN if none)."""

    count: int
    refused: int
    p50: float
    p99: float


def racing_window(flight: Flight) -> Window:
    """From the phase "flying" to the next other phase, or the log's end; all of the log if it never flew."""
    streams = (flight.states.stamp, flight.commands.stamp, flight.truth.stamp)
    stamps = [float(stamp) for stream in streams if stream.size for stamp in (stream[0], stream[-1])]
    stamps += [event.stamp for event in flight.events]
    first, last = min(stamps, default=0.0), max(stamps, default=0.0)
    start = None
    for event in flight.events:
        if event.kind != "phase":
            continue
        flying = event.text.startswith(Phase.FLYING.value)
        if flying and start is None:
            start = event.stamp
        elif start is not None and not flying:
            return Window(start, event.stamp)
    return Window(first if start is None else start, last)


def interpolated(stamps: Vector, values: Vector, at: Vector) -> Vector:
    """``values`` (n, k) at ``stamps`` (n,), read at ``at`` (m,) on straight lines between: (m, k)."""
    columns = [np.interp(at, stamps, values[:, axis]) for axis in range(values.shape[1])]
    return np.stack(columns, axis=1)


def position_error(reference: Motions | Setpoints, actual: Motions, window: Window) -> tuple[Vector, Vector]:
    """Stamps (m,) of ``reference`` inside ``window`` and ``actual``, and reference − actual (m, 3) in m."""
    at = _common(reference.stamp, actual.stamp, window)
    return reference.stamp[at], reference.position[at] - _read(actual, actual.position, reference.stamp[at])


def velocity_error(reference: Motions | Setpoints, actual: Motions, window: Window) -> tuple[Vector, Vector]:
    """As `position_error`, of the velocity in m/s."""
    at = _common(reference.stamp, actual.stamp, window)
    return reference.stamp[at], reference.velocity[at] - _read(actual, actual.velocity, reference.stamp[at])


def position_nees(states: States, truth: Motions, window: Window) -> float | None:
    """Mean of eᵀ P⁻¹ e of the position, 3 for a consistent estimator; None where there is nothing to compare.

    Y. Bar-Shalom, X. Li and T. Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), 5.4.2.
    """
    at = _common(states.stamp, truth.stamp, window)
    _, error = position_error(states, truth, window)
    if error.shape[0] == 0:
        return None
    P = np.empty((error.shape[0], 3, 3))
    P[:, (0, 1, 2), (0, 1, 2)] = states.variance[at, :3]
    P[:, (0, 0, 1), (1, 2, 2)] = P[:, (1, 2, 2), (0, 0, 1)] = states.position_covariance[at]
    return float(np.mean(np.einsum("ni,ni->n", error, np.linalg.solve(P, error[..., None])[..., 0])))


def rmse(error: Vector) -> Rmse | None:
    """Root mean square of ``error`` (n, 3); None of nothing."""
    if error.shape[0] == 0:
        return None
    squares = np.mean(error * error, axis=0)
    x, y, z = np.sqrt(squares)
    return Rmse(float(x), float(y), float(z), math.sqrt(float(np.sum(squares))))


def speeds(motion: Motions, window: Window) -> Speeds | None:
    """Peak and mean speed of ``motion``; None if it has no rows in ``window``."""
    inside = window.holds(motion.stamp)
    if not np.any(inside):
        return None
    stamp, speed = motion.stamp[inside], np.linalg.norm(motion.velocity[inside], axis=1)
    if stamp[-1] <= stamp[0]:
        return Speeds(float(speed[0]), float(speed[0]))
    mean = np.trapezoid(speed, stamp) / (stamp[-1] - stamp[0])
    return Speeds(float(np.max(speed)), float(mean))


def plan_statistics(plans: tuple[PlanReport, ...], window: Window) -> PlanStatistics:
    """How the planner did inside ``window``."""
    inside = [plan for plan in plans if window.start <= plan.stamp <= window.end]
    accepted = sum(plan.accepted for plan in inside)
    if not inside:
        return PlanStatistics(0, 0, math.nan, math.nan)
    p50, p99 = np.percentile([plan.elapsed for plan in inside], (50.0, 99.0))
    return PlanStatistics(accepted, len(inside) - accepted, float(p50), float(p99))


def sender_statistics(stamps: Vector, window: Window, rate: float | None = None) -> TickStatistics | None:
    """Punctuality of commands with ``stamps`` (n,); None of fewer than two.

    ``rate`` in Hz is what was asked for (None: one over the median interval); an interval as long as n + 1
    periods counts as n overruns.
    """
    stamps = stamps[window.holds(stamps)]
    if stamps.size < 2 or stamps[-1] <= stamps[0]:
        return None
    between = np.diff(stamps)
    p50, p99, p999 = np.percentile(between, (50.0, 99.0, 99.9))
    period = 1.0 / rate if rate else float(p50)
    missed = np.maximum(np.rint(between / period) - 1.0, 0.0) if period > 0.0 else np.zeros(1)
    actual = (stamps.size - 1) / (stamps[-1] - stamps[0])
    return TickStatistics(float(actual), float(p50), float(p99), float(p999), int(np.sum(missed)))


def _common(stamps: Vector, other: Vector, window: Window) -> NDArray[np.bool_]:
    if other.size == 0:
        return np.zeros(stamps.size, np.bool_)
    shared = Window(max(window.start, float(other[0])), min(window.end, float(other[-1])))
    return shared.holds(stamps)


def _read(motion: Motions, values: Vector, at: Vector) -> Vector:
    return interpolated(motion.stamp, values, at) if at.size else np.zeros((0, values.shape[1]))
