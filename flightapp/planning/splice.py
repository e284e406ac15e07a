"""Whether a trajectory may take over from a motion: no jump where it starts, none within it, at rest where it ends."""

import numpy as np

from flightapp.frames import Vector
from flightapp.interfaces import Motion
from flightapp.trajectory import ORDER, Trajectory

JUMP = 1e-6
"""Greatest jump of position (m), its derivatives (m/s, m/s², m/s³), yaw (rad) and yaw rate (rad/s)."""
UNITS = {
    "position": "m",
    "velocity": "m/s",
    "acceleration": "m/s²",
    "jerk": "m/s³",
    "yaw": "rad",
    "yaw rate": "rad/s",
}


def splice_fault(trajectory: Trajectory, motion: Motion | None) -> str:
    """Why ``trajectory`` may not take over from ``motion`` at its stamp; empty where it may.

    Without a motion (None) it may start anyhow. The jerk may jump within a trajectory, as that of a time-optimal
    one does, but not where it takes over.
    """
    if fault := _unusable(trajectory):
        return fault
    if motion is not None and (fault := _named(_start_jumps(trajectory, motion))):
        return f"its start does not match the line: {fault}"
    if fault := _named(_inner_jumps(trajectory)):
        return f"it is not smooth: {fault} between two of its segments"
    if fault := _named(_end_jumps(trajectory)):
        return f"it does not end at rest: {fault} at its end"
    return ""


def _unusable(trajectory: Trajectory) -> str:
    arrays = (trajectory.knots, trajectory.coefficients, trajectory.yaw_knots, trajectory.yaw_coefficients)
    if not (np.isfinite(trajectory.stamp) and all(np.isfinite(array).all() for array in arrays)):
        return "the trajectory is not finite"
    for name, knots in (("segments", trajectory.knots), ("pieces of the heading", trajectory.yaw_knots)):
        if np.diff(knots).min() <= 0.0:
            return f"the trajectory's {name} do not all take some time: {np.diff(knots).min():.3g} s"
    return ""


def _start_jumps(trajectory: Trajectory, motion: Motion) -> dict[str, float]:
    first = trajectory.sample(0.0)
    return {
        "position": _length(first.position - motion.position),
        "velocity": _length(first.velocity - motion.velocity),
        "acceleration": _length(first.acceleration - motion.acceleration),
        "jerk": _length(first.jerk - motion.jerk),
        "yaw": abs(float(first.yaw) - motion.yaw),
        "yaw rate": abs(float(first.yaw_rate) - motion.yaw_rate),
    }


def _inner_jumps(trajectory: Trajectory) -> dict[str, float]:
    c, yaw = trajectory.coefficients, trajectory.yaw_coefficients
    ends = _ends(c[:-1], np.diff(trajectory.knots)[:-1], 3)
    yaw_ends = _ends(yaw[:-1], np.diff(trajectory.yaw_knots)[:-1], 2)
    return {
        "position": _length(ends[0] - c[1:, :, 0]),
        "velocity": _length(ends[1] - c[1:, :, 1]),
        "acceleration": _length(ends[2] - 2.0 * c[1:, :, 2]),
        "yaw": float(np.abs(yaw_ends[0] - yaw[1:, 0]).max(initial=0.0)),
        "yaw rate": float(np.abs(yaw_ends[1] - yaw[1:, 1]).max(initial=0.0)),
    }


def _end_jumps(trajectory: Trajectory) -> dict[str, float]:
    """What is left of the motion at the end, where the line stands still."""
    last = trajectory.sample(np.array((trajectory.duration, float(trajectory.yaw_knots[-1]))))
    return {
        "velocity": _length(last.velocity[0]),
        "acceleration": _length(last.acceleration[0]),
        "yaw rate": abs(float(last.yaw_rate[1])),
    }


def _ends(coefficients: Vector, durations: Vector, count: int) -> list[Vector]:
    """Value and derivatives, ``count`` in all, at the end of polynomials (n, …, k) of ``durations`` (n,)."""
    places = durations.reshape(-1, *([1] * (coefficients.ndim - 2)))
    ends = []
    terms = coefficients
    for _ in range(count):
        total = np.zeros(terms.shape[:-1])
        for k in range(terms.shape[-1] - 1, -1, -1):
            total = total * places + terms[..., k]
        ends.append(total)
        terms = terms[..., 1:] * np.arange(1.0, min(terms.shape[-1], ORDER))
    return ends


def _length(rows: Vector) -> float:
    """The greatest length of a (3,) or of rows (n, 3)."""
    return float(np.sqrt((rows * rows).sum(axis=-1)).max(initial=0.0))


def _named(jumps: dict[str, float]) -> str:
    """The first of ``jumps`` that is too great, in words."""
    for name, jump in jumps.items():
        if not jump <= JUMP:
            return f"{name} jumps by {jump:.3g} {UNITS[name]}"
    return ""
