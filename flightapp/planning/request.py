"""What a request must be like before it is worth planning for."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from flightapp.interfaces import Limits, Motion, PlanningError, PlanRequest

SAME_POINT = 1e-3
"""m, points closer than this are one."""
SPEED_MARGIN = 1.01
"""Ratio to the greatest speed that a start may have, as a splice onto an earlier plan does."""


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
    if not math.isfinite(request.stamp):
        raise PlanningError(f"the plan's start time is {request.stamp}")
    for gate in request.gates:
        _check_point(f"gate {gate.gate_id}", gate.position)
        if not math.isfinite(gate.yaw):
            raise PlanningError(f"gate {gate.gate_id}: its yaw is {gate.yaw}")


def check_limits(limits: Limits) -> None:
    """Raise `PlanningError` unless all limits are positive and finite."""
    for name in ("v_max", "a_max", "yaw_rate_max"):
        value = getattr(limits, name)
        if not (math.isfinite(value) and value > 0.0):
            raise PlanningError(f"{name} must be positive, not {value}")


def check_start(start: Motion, limits: Limits) -> None:
    """Raise `PlanningError` unless the start is finite and not faster than ``limits``."""
    _check_point("the start", start.position)
    for name in ("velocity", "acceleration", "jerk"):
        _check_point(f"the start's {name}", getattr(start, name))
    if not (math.isfinite(start.yaw) and math.isfinite(start.yaw_rate)):
        raise PlanningError(f"the start's heading is not finite: {start.yaw} rad, {start.yaw_rate} rad/s")
    speed = float(np.linalg.norm(start.velocity))
    if speed > SPEED_MARGIN * limits.v_max:
        raise PlanningError(f"the start is flown at {speed:.2f} m/s, faster than v_max = {limits.v_max:g} m/s")


def gate_route(request: PlanRequest) -> Route:
    """The route through the request's gates; a gate at which the start already is keeps its place 0."""
    points, directions, places = [_vector(request.start.position)], [np.zeros(3)], []
    names = ["the start"]
    for gate in request.gates:
        position = _vector(gate.position)
        name = f"gate {gate.gate_id}"
        if _same(position, points[-1]):
            if len(points) > 1:
                raise PlanningError(f"{names[-1]} and {name} are at the same point")
        else:
            points.append(position)
            directions.append(np.array([math.cos(gate.yaw), math.sin(gate.yaw), 0.0]))
            names.append(name)
        places.append(len(points) - 1)
    _close(points, directions, request)
    return Route(np.array(points), np.array(directions), tuple(places))


def point_route(waypoints: Vector, request: PlanRequest) -> Route:
    """The route through ``waypoints`` (n, 3); neighbours less than a millimetre apart become one."""
    rows = np.asarray(waypoints, float)
    if rows.size == 0:
        raise PlanningError("there are no waypoints to fly through")
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise PlanningError(f"waypoints must have three coordinates each, not shape {rows.shape}")
    points, directions = [_vector(request.start.position)], [np.zeros(3)]
    for i, row in enumerate(rows):
        _check_point(f"waypoint {i}", row)
        if not _same(row, points[-1]):
            points.append(row)
            directions.append(np.zeros(3))
    _close(points, directions, request)
    return Route(np.array(points), np.array(directions), ())


def _close(points: list[Vector], directions: list[Vector], request: PlanRequest) -> None:
    """Add the end, unless the last point is there already; the plan rests there in any direction."""
    if len(points) > 1 and _same(request.end, points[-1]):
        directions[-1] = np.zeros(3)
        return
    points.append(_vector(request.end))
    directions.append(np.zeros(3))


def _vector(values: Vector) -> Vector:
    return np.array(values, float)


def _same(a: Vector, b: Vector) -> bool:
    return bool(np.linalg.norm(np.asarray(a) - b) < SAME_POINT)


def _check_point(name: str, values: Vector) -> None:
    array = np.asarray(values, float)
    if array.shape != (3,):
        raise PlanningError(f"{name} must have three coordinates, not shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise PlanningError(f"{name} is not finite: {array.tolist()}")
