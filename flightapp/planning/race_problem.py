"""What a race line must keep to: inequalities c <= 0 at the samples of each segment and at its first knot.

Specific force and body rates are those of differential flatness (D. Mellinger and V. Kumar, 2011) with drag that is the
same in all directions (M. Faessler, A. Franchi and D. Scaramuzza, 2018): the rate is the specific force's derivative
across it, over it.
"""

import math
from typing import NamedTuple

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import fused, fused_kernel
from flightapp.planning.obstacles import MARGIN, beyond, distance, farther
from flightapp.planning.race_rows import AT_AWAY, AT_LACK, AT_SQUARE, AT_VALUE, AT_WORST
from flightapp.planning.race_samples import (
    AT_A,
    AT_F,
    AT_J,
    AT_P,
    AT_V,
    BY_ENTRY,
    DENSE,
    DURATION,
    FINE,
    SAMPLES,
    add_drag,
    sample,
    scaled_ends,
)

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
CLOSE, LACKING = 0.1, 0.2
"""m between the points at which clearance is looked at once a line is found, where a third of them are enough; m beyond
the clearance at which obstacles begin to count then."""
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


@fused
def square(v: Vector) -> float:
    """Squared length of ``v`` (3,)."""
    total: float = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    return total


@fused
def at_samples(q: Vector, limits: Vector, out: Vector) -> None:
    """Fill ``out`` (KINDS SAMPLES,) with the inequalities at the samples ``q`` (`LENGTH`,), and the square in ``q``.

    ``limits`` (KINDS,) are the segment's. For clearance, what `too_near` left counts. All are computed at once, wanted
    or not, as that lets compilers work on several samples side by side.
    """
    speed_limit, acceleration_limit, force_limit, rate_limit = limits[0], limits[1], limits[2], limits[3]
    least, tilt, floor, clearance = limits[4], limits[5], limits[6], limits[7]
    for k in range(SAMPLES):
        u, v, w = q[AT_V + k], q[AT_V + SAMPLES + k], q[AT_V + 2 * SAMPLES + k]
        out[SPEED * SAMPLES + k] = speed_limit * (u * u + v * v + w * w) - 1.0
        u, v, w = q[AT_A + k], q[AT_A + SAMPLES + k], q[AT_A + 2 * SAMPLES + k]
        out[ACCELERATION * SAMPLES + k] = acceleration_limit * (u * u + v * v + w * w) - 1.0
        x, y, z = q[AT_F + k], q[AT_F + SAMPLES + k], q[AT_F + 2 * SAMPLES + k] + GRAVITY
        a, b, c = q[AT_J + k], q[AT_J + SAMPLES + k], q[AT_J + 2 * SAMPLES + k]
        force, along = x * x + y * y + z * z, a * x + b * y + c * z
        q[AT_SQUARE + k] = force
        out[FORCE * SAMPLES + k] = force_limit * force - 1.0
        turning = a * a + b * b + c * c - ALONG * along * along / force
        out[RATE * SAMPLES + k] = (rate_limit * turning - force) / G2
        out[LEAST_FORCE * SAMPLES + k] = (least - force) / G2
        out[TILT * SAMPLES + k] = (tilt * math.sqrt(force) - z) / GRAVITY
        out[FLOOR * SAMPLES + k] = floor - q[2 * SAMPLES + k]
        out[CLEARANCE * SAMPLES + k] = clearance + q[AT_LACK + k]


@fused
def _spread(q: Vector, middle: Vector) -> float:
    """Fill ``middle`` (3,) with the middle of the samples ``q``; the radius of a ball around it that holds them."""
    far = 0.0
    for axis in range(3):
        middle[axis] = 0.5 * (q[AT_P + axis * SAMPLES] + q[AT_P + axis * SAMPLES + SAMPLES - 1])
    for k in range(SAMPLES):
        x, y, z = q[k] - middle[0], q[SAMPLES + k] - middle[1], q[2 * SAMPLES + k] - middle[2]
        far = max(far, x * x + y * y + z * z)
    return math.sqrt(far)


