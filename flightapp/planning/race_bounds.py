"""What a race line is asked for, as numbers: from a request and the configuration to a `Problem`."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.config import Config
from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import PlanRequest
from flightapp.messages import GateEstimate
from flightapp.planning.course import horizontal_sigma
from flightapp.planning.obstacles import BALL, CENTRE, MARGIN, distance
from flightapp.planning.race_problem import (
    ACCELERATION,
    ALONG,
    CLEARANCE,
    FORCE,
    KINDS,
    LEAST_FORCE,
    RATE,
    SPEED,
    TILT,
    Problem,
)
from flightapp.planning.race_samples import DURATION
from flightapp.planning.race_start import Layout
from flightapp.track import GateShape

SMOOTHING = 0.027
"""s per s that half the squared jerk costs, in units of that which turns full thrust at the greatest rate: it decides
where nothing else does."""
GENTLE = 3.0
"""m/s, greatest speed at which that weight is twice as large: below it turns are a small part of the time."""
TURN, BRIEFER = 0.06, 0.5
"""rad, least angle at the greatest body rate that a segment takes the time for, unless it is begun with less: then the
share of that which it takes at least."""
STIFF = 1e3
"""1/m, square root of the weight that holds knots in the plane of their gate."""
ROOM = 0.01
"""m, an area that is smaller is a point."""
SAG = 0.3
"""m that a line may go below its lowest point."""
EASE = 1e-3
"""m by which a start may be nearer to an obstacle than it is."""
SLACK = 5e-4
"""By which share the start must be within a limit that counts at the beginning."""
RESERVE = 0.9992
"""Share of the limits that plans use."""
BEGINNING = 0.12
"""s from a start in motion in which limits are those for the beginning."""


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Points of a route, from the start to the end, and how they are to be passed."""

    points: Vector
    """(m + 1, 3) m."""
    directions: Vector
    """(m + 1, 3) unit vector of passage, zero where any will do."""
    radii: Vector
    """(m + 1,) m around the point, in the plane across the direction if there is one."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What the vehicle can do and the configuration lets plans use."""

    force: float
    """m/s², greatest collective specific force."""
    least_force: float
    """m/s²."""
    rate: float
    """rad/s, roll and pitch together."""
    tilt: float
    """Cosine of the greatest tilt, -1 where there is no limit."""
    cosine: float
    """Of the greatest angle between a gate's normal and the velocity."""
    drag: float
    """1/s, specific force per m/s, the mean of the body's axes across the thrust."""

    @classmethod
    def of(cls, config: Config) -> "Vehicle":
        """As ``config`` has it."""
        planning = config.planning
        tilt = math.radians(planning.tilt_max_deg)
        return cls(
            planning.thrust_share * config.vehicle.thrust_max,
            config.guard.thrust_min,
            planning.rate_share * config.vehicle.rate_max,
            math.cos(tilt) if tilt < math.pi else -1.0,
            math.cos(math.radians(planning.crossing_deg)),
            planning.drag_share * 0.5 * (config.vehicle.drag[0] + config.vehicle.drag[1]),
        )


def gate_radius(gate: GateEstimate, shape: GateShape | None, config: Config) -> float:
    """m from the centre of ``gate`` within which a plan may go through; 0 where only its centre is known to be free."""
    if shape is None:
        return 0.0
    unsure = config.planning.pace_sigmas * max(horizontal_sigma(gate), math.sqrt(max(gate.covariance[2, 2], 0.0)))
    room = 0.5 * shape.opening - config.vehicle.radius - config.planning.frame_clearance - unsure
    return max(0.0, min(config.planning.gate_margin, room))


