"""What a race line must keep to: inequalities c <= 0 at the samples of each segment and at its first knot.

Specific force and body rates are those of differential flatness (D. Mellinger and V. Kumar, 2011) with drag that is the
same in all directions (M. Faessler, A. Franchi and D. Scaramuzza, 2018): the rate is the specific force's derivative
across it, over it.
"""

import math
from typing import NamedTuple

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.obstacles import MARGIN, beyond, distance
from flightapp.planning.race_samples import BY_ENTRY, DENSE, DURATION, FINE, SAMPLES, add_drag, sample, scaled_ends

SPEED, ACCELERATION, FORCE, RATE, LEAST_FORCE, TILT, FLOOR, CLEARANCE = range(8)
"""Kinds of inequalities at samples."""
KINDS = 8
AT_KNOT = SAMPLES * KINDS
"""Place of the first inequality of a knot among those of its segment; before it, those of kind m are at m SAMPLES."""
BRIEF, AREA, CROSSING = AT_KNOT, AT_KNOT + 1, AT_KNOT + 2
"""Least duration of the segment, the gate's area, the angle at which it is crossed."""
PLACES = AT_KNOT + 3
ALONG = 0.93
"""Share of the squared jerk along the specific force, which turns nothing: the rest bounds how fast thrust changes."""
REACH = 1.0
"""m beyond the clearance at which obstacles begin to count."""
G2 = GRAVITY * GRAVITY
SLOW = 0.05
"""m/s, added to speeds so that the angle of a crossing has a derivative at rest."""


class Problem(NamedTuple):
    """One race line to be found, with n segments."""

    active: Vector
    """(KINDS + 3,) 1 where inequalities of that kind, or of a knot, are wanted, else 0."""
    limits: Vector
    """(n, KINDS) of each segment: 1/v², 1/a², 1/f², 1/ω², least f², cosine of the tilt, floor, clearance to add."""
    briefest: Vector
    """(n,) s, least duration of each segment."""
    cosine: float
    """Of the greatest angle between a gate's normal and the velocity."""
    smooth: float
    """s⁵/m²: weight of half the squared jerk against the duration."""
    fixed: Vector
    """(n + 1, 13) 1 for variables that stay as they are."""
    centres: Vector
    """(n + 1, 3) m, of gates."""
    areas: Vector
    """(n + 1, 3, 3) 1/m²: p is within the area where dᵀ A d <= 1 with d = p - centre; zero without a gate."""
    normals: Vector
    """(n + 1, 3) directions of passage; zero where any will do."""
    planes: Vector
    """(n + 1, 3) 1/m: p is held in the plane of this normal through the centre; zero for none."""
    rows: Vector
    """(k, 13) obstacles."""
    drag: float
    """1/s, specific force per m/s that holds the vehicle back."""


@inlined
def square(v: Vector) -> float:
    """Squared length of ``v`` (3,)."""
    total: float = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    return total


@inlined
def at_samples(kind: int, q: Vector, limits: Vector, rows: Vector, away: Vector, out: Vector) -> None:
    """Fill ``out`` (SAMPLES,) with the inequality ``kind`` at the samples ``q`` (15, SAMPLES).

    ``limits`` (KINDS,) are the segment's. Directions away from the nearest obstacle go to ``away`` (3, SAMPLES).
    """
    if kind == CLEARANCE:
        _too_near(q, rows, away, out)
        for k in range(SAMPLES):
            out[k] += limits[CLEARANCE]
        return
    limit = limits[kind]
    if kind == FLOOR:
        for k in range(SAMPLES):
            out[k] = limit - q[2, k]
        return
    first = 3 if kind == SPEED else (12 if kind == ACCELERATION else 6)
    lift = 0.0 if kind <= ACCELERATION else GRAVITY
    x, y, z = q[first], q[first + 1], q[first + 2]
    for k in range(SAMPLES):
        out[k] = x[k] * x[k] + y[k] * y[k] + (z[k] + lift) * (z[k] + lift)
    if kind <= FORCE:
        for k in range(SAMPLES):
            out[k] = limit * out[k] - 1.0
    else:
        _by_force(kind, q, limit, out)


@inlined
def _by_force(kind: int, q: Vector, limit: float, out: Vector) -> None:
    """Turn ``out`` (SAMPLES,), squares of the specific force, into what of the inequality ``kind`` depends on them."""
    if kind == RATE:
        x, y, z, a, b, c = q[6], q[7], q[8], q[9], q[10], q[11]
        for k in range(SAMPLES):
            along = a[k] * x[k] + b[k] * y[k] + c[k] * (z[k] + GRAVITY)
            turning = a[k] * a[k] + b[k] * b[k] + c[k] * c[k] - ALONG * along * along / out[k]
            out[k] = (limit * turning - out[k]) / G2
    elif kind == LEAST_FORCE:
        for k in range(SAMPLES):
            out[k] = (limit - out[k]) / G2
    else:
        for k in range(SAMPLES):
            out[k] = (limit * math.sqrt(out[k]) - q[8, k] - GRAVITY) / GRAVITY


