"""Where the search for a race line begins: a smooth line through the middle of all areas, flown slowly."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.planning.race_problem import KINDS
from flightapp.planning.race_samples import DURATION, KNOT

CRUISE = 0.7
"""Share of the speed guessed possible with which a leg is flown at first."""
AGILITY = 15.0
"""m/s², acceleration with which that speed is guessed."""
GENTLE = 8.0
"""m/s², acceleration from rest at first."""
SPACING = 0.8
"""m of leg per segment, before a leg is divided into the most segments that it gets."""
MOST_SEGMENTS = 24
"""About how many segments a line has at most, as long as each leg has one."""
FINEST = 3
"""Segments of a leg between gates."""
SHORT = 0.05
"""m, a leg is counted as at least this long."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """A line and where the route's points are on it."""

    line: Vector
    """(n + 1, 13) knots and durations."""
    anchors: NDArray[np.intp]
    """(m + 1,) the knot at each of the route's points."""
    smooth: int
    """The knot after which velocity, acceleration and jerk are still to be found, the last knot's excepted."""
    drawn: Vector
    """(n, KINDS) shares of the limits to begin with."""
    duals: Vector | None = None
    """(2, n + 1, PLACES) slacks and multipliers to begin with, 0 where they are not known; None if none is."""
    lowest: float = math.inf
    """m, height of the lowest point of the way that the line was laid along, if it is known."""


def joined(first: Layout, second: Layout) -> Layout:
    """``first`` and then ``second``, which begins where the first ends."""
    last = len(first.line) - 1
    line = np.vstack((first.line[:-1], second.line))
    anchors = np.concatenate((first.anchors, second.anchors[1:] + last))
    duals = None
    if first.duals is not None:
        duals = np.concatenate((first.duals[:, :-1], np.zeros((2, len(second.line), first.duals.shape[2]))), axis=1)
    drawn, lowest = np.vstack((first.drawn, second.drawn)), min(first.lowest, second.lowest)
    return Layout(line, anchors, min(first.smooth, last + second.smooth), drawn, duals, lowest)


def lay_out(points: Vector, directions: Vector, ends: Vector, v_max: float, slower: float) -> Layout:
    """A line along ``points`` (m + 1, 3) m, crossed along ``directions`` (m + 1, 3), zero where any will do.

    ``ends`` (2, 3, 3) are velocity, acceleration and jerk at both ends. ``slower`` times the time guessed is given.
    """
    legs = np.diff(points, axis=0)
    lengths = np.maximum(np.sqrt((legs * legs).sum(axis=1)), SHORT)
    moving = np.sqrt((ends[:, 0] ** 2).sum(axis=1))
    counts = _counts(lengths, moving)
    speeds = CRUISE * np.minimum(v_max, np.sqrt(AGILITY * lengths))
    times = slower * _times(legs, lengths, speeds, ends)
    tangents = _tangents(legs / lengths[:, None], directions, ends[:, 0])
    anchors = np.concatenate(([0], np.cumsum(counts)))
    leg = np.repeat(np.arange(counts.size), counts)
    s = (np.arange(leg.size) - anchors[leg]) / counts[leg]
    first, last = slice(0, counts[0]), slice(anchors[-2], leg.size)
    s[first] = _progress(s[first], legs[0], ends[0, 0], speeds[0])
    s[last] = 1.0 - _progress(1.0 - s[last], legs[-1], ends[1, 0], speeds[-1])
    s = s[:, None]
    line = np.zeros((leg.size + 1, KNOT))
    reach = lengths[leg, None]
    line[:-1, 0:3] = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2 * points[leg]
        + s * s * (3.0 - 2.0 * s) * points[leg + 1]
        + reach * s * (1.0 - s) * ((1.0 - s) * tangents[leg] - s * tangents[leg + 1])
    )
    line[anchors, 0:3] = points
    line[:-1, DURATION] = times[leg] / counts[leg]
    line[-1, DURATION] = 1.0
    line[0, 3:12], line[-1, 3:12] = ends[0].ravel(), ends[1].ravel()
    return Layout(line, anchors, 0, np.ones((len(line) - 1, KINDS)))


def _counts(lengths: Vector, moving: Vector) -> NDArray[np.intp]:
    """Segments of each leg: few on short legs, but enough at an end that is flown at speed."""
    finest = max(1, min(FINEST, MOST_SEGMENTS // lengths.size))
    counts = np.clip(np.ceil(lengths / SPACING), 1, finest).astype(np.intp)
    for place, speed in ((0, moving[0]), (-1, moving[1])):
        counts[place] = max(counts[place], 3 if lengths.size == 1 or speed > 0.0 else 2)
    return counts


def _closing(leg: Vector, velocity: Vector, speed: float) -> tuple[float, float]:
    """Speed along ``leg`` with which an end of it is flown, and what of its velocity is then to be changed, m/s."""
    ahead = leg / max(math.sqrt(float(leg @ leg)), SHORT)
    along = float(np.clip(velocity @ ahead, 0.0, 2.0 * speed))
    aside = velocity - along * ahead
    return along, math.sqrt(float(aside @ aside))


def _times(legs: Vector, lengths: Vector, speeds: Vector, ends: Vector) -> Vector:
    """(m,) s, a guess for each leg."""
    times: Vector = lengths / speeds
    for place, velocity in ((0, ends[0, 0]), (-1, ends[1, 0])):
        along, aside = _closing(legs[place], velocity, speeds[place])
        if velocity.any():
            times[place] = lengths[place] * 2.0 / (along + speeds[place]) + 1.5 * aside / AGILITY
        else:
            times[place] += min(0.5 * speeds[place] / GENTLE, math.sqrt(2.0 * lengths[place] / GENTLE))
    return times


def _progress(u: Vector, leg: Vector, velocity: Vector, speed: float) -> Vector:
    """Share of ``leg`` behind at the shares ``u`` (k,) of its duration, when it is begun with ``velocity``."""
    gone: Vector
    if velocity.any():
        along, _ = _closing(leg, velocity, speed)
        gone = u * (2.0 * along + (speed - along) * u) / (along + speed)
        return gone
    length = max(math.sqrt(float(leg @ leg)), SHORT)
    share = min(1.0, 2.0 * speed * speed / (2.0 * GENTLE * length + speed * speed))
    gone = np.where(u < share, 0.5 * u * u / share, u - 0.5 * share) / (1.0 - 0.5 * share)
    return gone


def _tangents(along: Vector, directions: Vector, velocities: Vector) -> Vector:
    """(m + 1, 3) in which direction points are passed, shorter where the line turns."""
    tangents = np.zeros_like(directions)
    tangents[1:-1] = 0.5 * (along[:-1] + along[1:])
    tangents += directions
    tangents /= np.maximum(np.sqrt((tangents * tangents).sum(axis=1)), 0.5)[:, None]
    for place, velocity in zip((0, -1), velocities, strict=True):
        speed = math.sqrt(float(velocity @ velocity))
        tangents[place] = velocity / speed if speed > 0.0 else 0.0
    return tangents
