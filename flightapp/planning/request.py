"""What a request must be like before it is worth planning for, and the points that it leads through."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest
from flightapp.jit import lean_kernel

SAME_POINT = 1e-3
"""m, points closer than this are one."""
MARGIN = 1.01
"""Ratio to the greatest speed and acceleration that a start may have, as a splice onto an earlier plan does."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Distinct points to fly through, from the start to the end."""

    points: Vector
    """(m + 1, 3) m."""
    directions: Vector
    """(m + 1, 3) unit vector of passage, zero where any will do."""
    gate_places: tuple[int, ...]
    """Index into `points` of each of the request's gates."""


def check_request(request: PlanRequest) -> None:
    """Raise `PlanningError` that names the first thing that is wrong with ``request``."""
    check_limits(request.limits)
    check_start(request.start, request.limits)
    _check_point("the end", request.end)
    if request.look_at is not None:
        _check_point("the point to look at", request.look_at)
    if request.arrival is not None:
        _check_arrival(request.arrival, request.limits)
    if not math.isfinite(request.stamp):
        raise PlanningError(f"the plan's start time is {request.stamp}")
    for gate in request.gates:
        _check_point(f"gate {gate.gate_id}", gate.position)
        if not math.isfinite(gate.yaw):
            raise PlanningError(f"gate {gate.gate_id}: its yaw is {gate.yaw}")


def check_limits(limits: Limits) -> None:
    """Raise `PlanningError` unless all limits are positive; those of speed and acceleration may be infinite."""
    for name, value in (("v_max", limits.v_max), ("a_max", limits.a_max), ("yaw_rate_max", limits.yaw_rate_max)):
        if not value > 0.0:
            raise PlanningError(f"{name} must be positive, not {value:g}; give infinity for no limit")
    if not math.isfinite(limits.yaw_rate_max):
        raise PlanningError(f"yaw_rate_max must be finite, not {limits.yaw_rate_max}")


def check_start(start: Motion, limits: Limits) -> None:
    """Raise `PlanningError` unless the start is finite and does not exceed ``limits``."""
    _check_point("the start", start.position)
    _check_point("the start's jerk", start.jerk)
    speed = math.hypot(*_check_point("the start's velocity", start.velocity))
    acceleration = math.hypot(*_check_point("the start's acceleration", start.acceleration))
    if not (math.isfinite(start.yaw) and math.isfinite(start.yaw_rate)):
        raise PlanningError(f"the start's heading is not finite: {start.yaw} rad, {start.yaw_rate} rad/s")
    _check_motion("the start", speed, acceleration, limits)


def gate_route(request: PlanRequest) -> Route:
    """The route through the request's gates; a gate at which the start already is keeps its place 0."""
    points, directions, places = [_coordinates(request.start.position)], [(0.0, 0.0, 0.0)], []
    names = ["the start"]
    for gate in request.gates:
        position = _coordinates(gate.position)
        name = f"gate {gate.gate_id}"
        if _same(position, points[-1]):
            if len(points) > 1:
                raise PlanningError(f"{names[-1]} and {name} are at the same point; give one of them another place")
        else:
            points.append(position)
            directions.append((math.cos(gate.yaw), math.sin(gate.yaw), 0.0))
            names.append(name)
        places.append(len(points) - 1)
    end = _coordinates(request.end)
    if len(points) > 1 and _same(end, points[-1]):
        directions[-1] = (0.0, 0.0, 0.0)
    else:
        points.append(end)
        directions.append((0.0, 0.0, 0.0))
    return Route(np.array(points), np.array(directions), tuple(places))


def point_route(waypoints: Vector, request: PlanRequest) -> Route:
    """The route through ``waypoints`` (n, 3); neighbours less than a millimetre apart become one."""
    rows = np.array(waypoints, float, order="C")
    if rows.size == 0:
        raise PlanningError("there are no waypoints to fly through")
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise PlanningError(f"waypoints must have three coordinates each, not shape {rows.shape}")
    points = np.empty((len(rows) + 2, 3))
    points[0] = request.start.position
    points[-1] = request.end
    count = _thin(rows, SAME_POINT, points)
    if count <= 0:
        raise PlanningError(f"waypoint {-count} is not finite: {rows[-count].tolist()}")
    return Route(points[:count], np.zeros((count, 3)), ())


@lean_kernel
def _thin(rows: Vector, least: float, points: Vector) -> int:
    """Put ``rows`` (n, 3) between the first and last of ``points`` (n + 2, 3), without repetitions.

    Returns how many points there are, always two at least; minus the index of a row that is not finite.
    """
    last, used = points.shape[0] - 1, 1
    for i in range(last):
        source, k = (rows, i) if i < last - 1 else (points, last)
        square = 0.0
        for axis in range(3):
            square += (source[k, axis] - points[used - 1, axis]) ** 2
        if not square < math.inf:
            return -i
        if square >= least * least or (i == last - 1 and used == 1):
            for axis in range(3):
                points[used, axis] = source[k, axis]
            used += 1
    return used


def _check_arrival(arrival: Vector, limits: Limits) -> None:
    rows = np.asarray(arrival, float)
    if rows.shape != (3, 3):
        raise PlanningError(f"the arrival must be velocity, acceleration and jerk, (3, 3), not shape {rows.shape}")
    _check_point("the arrival's jerk", rows[2])
    speed = math.hypot(*_check_point("the arrival's velocity", rows[0]))
    acceleration = math.hypot(*_check_point("the arrival's acceleration", rows[1]))
    _check_motion("the arrival", speed, acceleration, limits)


def _check_motion(name: str, speed: float, acceleration: float, limits: Limits) -> None:
    if speed > MARGIN * limits.v_max:
        raise PlanningError(f"{name} is flown at {speed:.2f} m/s, faster than v_max = {limits.v_max:g} m/s")
    if acceleration > MARGIN * limits.a_max:
        raise PlanningError(f"{name} has {acceleration:.2f} m/s² of acceleration, a_max = {limits.a_max:g} m/s²")


def _coordinates(values: Vector) -> tuple[float, float, float]:
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


def _same(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return math.dist(a, b) < SAME_POINT


def _check_point(name: str, values: Vector) -> list[float]:
    """The three coordinates of ``values``."""
    array = np.asarray(values, float)
    if array.shape != (3,):
        raise PlanningError(f"{name} must have three coordinates, not shape {array.shape}")
    row: list[float] = array.tolist()
    if not (math.isfinite(row[0]) and math.isfinite(row[1]) and math.isfinite(row[2])):
        raise PlanningError(f"{name} is not finite: {row}")
    return row
