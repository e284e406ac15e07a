"""Lines that stop at every corner of a way: slow, but they keep to whatever its straight legs keep to.

They are flown where the search for a race line fails, from rest to rest.
"""

import math

import numpy as np

from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import Limits
from flightapp.planning.corridor import Way
from flightapp.planning.race_bounds import RESERVE, Vehicle
from flightapp.planning.race_problem import CLOSE, KINDS
from flightapp.planning.race_samples import DURATION, FINE, KNOT, SAMPLES
from flightapp.planning.race_start import Layout

RUNS, SHARE = (0.3, 0.1, 0.02), 0.4
"""m straight before and behind a gate, the first that keeps clear, but no more than this share of the way to what is
before and after it."""
SPEED, ACCELERATION, JERK = 35.0 / 16.0, 7.5132, 52.5
"""Peaks of a leg of degree 7 from rest to rest, of 1 m in 1 s."""
STILL = (0.0,) * (DURATION - 3)
"""A knot's velocity, acceleration and jerk at rest."""
LEAST, LONGEST = 1e-3, CLOSE * FINE * SAMPLES / SPEED
"""m, a shorter leg is none; one that is longer has several segments, or it would be looked at too coarsely."""


def halting(way: Way, directions: Vector, vehicle: Vehicle, limits: Limits, straight: float) -> Layout:
    """A line along ``way``, of n points with ``directions`` (n, 3) of passage, zero for any, at rest at its ends.

    Points with a direction are passed along it, ``straight`` m before and behind; the line rests at all others, and
    where it turns.
    """
    points, towards = way.points.tolist(), directions.tolist()
    knots, times, anchors = [[*points[0], *STILL]], [0.0], [0]
    v_max, agility = limits.v_max, min(limits.a_max, _agility(vehicle))
    for k in range(1, len(points)):
        point, run = points[k], 0.0
        if k < len(points) - 1 and any(towards[k]):
            run = min(straight, SHARE * math.dist(points[k - 1], point), SHARE * math.dist(point, points[k + 1]))
        before, behind = ([x + side * d for x, d in zip(point, towards[k], strict=True)] for side in (-run, run))
        _go(knots, times, before, v_max, agility, vehicle.rate)
        if run > LEAST:
            _go(knots, times, behind, v_max, agility, vehicle.rate, 2)
        if not way.inserted[k]:
            anchors.append(len(knots) - (2 if run > LEAST else 1))
    line = np.ones((len(knots), KNOT))
    line[:, :DURATION] = knots
    line[:-1, DURATION] = times[1:]
    return Layout(line, np.array(anchors), len(knots), np.ones((len(knots) - 1, KINDS)))


def _agility(vehicle: Vehicle) -> float:
    """m/s², an acceleration in any direction that thrust and tilt allow."""
    up = min(vehicle.force - GRAVITY, GRAVITY - vehicle.least_force)
    tilt = math.acos(min(max(vehicle.tilt, 0.0), 1.0))
    return max(RESERVE * min(up, GRAVITY * math.sin(tilt)), 1e-3)


def _between(begin: list[float], end: list[float], duration: float, u: float) -> list[float]:
    """The knot after the share ``u`` of the duration of a leg of degree 7 from rest to rest."""
    share = u**4 * (35.0 + u * (-84.0 + u * (70.0 - 20.0 * u)))
    speed = 140.0 * (u * (1.0 - u)) ** 3 / duration
    bend = 420.0 * (u * (1.0 - u)) ** 2 * (1.0 - 2.0 * u) / duration**2
    turn = 840.0 * u * (1.0 - u) * (1.0 - 5.0 * u * (1.0 - u)) / duration**3
    away = [y - x for x, y in zip(begin, end, strict=True)]
    place = [x + share * d for x, d in zip(begin, away, strict=True)]
    return [*place, *(rate * d for rate in (speed, bend, turn) for d in away)]


def _go(
    knots: list[list[float]],
    times: list[float],
    point: list[float],
    v_max: float,
    agility: float,
    rate: float,
    least: int = 1,
) -> None:
    """Add a leg of ``least`` or more parts to ``point`` from where ``knots`` end, unless it is there."""
    begin = knots[-1][:3]
    length = math.dist(begin, point)
    if length < LEAST:
        return
    turning = 0.5 * rate * GRAVITY
    duration = max(
        SPEED * length / v_max, math.sqrt(ACCELERATION * length / agility), math.cbrt(JERK * length / turning)
    )
    duration /= RESERVE
    parts = max(least, math.ceil(length / LONGEST))
    knots.extend(_between(begin, point, duration, part / parts) for part in range(1, parts))
    knots.append([*point, *STILL])
    times.extend([duration / parts] * parts)
