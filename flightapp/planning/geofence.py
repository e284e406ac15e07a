"""Where the vehicle may be: a vertical prism, its outline a simple polygon, between a floor and a ceiling."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.config.safety import Geofence as Settings
from flightapp.config.safety import outline
from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.trajectory import ORDER, Trajectory

STEP = 0.02
"""s along a trajectory between the points that are looked at: 8 cm at 4 m/s."""
TOLERANCE = 1e-3
"""m outside that don't count: a line along a wall is within."""
OVERSHOOT = 1.0
"""m by which a plan that starts outside may lead further out before it leads in: it may have to brake first."""
ROUNDS = 24
"""Times at most that a place is moved away from the nearest wall: each corner takes a few."""


@dataclass(frozen=True, slots=True)
class Exit:
    """Where a trajectory leads out of the geofence for the first time."""

    time: float
    """s since the trajectory's start."""
    distance: float
    """m outside, the most until it is back or over."""
    position: Vector
    """(3,) m, world, where it leaves."""

    def __str__(self) -> str:
        x, y, z = self.position
        return f"leaves the geofence at {self.time:.1f} s, near ({x:.1f}, {y:.1f}, {z:.1f}) m, by {self.distance:.2f} m"


@dataclass(frozen=True, slots=True)
class Geofence:
    """The prism."""

    corners: Vector
    """(n, 2) m, world, in order round the outline."""
    floor: float
    """m, world."""
    ceiling: float

    @classmethod
    def of(cls, settings: Settings) -> "Geofence":
        """As the configuration's section says."""
        return cls(np.array(outline(settings.corners)), settings.floor, settings.ceiling)

    def outside(self, position: Vector) -> float:
        """m by which ``position`` (3,) is outside; negative within: how far from the nearest face."""
        return float(_outside(self.corners, self.floor, self.ceiling, position))

    def exit(self, trajectory: Trajectory) -> Exit | None:
        """Where ``trajectory`` leads out; None where it stays within.

        One that starts outside may lead back in, by way of `OVERSHOOT` further out at the most, and has to end within.
        """
        time, distance = _first_exit(trajectory.knots, trajectory.coefficients, self.corners, self.floor, self.ceiling)
        if time < 0.0:
            return None
        return Exit(time, distance, trajectory.sample(time).position)

    def within(self, point: Vector, margin: float) -> Vector:
        """A place near ``point`` (3,) m that is ``margin`` m away from all faces, as far as there is so much room."""
        x, y = float(point[0]), float(point[1])
        for _ in range(ROUNDS):
            depth, bx, by = _wall(self.corners, x, y)
            if depth >= margin - 1e-9:
                break
            away = max(abs(depth), 1e-9)
            sign = 1.0 if depth > 0.0 else -1.0
            nx, ny = sign * (x - bx) / away, sign * (y - by) / away
            if abs(depth) < 1e-9:
                nx, ny = self._inward(bx, by)
            x, y = bx + margin * nx, by + margin * ny
        middle = 0.5 * (self.floor + self.ceiling)
        low, high = min(self.floor + margin, middle), max(self.ceiling - margin, middle)
        return np.array((x, y, min(max(float(point[2]), low), high)))

    def _inward(self, x: float, y: float) -> tuple[float, float]:
        """The unit vector from a point of a wall that leads within."""
        near = 1e-4
        angles = np.linspace(-math.pi, math.pi, 32, endpoint=False)
        depths = [_wall(self.corners, x + near * math.cos(a), y + near * math.sin(a))[0] for a in angles]
        best = float(angles[int(np.argmax(depths))])
        return math.cos(best), math.sin(best)


@kernel
def _wall(corners: Vector, x: float, y: float) -> tuple[float, float, float]:
    """m to the nearest wall, negative where (``x``, ``y``) is outside, and that wall's nearest point."""
    n = corners.shape[0]
    inside = False
    least, bx, by = math.inf, x, y
    for i in range(n):
        x0, y0 = corners[i - 1, 0], corners[i - 1, 1]
        x1, y1 = corners[i, 0], corners[i, 1]
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
        dx, dy = x1 - x0, y1 - y0
        s = min(max(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        px, py = x0 + s * dx, y0 + s * dy
        d = math.hypot(x - px, y - py)
        if d < least:
            least, bx, by = d, px, py
    return (least if inside else -least), bx, by


@kernel
def _outside(corners: Vector, floor: float, ceiling: float, p: Vector) -> float:
    aside, upright = -_wall(corners, p[0], p[1])[0], max(floor - p[2], p[2] - ceiling)
    if aside <= 0.0 or upright <= 0.0:
        return float(max(aside, upright))
    return float(math.hypot(aside, upright))


@kernel
def _first_exit(
    knots: Vector, coefficients: Vector, corners: Vector, floor: float, ceiling: float
) -> tuple[float, float]:
    """The time in s at which a trajectory leads out (-1: never), and by how many m at the most then."""
    p = np.empty(3)
    end, t, i = knots[-1], 0.0, 0
    start, returned, left, most = 0.0, False, -1.0, 0.0
    while True:
        while i < knots.size - 2 and knots[i + 1] <= t:
            i += 1
        s = t - knots[i]
        for axis in range(3):
            x = 0.0
            for k in range(ORDER - 1, -1, -1):
                x = x * s + coefficients[i, axis, k]
            p[axis] = x
        out = _outside(corners, floor, ceiling, p)
        if t == 0.0:
            start = out
        returned = returned or out <= TOLERANCE
        allowed = TOLERANCE if returned or t >= end else start + OVERSHOOT
        if left < 0.0 and out > allowed:
            left = t
        elif left >= 0.0 and out <= TOLERANCE:
            return left, most
        if left >= 0.0:
            most = max(most, out)
        if t >= end:
            return left, most
        t = min(t + STEP, end)
