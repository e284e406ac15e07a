"""Places from which to look for a gate, and the way round a gate to fly at it again."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import GateEstimate
from flightapp.planning.geofence import Geofence
from flightapp.planning.obstacles import CENTRE, COS, CYLINDER, HALF, KIND, SIN, Margins, packed
from flightapp.track import GateShape, Track

CLIMBS = (0.0, 1.5, -1.0)
"""m above the middle of a search, in turn from one of its places to the next."""
BESIDE_AHEAD = math.radians(60.0)
"""rad to the left of the direction of a search, where each of its rings begins."""
OUTSIDE = 0.6
"""Share of the distance between places by which one may lie outside the geofence and is looked for within."""
LEAST_HEIGHT = 1.2
"""m above the ground at which to search."""
INSIDE = 0.5
"""m from the geofence's faces, beyond the vehicle's radius, within which places of a search keep."""
AWAY = 1.0
"""m from obstacles and known frames, beyond the vehicle's radius, that places of a search keep."""
SIDESTEP = 1.2
"""m beside a gate's frame on the way round it."""
BESIDE = -0.5
"""m along a gate's direction of passage, counted from its plane, from where on the way to its front is round it."""


@dataclass(frozen=True, slots=True)
class Room:
    """Where a search may go."""

    fence: Geofence
    margin: float
    """m to keep from its faces."""
    low: float
    """m, least height, world."""
    solids: Vector
    """(k, obstacles.WIDTH) what to keep clear of."""
    away: float
    """m to keep from them."""

    @classmethod
    def of(cls, config: Config, track: Track, gates: Sequence[GateEstimate]) -> "Room":
        """The geofence above the ground, without the obstacles and the frames of ``gates``."""
        fence = Geofence.of(config.geofence)
        low = min(track.start.position[2] + LEAST_HEIGHT, 0.5 * (fence.floor + fence.ceiling))
        solids = packed(track.obstacles, gates, track.gate, Margins.of(config))
        return cls(fence, config.vehicle.radius + INSIDE, low, solids, config.vehicle.radius + AWAY)

    @property
    def width(self) -> float:
        """m, the greatest extent along x or y."""
        return float(np.ptp(self.fence.corners, axis=0).max())

    def within(self, point: Vector) -> Vector:
        """A place within the geofence, near ``point`` (3,)."""
        place = self.fence.within(point, self.margin)
        place[2] = max(place[2], self.low)
        return place

    def free(self, point: Vector) -> bool:
        """Whether ``point`` (3,) is clear of everything that is known."""
        x, y, z = (point - self.solids[:, CENTRE : CENTRE + 3]).T
        c, s = self.solids[:, COS], self.solids[:, SIN]
        round_ = self.solids[:, KIND] == CYLINDER
        along = np.where(round_, np.hypot(x, y), np.abs(c * x + s * y)) - self.solids[:, HALF]
        across = np.where(round_, 0.0, np.abs(c * y - s * x) - self.solids[:, HALF + 1])
        up = np.abs(z) - self.solids[:, HALF + 2]
        return bool((np.linalg.norm(np.maximum((along, across, up), 0.0), axis=0) >= self.away).all())


def viewpoints(middle: Vector, heading: float, step: float, room: Room) -> Iterator[Vector]:
    """Places (3,) m from which to look, in a widening pattern around ``middle`` (3,) and within ``room``.

    They lie on rings ``step`` m apart, as far from each other. Each ring begins to the left of the direction
    ``heading`` (rad), leads across it and all round. Heights change from one place to the next. The pattern ends
    where a whole ring lies outside.
    """
    for ring in range(1, 1 + math.ceil(room.width * math.sqrt(2.0) / step)):
        outside = True
        count = 6 * ring
        for k in range(count):
            angle = heading + BESIDE_AHEAD - k * 2.0 * math.pi / count
            point = middle + ring * step * np.array((math.cos(angle), math.sin(angle), 0.0))
            point[2] += CLIMBS[(k + ring) % len(CLIMBS)]
            wanted, point = point, room.within(point)
            if math.dist(wanted[:2], point[:2]) > OUTSIDE * step:
                continue
            outside = False
            if room.free(point):
                yield point
        if outside:
            return


def front(gate: GateEstimate, run: float, room: Room) -> Vector:
    """The place (3,) m ``run`` m before ``gate``, as near to it as ``room`` allows."""
    return room.within(gate.position - run * np.array((math.cos(gate.yaw), math.sin(gate.yaw), 0.0)))


def way_round(position: Vector, gate: GateEstimate, shape: GateShape, run: float, room: Room) -> Vector:
    """Waypoints (n, 3) m from ``position`` (3,) to ``run`` m before ``gate``, round its frame if that is in the way."""
    end = front(gate, run, room)
    c, s = math.cos(gate.yaw), math.sin(gate.yaw)
    x, y, _ = position - gate.position
    if c * x + s * y < BESIDE:
        return end[None]
    left = np.array((-s, c, 0.0)) * (0.5 * shape.opening + shape.border + SIDESTEP)
    nearer = 1.0 if c * y - s * x >= 0.0 else -1.0
    sides = [gate.position + side * left for side in (nearer, -nearer)]
    fits = [side for side in sides if room.free(side) and np.array_equal(side[:2], room.within(side)[:2])]
    return np.array((room.within((fits or sides)[0]), end))