@inlined
def _too_near(q: Vector, rows: Vector, away: Vector, out: Vector) -> None:
    """How much too near the samples are to the obstacles nearest to them."""
    p, gradient = away[3, :3], away[3, 3:6]
    for k in range(SAMPLES):
        for axis in range(3):
            p[axis] = q[axis, k]
            away[axis, k] = 0.0
        worst = -REACH
        for i in range(rows.shape[0]):
            if not beyond(p, rows, i, rows[i, MARGIN] - worst):
                lack = rows[i, MARGIN] - distance(p, rows, i, gradient)
                if lack > worst:
                    worst = lack
                    for axis in range(3):
                        away[axis, k] = gradient[axis]
        out[k] = worst


@inlined
def off_centre(k: int, line: Vector, problem: Problem, push: Vector) -> float:
    """dᵀ A d - 1 at knot ``k``; ``push`` (3,) is A d."""
    total = -1.0
    for a in range(3):
        push[a] = 0.0
        for b in range(3):
            push[a] += problem.areas[k, a, b] * (line[k, b] - problem.centres[k, b])
        total += push[a] * (line[k, a] - problem.centres[k, a])
    return total


@inlined
def askew(k: int, line: Vector, problem: Problem) -> float:
    """How much too obliquely knot ``k`` is crossed, m/s."""
    v, n = line[k, 3:6], problem.normals[k]
    if square(n) == 0.0:
        return -1.0
    speed = math.sqrt(square(v) + SLOW * SLOW)
    along: float = v[0] * n[0] + v[1] * n[1] + v[2] * n[2]
    return problem.cosine * speed - along


@inlined
def out_of_plane(k: int, line: Vector, problem: Problem) -> float:
    """How far knot ``k`` is from its plane, in units of the plane's normal."""
    total = 0.0
    for a in range(3):
        total += problem.planes[k, a] * (line[k, a] - problem.centres[k, a])
    return total


@lean_kernel
def evaluate(line: Vector, problem: Problem, ends: Vector, samples: Vector, c: Vector) -> float:
    """Cost (s) of ``line`` (n + 1, 13): duration and smoothing; fills ``c`` (n + 1, PLACES) where active.

    ``ends`` (9, 3) and ``samples`` (20, SAMPLES) are scratch.
    """
    y, push, q, away = ends[0:8], ends[8], samples[0:15], samples[15:19]
    n = line.shape[0] - 1
    cost = 0.0
    for i in range(n + 1):
        if problem.active[KINDS + 1] != 0.0:
            c[i, AREA] = off_centre(i, line, problem, push)
        if problem.active[KINDS + 2] != 0.0:
            c[i, CROSSING] = askew(i, line, problem)
        lack = out_of_plane(i, line, problem)
        cost += 0.5 * lack * lack
        if i == n:
            break
        duration = line[i, DURATION]
        cost += duration
        c[i, BRIEF] = 1.0 - duration / problem.briefest[i]
        scaled_ends(i, line, duration, y)
        sample(BY_ENTRY, duration, y, q)
        add_drag(problem.drag, q)
        share = 0.5 * problem.smooth * duration / SAMPLES
        for k in range(SAMPLES):
            cost += share * (q[9, k] * q[9, k] + q[10, k] * q[10, k] + q[11, k] * q[11, k])
        for kind in range(KINDS):
            if problem.active[kind] != 0.0:
                place = kind * SAMPLES
                at_samples(kind, q, problem.limits[i], problem.rows, away, c[i, place : place + SAMPLES])
    return cost


@inlined
def _raise_to(kind: int, q: Vector, value: Vector, top: Vector) -> None:
    """Raise ``top[kind]`` to the greatest of ``value`` (SAMPLES,), that inequality at the samples ``q``."""
    for k in range(SAMPLES):
        x = value[k]
        if kind <= FORCE:
            x += 1.0
        elif kind <= LEAST_FORCE:
            up = q[8, k] + GRAVITY
            x = x * G2 / (q[6, k] * q[6, k] + q[7, k] * q[7, k] + up * up) + 1.0
        top[kind] = max(top[kind], x)


@lean_kernel
def measure(line: Vector, problem: Problem, ends: Vector, samples: Vector, worst: Vector) -> None:
    """Fill ``worst`` (n, KINDS) with how far each segment of ``line`` exceeds ``problem``, densely sampled.

    The first five are ratios to the limits, 1 where they are kept to exactly; the others are those of `at_samples`.
    What concerns the specific force counts without drag and with it, the worse of the two (M. Faessler, A. Franchi and
    D. Scaramuzza, 2018, for drag that is the same in all directions).
    """
    y, q, away, value = ends[0:8], samples[0:15], samples[15:19], samples[19]
    for i in range(line.shape[0] - 1):
        top, limits, duration = worst[i], problem.limits[i], line[i, DURATION]
        for kind in range(KINDS):
            top[kind] = 0.0 if kind < TILT else -REACH
        scaled_ends(i, line, duration, y)
        for part in range(FINE):
            sample(DENSE[part], duration, y, q)
            for turn in range(2 if problem.drag != 0.0 else 1):
                add_drag(problem.drag if turn == 1 else 0.0, q)
                for kind in range(KINDS if turn == 0 else FLOOR):
                    if problem.active[kind] != 0.0 and (turn == 0 or kind >= FORCE):
                        at_samples(kind, q, limits, problem.rows, away, value)
                        _raise_to(kind, q, value, top)
        for kind in range(TILT):
            top[kind] = math.sqrt(top[kind])
