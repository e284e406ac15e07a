"""The equations of a step towards a race line: the Lagrangian's second derivative, condensed for an interior point.

Samples are linear in the ends of their segment, in units scaled by the duration, with the same coefficients on every
axis. So what the inequalities contribute in terms of position, velocity, acceleration and jerk is summed per sample and
carried over to the ends at once. The second derivatives of samples by the duration are left out (Gauss-Newton).
"""

import math

from flightapp.frames import Vector
from flightapp.jit import fused, fused_kernel
from flightapp.planning.race_carry import carry
from flightapp.planning.race_problem import (
    AREA,
    BRIEF,
    CLEARANCE,
    CROSSING,
    FLOOR,
    KINDS,
    SLOW,
    Problem,
    off_centre,
    out_of_plane,
    square,
)
from flightapp.planning.race_rows import (
    AT_AA,
    AT_FF,
    AT_FJ,
    AT_JJ,
    AT_MOVED,
    AT_PP,
    AT_PULL,
    AT_VV,
    S,
)
from flightapp.planning.race_samples import (
    AT_A,
    AT_F,
    AT_J,
    AT_P,
    AT_V,
    BY_ENTRY,
    DURATION,
    KNOT,
    ROWS,
    add_drag,
    sample,
    sample_changes,
    scaled_ends,
    take_back,
)
from flightapp.planning.race_terms import sum_samples
from flightapp.planning.race_work import Work


@fused
def _times_block(block: int, at: int, s: Vector, change: Vector) -> None:
    """Add a symmetric block of second derivatives times the change of three rows to `AT_MOVED`."""
    for k in range(S):
        x, y, z = change[at + k], change[at + S + k], change[at + 2 * S + k]
        xy, xz, yz = s[block + S + k], s[block + 2 * S + k], s[block + 4 * S + k]
        s[AT_MOVED + at + k] += s[block + k] * x + xy * y + xz * z
        s[AT_MOVED + at + S + k] += xy * x + s[block + 3 * S + k] * y + yz * z
        s[AT_MOVED + at + 2 * S + k] += xz * x + yz * y + s[block + 5 * S + k] * z


@fused
def _times_mixed(s: Vector, change: Vector) -> None:
    """The same for the second derivatives by force and its derivative."""
    for a in range(3):
        force, jerk, mixed = a * S, AT_MOVED + AT_J + a * S, AT_FJ + 3 * a * S
        for k in range(S):
            s[AT_MOVED + AT_F + force + k] += (
                s[mixed + k] * change[AT_J + k]
                + s[mixed + S + k] * change[AT_J + S + k]
                + s[mixed + 2 * S + k] * change[AT_J + 2 * S + k]
            )
        for k in range(S):
            s[jerk + k] += (
                s[AT_FJ + a * S + k] * change[AT_F + k]
                + s[AT_FJ + (3 + a) * S + k] * change[AT_F + S + k]
                + s[AT_FJ + (6 + a) * S + k] * change[AT_F + 2 * S + k]
            )


@fused
def _with_duration(duration: float, smooth: float, s: Vector, change: Vector) -> tuple[float, float]:
    """Add smoothing, and fill the rows of the second derivative by the samples and the duration.

    Returns the right-hand side of the duration and its second derivative.
    """
    share = smooth / S
    right, bend = -1.0, 0.0
    for k in range(3 * S):
        s[AT_PULL + AT_J + k] += share * duration * s[AT_J + k]
        s[AT_MOVED + AT_J + k] = share * s[AT_J + k]
        right -= 0.5 * share * s[AT_J + k] * s[AT_J + k]
        bend += share * s[AT_J + k] * change[AT_J + k]
    for block in (0, 3, 5):
        for k in range(S):
            s[AT_JJ + block * S + k] += share * duration
    _times_block(AT_PP, AT_P, s, change)
    _times_block(AT_VV, AT_V, s, change)
    _times_block(AT_FF, AT_F, s, change)
    _times_block(AT_JJ, AT_J, s, change)
    _times_block(AT_AA, AT_A, s, change)
    _times_mixed(s, change)
    for k in range(ROWS * S):
        bend += s[AT_MOVED + k] * change[k]
        right -= s[AT_PULL + k] * change[k]
    return right, bend


@fused
def _at_knot(k: int, line: Vector, problem: Problem, mu: float, work: Work) -> None:
    """Add the inequalities of knot ``k`` and its plane to its block and right-hand side."""
    D, x, g = work.diagonal[k], work.right[k], work.ends[8]
    lack = out_of_plane(k, line, problem)
    for a in range(3):
        x[a] -= lack * problem.planes[k, a]
        for b in range(3):
            D[a, b] += problem.planes[k, a] * problem.planes[k, b]
    if problem.active[KINDS + 1] != 0.0:
        s, weight = work.slack[k, AREA], work.dual[k, AREA]
        off_centre(k, line, problem, g)
        force = 2.0 * (mu + weight * (work.c[k, AREA] + s)) / s
        for a in range(3):
            x[a] -= force * g[a]
            for b in range(3):
                D[a, b] += 4.0 * weight / s * g[a] * g[b] + 2.0 * weight * problem.areas[k, a, b]
    if problem.active[KINDS + 2] != 0.0 and square(problem.normals[k]) > 0.0:
        s, weight = work.slack[k, CROSSING], work.dual[k, CROSSING]
        v = line[k, 3:6]
        speed = math.sqrt(square(v) + SLOW * SLOW)
        for a in range(3):
            g[a] = problem.cosine * v[a] / speed - problem.normals[k, a]
        force = (mu + weight * (work.c[k, CROSSING] + s)) / s
        bend = weight * problem.cosine / speed
        for a in range(3):
            x[3 + a] -= force * g[a]
            D[3 + a, 3 + a] += bend
            for b in range(3):
                D[3 + a, 3 + b] += weight / s * g[a] * g[b] - bend * v[a] * v[b] / (speed * speed)


@fused_kernel
def assemble(line: Vector, problem: Problem, mu: float, work: Work) -> None:
    """Fill ``work``'s blocks and right-hand side at ``line`` (n + 1, 13), for the barrier ``mu``."""
    n = line.shape[0] - 1
    with_places = problem.active[FLOOR] != 0.0 or problem.active[CLEARANCE] != 0.0
    for k in range(n + 1):
        for a in range(KNOT):
            work.right[k, a] = 0.0
            for b in range(KNOT):
                work.diagonal[k, a, b] = 0.0
    for i in range(n + 1):
        _at_knot(i, line, problem, mu, work)
        if i == n:
            break
        duration = line[i, DURATION]
        scaled_ends(i, line, duration, work.ends)
        sample(BY_ENTRY, duration, work.ends, work.samples)
        sample_changes(duration, work.ends, work.samples, work.changes[i])
        add_drag(problem.drag, work.samples)
        add_drag(problem.drag, work.changes[i])
        sum_samples(i, problem, mu, work)
        right, bend = _with_duration(duration, problem.smooth, work.samples, work.changes[i])
        take_back(problem.drag, work.samples, AT_PULL)
        take_back(problem.drag, work.samples, AT_MOVED)
        carry(i, duration, problem.drag, with_places, work)
        s, weight, slope = work.slack[i, BRIEF], work.dual[i, BRIEF], -1.0 / problem.briefest[i]
        work.right[i, DURATION] = right - slope * (mu + weight * (work.c[i, BRIEF] + s)) / s
        work.diagonal[i, DURATION, DURATION] = bend + weight / s * slope * slope