@fused
def too_near(q: Vector, rows: Vector, ends: Vector) -> None:
    """Fill rows of ``q`` with how much too near its samples are to the obstacles nearest to them, and ways away.

    The last three rows of ``ends`` (11, 3) are scratch.
    """
    p, gradient, middle = ends[8], ends[9], ends[10]
    for k in range(SAMPLES):
        q[AT_LACK + k] = -REACH
        for axis in range(3):
            q[AT_AWAY + axis * SAMPLES + k] = 0.0
    spread = _spread(q, middle)
    for i in range(rows.shape[0]):
        if beyond(middle, rows, i, rows[i, MARGIN] + REACH + spread):
            continue
        for k in range(SAMPLES):
            for axis in range(3):
                p[axis] = q[axis * SAMPLES + k]
            if not farther(p, rows, i, rows[i, MARGIN] - q[AT_LACK + k]):
                lack = rows[i, MARGIN] - distance(p, rows, i, gradient)
                if lack > q[AT_LACK + k]:
                    q[AT_LACK + k] = lack
                    for axis in range(3):
                        q[AT_AWAY + axis * SAMPLES + k] = gradient[axis]


@fused
def _nearest(q: Vector, rows: Vector, lack: float, ends: Vector) -> float:
    """How much too near the samples ``q`` are to an obstacle at the most, if that is more than ``lack``."""
    p, gradient, middle = ends[8], ends[9], ends[10]
    spread = _spread(q, middle)
    for i in range(rows.shape[0]):
        if beyond(middle, rows, i, rows[i, MARGIN] - lack + spread):
            continue
        for k in range(SAMPLES):
            for axis in range(3):
                p[axis] = q[axis * SAMPLES + k]
            if not farther(p, rows, i, rows[i, MARGIN] - lack):
                lack = max(lack, rows[i, MARGIN] - distance(p, rows, i, gradient))
    return lack


@fused
def off_centre(k: int, line: Vector, problem: Problem, push: Vector) -> float:
    """dᵀ A d - 1 at knot ``k``; ``push`` (3,) is A d."""
    total = -1.0
    for a in range(3):
        push[a] = 0.0
        for b in range(3):
            push[a] += problem.areas[k, a, b] * (line[k, b] - problem.centres[k, b])
        total += push[a] * (line[k, a] - problem.centres[k, a])
    return total


@fused
def askew(k: int, line: Vector, problem: Problem) -> float:
    """How much too obliquely knot ``k`` is crossed, m/s."""
    v, n = line[k, 3:6], problem.normals[k]
    if square(n) == 0.0:
        return -1.0
    speed = math.sqrt(square(v) + SLOW * SLOW)
    along: float = v[0] * n[0] + v[1] * n[1] + v[2] * n[2]
    return problem.cosine * speed - along


@fused
def out_of_plane(k: int, line: Vector, problem: Problem) -> float:
    """How far knot ``k`` is from its plane, in units of the plane's normal."""
    total = 0.0
    for a in range(3):
        total += problem.planes[k, a] * (line[k, a] - problem.centres[k, a])
    return total


@fused_kernel
def evaluate(line: Vector, problem: Problem, ends: Vector, samples: Vector, near: Vector, c: Vector) -> float:
    """Cost (s) of ``line`` (n + 1, 13): duration and smoothing; fills ``c`` (n + 1, PLACES) where active.

    ``near`` (n + 1, 4 SAMPLES) gets what `too_near` finds; ``ends`` (11, 3) and ``samples`` (`LENGTH`,) are scratch.
    """
    push = ends[8]
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
        c[i, BRIEF] = 1.0 - duration / problem.briefest[i]
        scaled_ends(i, line, duration, ends)
        sample(BY_ENTRY, duration, ends, samples)
        add_drag(problem.drag, samples)
        square_jerk = 0.0
        for k in range(3 * SAMPLES):
            square_jerk += samples[AT_J + k] * samples[AT_J + k]
        cost += duration * (1.0 + 0.5 * problem.smooth / SAMPLES * square_jerk)
        if problem.active[CLEARANCE] != 0.0:
            too_near(samples, problem.rows, ends)
            for k in range(4 * SAMPLES):
                near[i, k] = samples[AT_AWAY + k]
        at_samples(samples, problem.limits[i], c[i])
        for kind in range(KINDS):
            if problem.active[kind] == 0.0:
                for k in range(kind * SAMPLES, (kind + 1) * SAMPLES):
                    c[i, k] = -1.0
    return cost