def limits_of(vehicle: Vehicle, request: PlanRequest, targets: Targets) -> Vector:
    """(3, KINDS) greatest speed, acceleration, specific force, body rate, least specific force, others as in `Problem`.

    The first row is for the plan, with a reserve; the second for its beginning: a start close to a limit, as one on
    an earlier plan may be, needs the reserve, and one a little beyond does not count as exceeding it. The third is what
    the start keeps to, to which the second may be drawn in.
    """
    start, limits = request.start, request.limits
    force = (start.acceleration + vehicle.drag * start.velocity).tolist()
    force[2] += GRAVITY
    jerk = (start.jerk + vehicle.drag * start.acceleration).tolist()
    size = max(math.hypot(*force), 1e-6)
    turning = math.hypot(*jerk) ** 2 - ALONG * (sum(j * f for j, f in zip(jerk, force, strict=True)) / size) ** 2
    floor = min(targets.points[:, 2].tolist()) - SAG
    most = limits.v_max, limits.a_max, vehicle.force, vehicle.rate
    motion = math.hypot(*start.velocity.tolist()), math.hypot(*start.acceleration.tolist()), size
    at_start = [(1.0 + SLACK) * x for x in (*motion, math.sqrt(max(turning, 0.0)) / size)]
    least, least_at_start = vehicle.least_force, size / (1.0 + SLACK)
    tilt = min(vehicle.tilt, force[2] / size - SLACK) if vehicle.tilt > -1.0 else -1.0
    return np.array(
        [
            [*(RESERVE * x for x in most), least / RESERVE, vehicle.tilt, floor, 0.0],
            [*map(max, most, at_start), min(least, least_at_start), tilt, floor, 0.0],
            [*at_start, least_at_start, tilt, floor, 0.0],
        ]
    )


def beginning(line: Vector, at_rest: bool) -> Vector:
    """(n,) 1 for the segments of ``line`` that belong to the beginning of a plan that starts in motion, else 0."""
    begun = np.concatenate(([0.0], np.cumsum(line[:-2, DURATION])))
    return np.zeros(len(begun)) if at_rest else (begun < BEGINNING).astype(float)


def as_problem(
    limits: Vector, first: Vector, targets: Targets, layout: Layout, rows: Vector, vehicle: Vehicle
) -> Problem:
    """Everything that the line of ``layout`` is to keep to, with `limits_of`; ``rows`` are obstacles.

    ``first`` (n,) is 1 for segments of the `beginning`.
    """
    n = layout.line.shape[0] - 1
    fixed, centres, areas = np.zeros((n + 1, DURATION + 1)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3))
    normals, planes = np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
    fixed[0, :DURATION] = fixed[n] = 1.0
    inner = layout.anchors[1:-1]
    centres[inner], normals[inner] = targets.points[1:-1], targets.directions[1:-1]
    wide = targets.radii[1:-1] >= ROOM
    fixed[inner[~wide], 0:3] = 1.0
    across = targets.directions[1:-1][wide]
    flat = np.eye(3) - across[:, :, None] * across[:, None, :]
    areas[inner[wide]] = flat / targets.radii[1:-1][wide, None, None] ** 2
    planes[inner[wide]] = STIFF * across
    active = np.ones(KINDS + 3)
    active[SPEED] = limits[0, SPEED] < math.inf
    active[ACCELERATION] = limits[0, ACCELERATION] < math.inf
    active[TILT] = limits[0, TILT] > -1.0
    active[CLEARANCE] = rows.size > 0
    active[KINDS + 1 :] = areas.any(), normals.any()
    numbers = coefficients(np.where(first[:, None] != 0.0, limits[1], limits[0]))
    smooth = SMOOTHING / (limits[0, RATE] * limits[0, FORCE]) ** 2 * (1.0 + (GENTLE / limits[0, SPEED]) ** 3)
    knots = fixed, centres, areas, normals, planes
    briefest = np.minimum(TURN / limits[0, RATE], BRIEFER * layout.line[:-1, DURATION])
    return Problem(active, numbers, briefest, vehicle.cosine, smooth, *knots, rows, vehicle.drag)


def coefficients(limits: Vector) -> Vector:
    """(…, KINDS) as `Problem` wants them, from those of `limits_of`."""
    out = limits.copy()
    out[..., : RATE + 1] = limits[..., : RATE + 1] ** -2.0
    out[..., LEAST_FORCE] = limits[..., LEAST_FORCE] ** 2
    return out


def leaving(rows: Vector, points: Vector) -> Vector:
    """``rows`` of obstacles, whose margins the first and the last of ``points`` (m, 3) keep as well as they can."""
    eased, gradient = rows.copy(), np.empty(3)
    for point in (points[0], points[-1]):
        away = rows[:, CENTRE : CENTRE + 3] - point
        reach = rows[:, BALL] + rows[:, MARGIN] + EASE
        for i in np.flatnonzero((away * away).sum(axis=1) < reach * reach).tolist():
            eased[i, MARGIN] = min(eased[i, MARGIN], distance(point, rows, i, gradient) - EASE)
    return eased
