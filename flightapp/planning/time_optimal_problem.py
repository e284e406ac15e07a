"""What the time-optimal planner is asked: points with areas around them, and limits."""

import math
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from flightapp.config import Config
from flightapp.frames import GRAVITY, Vector, quat_to_matrix
from flightapp.interfaces import PlanningError, PlanRequest
from flightapp.planning.request import Route
from flightapp.planning.time_optimal_rotors import Airframe

GREATEST = 5
"""How many bounds are greatest values; the others are least ones."""
LEAST_FORCE = 1.0
"""m/s², of the collective specific force, where the vehicle could do with less: the less, the faster it may turn."""
FALLING, OVERTURNED = 0.1, 0.01
"""m/s² of specific force, and cosine of half the tilt, below which an attitude cannot be told."""
GATE_PLANE = 0.01
"""m in front of and behind a gate's plane in which its area lies."""
ROOM = 0.01
"""m, radius of an area that is meant to be a point."""
SAG = 0.3
"""m that a plan may go below its lowest point."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of the motion, the greatest values first; infinite for none."""

    v_max: float
    """m/s."""
    a_max: float
    """m/s²."""
    rate: float
    """rad/s, greatest roll and pitch rate together."""
    force_max: float
    """m/s², greatest collective specific force."""
    rotor_max: float
    """m/s², greatest specific thrust of one rotor."""
    force_min: float
    """m/s²."""
    rotor_min: float
    """m/s²."""

    @classmethod
    def of(cls, config: Config, request: PlanRequest) -> "Bounds":
        """What ``request`` and the vehicle allow; a start or an arrival beyond a limit does not exceed it."""
        vehicle, planning, limits = config.vehicle, config.planning, request.limits
        start, end = _ends(request)
        states = (state_of(start), state_of(end))
        forces = [float(state[12]) for state in states]
        return cls(
            max(limits.v_max, *(float(np.linalg.norm(motion[1])) for motion in (start, end))),
            max(limits.a_max, *(float(np.linalg.norm(motion[2])) for motion in (start, end))),
            max(planning.rate_share * vehicle.rate_max, *(float(np.linalg.norm(state[10:12])) for state in states)),
            max(planning.thrust_share * vehicle.thrust_max, *forces),
            vehicle.thrust_max / 4.0,
            min(max(config.guard.thrust_min, LEAST_FORCE), *forces),
            0.0,
        )

    def row(self) -> Vector:
        """(7,) the bounds in the order in which they are listed."""
        return np.array(astuple(self))


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One race to be flown as fast as possible: m areas between a start and an end."""

    start: Vector
    """(4, 3) position, velocity, acceleration, jerk."""
    end: Vector
    """(4, 3) the same at the end."""
    centres: Vector
    """(m, 3) m."""
    shapes: Vector
    """(m, 3, 3) 1/m: p is within the area where |A (p - centre)| <= 1."""
    directions: Vector
    """(m, 3) unit vector of passage, zero where any will do."""
    cosine: float
    """Of the greatest angle between the direction of passage and the velocity."""
    floor: float
    """m, least height."""
    bounds: Bounds
    airframe: Airframe

    @property
    def places(self) -> Vector:
        """(m + 2, 3) m: the start, the centres, the end."""
        return np.vstack((self.start[:1], self.centres, self.end[:1]))


def as_problem(route: Route, radii: Vector, request: PlanRequest, config: Config) -> Problem:
    """The problem of ``route`` (m + 2 points) with areas of ``radii`` (m + 2,) m; those of both ends do not count."""
    start, end = _ends(request)
    targets = zip(route.directions[1:-1], np.maximum(radii[1:-1], ROOM), strict=True)
    return Problem(
        start,
        end,
        route.points[1:-1],
        np.array([_area(direction, radius) for direction, radius in targets]).reshape(-1, 3, 3),
        route.directions[1:-1],
        math.cos(math.radians(config.planning.crossing_deg)),
        float(route.points[:, 2].min()) - SAG,
        Bounds.of(config, request),
        Airframe.of(config.vehicle),
    )


def _area(direction: Vector, radius: float) -> Vector:
    """(3, 3) shape of a ball, or of a disc across ``direction`` (3,) where that is not zero."""
    along = np.outer(direction, direction)
    ball: Vector = np.eye(3) / radius
    return ball + along * (1.0 / min(GATE_PLANE, radius) - 1.0 / radius)


def _ends(request: PlanRequest) -> tuple[Vector, Vector]:
    """(4, 3) position, velocity, acceleration and jerk at the start and at the end."""
    start, rest = request.start, np.zeros((3, 3))
    arrival = rest if request.arrival is None else np.asarray(request.arrival, float)
    motion = np.array([start.position, start.velocity, start.acceleration, start.jerk], float)
    return motion, np.vstack((np.asarray(request.end, float)[None], arrival))


def thrust_of(acceleration: Vector) -> tuple[float, Vector]:
    """Collective specific force (m/s²) and thrust axis (3,) for an ``acceleration`` (3,); raises `PlanningError`."""
    force = np.asarray(acceleration, float) + np.array([0.0, 0.0, GRAVITY])
    length = float(np.linalg.norm(force))
    if length < FALLING:
        raise PlanningError(
            "the start or the end is in free fall, where the attitude is undefined; start a little later"
        )
    return length, force / length


def state_of(motion: Vector) -> Vector:
    """(14,) the state of the full model for a ``motion`` (4, 3).

    Position, velocity, attitude q_wb, rates of roll and pitch (rad/s), collective specific force (m/s²) and its change
    (m/s³). The attitude is tilted the short way from upright; raises `PlanningError` where there is none.
    """
    thrust, z = thrust_of(motion[2])
    w = math.sqrt(0.5 * (1.0 + z[2]))
    if w < OVERTURNED:
        raise PlanningError("the start or the end is upside down; start a little later")
    q = np.array([w, -0.5 * z[1] / w, 0.5 * z[0] / w, 0.0])
    turn = quat_to_matrix(q).T @ motion[3] / thrust
    return np.concatenate((motion[0], motion[1], q, [-turn[1], turn[0], thrust, motion[3] @ z]))


def casadi() -> Any:
    """The casadi module, which is an extra; raises `PlanningError` where it is not installed."""
    try:
        import casadi as module  # noqa: PLC0415  (takes a second to import, and is optional)
    except ImportError:
        raise PlanningError(
            "the planner 'optimal' needs casadi, which is not installed: pip install 'flightapp[optimal]',"
            " or choose planning.planner = 'race'"
        ) from None
    return module