@fused
def _raise_worst(turn: int, q: Vector) -> None:
    """Raise the rows of the worst to the inequalities; in the second ``turn`` only what drag has a part in."""
    for k in range(SAMPLES):
        scale = G2 / q[AT_SQUARE + k]
        q[AT_VALUE + RATE * SAMPLES + k] *= scale
        q[AT_VALUE + LEAST_FORCE * SAMPLES + k] *= scale
    first, last = (0, KINDS * SAMPLES) if turn == 0 else (FORCE * SAMPLES, FLOOR * SAMPLES)
    for k in range(first, last):
        q[AT_WORST + k] = max(q[AT_WORST + k], q[AT_VALUE + k])


@fused
def _ratio(kind: int, value: float) -> float:
    """The inequality ``kind`` as a ratio to its limit where it is one."""
    return math.sqrt(max(value, -1.0) + 1.0) if kind < TILT else max(value, -REACH)


@fused
def _worst_of(kind: int, q: Vector) -> float:
    """The greatest of the inequality ``kind``; as a ratio to its limit where it is one."""
    worst = -1.0
    for k in range(kind * SAMPLES, (kind + 1) * SAMPLES):
        worst = max(worst, q[AT_WORST + k])
    return _ratio(kind, worst)


@fused
def _at_samples_alone(i: int, q: Vector, worst: Vector, sampled: Vector) -> None:
    """Fill ``sampled[i]``; where the first sample is the greatest of the segment before, what it exceeds counts too."""
    for kind in range(KINDS):
        sampled[i, kind] = _worst_of(kind, q)
        worst[i, kind] = _ratio(kind, -1.0)
        first = _ratio(kind, q[AT_WORST + kind * SAMPLES])
        if i > 0 and first > sampled[i - 1, kind]:
            sampled[i - 1, kind] = first
            worst[i, kind] = worst[i - 1, kind]


@fused
def _leap(ends: Vector) -> float:
    """m between the ends of a segment."""
    total = 0.0
    for axis in range(3):
        total += (ends[4, axis] - ends[0, axis]) ** 2
    return math.sqrt(total)


@fused_kernel
def measure(
    line: Vector, problem: Problem, fine: int, ends: Vector, samples: Vector, worst: Vector, sampled: Vector
) -> None:
    """Fill ``worst`` (n, KINDS) with how far each segment of ``line`` exceeds ``problem``, densely sampled.

    The first five are ratios to the limits, 1 where they are kept to exactly; the others are those of `at_samples`.
    ``fine`` is how many times as dense as the samples, `FINE` or 1.
    ``sampled`` (n, KINDS) is the same at the samples alone, the next segment's first included. What concerns the
    specific force counts without drag and with it, the worse of the two (M. Faessler, A. Franchi and D. Scaramuzza,
    2018, for drag that is the same in all directions).
    """
    value = samples[AT_VALUE : AT_VALUE + KINDS * SAMPLES]
    for k in range(SAMPLES):
        samples[AT_LACK + k] = -REACH
    for i in range(line.shape[0] - 1):
        duration, lack = line[i, DURATION], -LACKING
        for k in range(KINDS * SAMPLES):
            samples[AT_WORST + k] = -1.0
        scaled_ends(i, line, duration, ends)
        stride = 1 if _leap(ends) > CLOSE * 3 * SAMPLES else FINE // 3
        for part in range(fine):
            sample(DENSE[part], duration, ends, samples)
            if problem.active[CLEARANCE] != 0.0 and part % stride == 0:
                lack = _nearest(samples, problem.rows, lack, ends)
            for turn in range(2 if problem.drag != 0.0 else 1):
                add_drag(problem.drag if turn == 1 else 0.0, samples)
                at_samples(samples, problem.limits[i], value)
                _raise_worst(turn, samples)
            if part == 0:
                _at_samples_alone(i, samples, worst, sampled)
                sampled[i, CLEARANCE] = lack + problem.limits[i, CLEARANCE]
        for kind in range(KINDS):
            worst[i, kind] = max(worst[i, kind], _worst_of(kind, samples))
            if problem.active[kind] == 0.0:
                worst[i, kind] = _ratio(kind, -1.0)
        if problem.active[CLEARANCE] != 0.0:
            worst[i, CLEARANCE] = lack + problem.limits[i, CLEARANCE]
