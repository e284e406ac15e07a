"""Whether a trajectory keeps clear of obstacles and of the frames of the gates that it passes or flies through."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.messages import GateEstimate
from flightapp.planning.obstacles import BALL, CENTRE, MARGIN, OWNER, Margins, beyond, distance, names, packed
from flightapp.track import Box, Cylinder, GateShape
from flightapp.trajectory import ORDER, Trajectory

STEP = 0.08
"""m along the path between the points that are looked at: a graze at 0.25 m is missed by 3 mm."""
STEP_TIME = 0.05
"""s, the longest step where it is slow."""
LONGEST = 0.18
"""m between them at the most, from standing with 80 m/s²: what is farther than that need not be looked at each time."""
TOLERANCE = 0.01
"""m by which a plan may come closer than is wanted: planners keep clear at points of their own."""


@dataclass(frozen=True, slots=True)
class Touch:
    """Where a trajectory comes too close to something for the first time."""

    name: str
    """What it is, as `obstacles.names` calls it."""
    time: float
    """s since the trajectory's start, when it is nearest."""
    gap: float
    """m between the vehicle and it, negative where they overlap."""
    wanted: float
    """m that are wanted between them."""

    def __str__(self) -> str:
        if self.gap <= 0.0:
            return f"leads into {self.name} at {self.time:.1f} s"
        return f"comes within {self.gap:.2f} m of {self.name} at {self.time:.1f} s, {self.wanted:.2f} m are wanted"


def touched(
    trajectory: Trajectory,
    gates: Sequence[GateEstimate],
    shape: GateShape | None,
    obstacles: Sequence[Box | Cylinder],
    margins: Margins,
) -> Touch | None:
    """The first of ``obstacles`` and of the frames of ``gates`` that ``trajectory`` comes too close to; None if none.

    What the start is too close to may be left at any distance but zero; what it touches already, at any.
    """
    rows = packed(obstacles, gates, shape, margins)
    if rows.shape[0] == 0:
        return None
    rows[:, MARGIN] = np.maximum(rows[:, MARGIN] - TOLERANCE, margins.radius)
    owner, time, gap = _first_touch(trajectory.knots, trajectory.coefficients, rows, margins.radius)
    if owner < 0:
        return None
    wanted = margins.obstacle if owner < len(obstacles) else margins.frame
    return Touch(names(obstacles, gates)[owner], time, gap, wanted)


@kernel
def _position(coefficients: Vector, i: int, s: float, p: Vector) -> float:
    """Fill ``p`` (3,) m with segment ``i`` of ``coefficients`` (n, 3, 8) at ``s`` s into it; returns the speed, m/s."""
    square = 0.0
    for axis in range(3):
        x = v = 0.0
        for k in range(ORDER - 1, -1, -1):
            v = v * s + x
            x = x * s + coefficients[i, axis, k]
        p[axis] = x
        square += v * v
    return math.sqrt(square)


@kernel
def _gaps(p: Vector, rows: Vector, radius: float, gradient: Vector, rest: Vector, gaps: Vector) -> None:
    """Fill ``gaps`` (owners,) m with the distance of a ball at ``p`` (3,) from each owner, infinite beyond margins.

    ``rest`` (k,) counts for how many more points each row is too far away.
    """
    for k in range(gaps.size):
        gaps[k] = math.inf
    for i in range(rows.shape[0]):
        rest[i] -= 1.0
        if rest[i] >= 0.0:
            continue
        margin = rows[i, MARGIN]
        if beyond(p, rows, i, margin):
            x, y, z = p[0] - rows[i, CENTRE], p[1] - rows[i, CENTRE + 1], p[2] - rows[i, CENTRE + 2]
            rest[i] = math.floor((math.sqrt(x * x + y * y + z * z) - rows[i, BALL] - margin) / LONGEST)
            continue
        d = distance(p, rows, i, gradient)
        if d < margin:
            k = int(rows[i, OWNER])
            gaps[k] = min(gaps[k], d - radius)


@kernel
def _first_touch(knots: Vector, coefficients: Vector, rows: Vector, radius: float) -> tuple[int, float, float]:
    """Which owner comes too close first (-1: none), and the time in s and gap in m of its closest approach then."""
    owners = int(rows[-1, OWNER]) + 1
    p, gradient, gaps, allowed = np.empty(3), np.empty(3), np.empty(owners), np.empty(owners)
    rest = np.zeros(rows.shape[0])
    found, when, least = -1, 0.0, math.inf
    end = knots[-1]
    t = 0.0
    i = 0
    while True:
        while i < knots.size - 2 and knots[i + 1] <= t:
            i += 1
        speed = _position(coefficients, i, t - knots[i], p)
        _gaps(p, rows, radius, gradient, rest, gaps)
        for k in range(owners):
            if t == 0.0 and gaps[k] < math.inf:
                allowed[k] = 0.0 if gaps[k] >= 0.0 else -math.inf
            elif gaps[k] == math.inf:
                allowed[k] = math.inf
            if found < 0 and gaps[k] < allowed[k]:
                found = k
        if found >= 0:
            if gaps[found] == math.inf:
                return found, when, least
            if gaps[found] < least:
                when, least = t, gaps[found]
        if t >= end:
            return found, when, least
        t = min(t + min(STEP / max(speed, 1e-9), STEP_TIME), end)
