"""The equations of a step towards a race line: the Lagrangian's second derivative, condensed for an interior point.

Samples are linear in the ends of their segment, in units scaled by the duration, with the same coefficients on every
axis. So what the inequalities contribute in terms of position, velocity, acceleration and jerk is summed per sample and
carried over to the ends at once. The second derivatives of samples by the duration are left out (Gauss-Newton).
"""

import math

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
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
from flightapp.planning.race_samples import (
    BY_ENTRY,
    BY_SAMPLE,
    DURATION,
    ENTRIES,
    KNOT,
    PLACE_PRODUCTS,
    PRODUCTS,
    SAMPLES,
    add_drag,
    sample,
    sample_changes,
    scaled_ends,
    take_back,
)
from flightapp.planning.race_terms import sum_samples
from flightapp.planning.race_work import Work


@inlined
def _with_duration(i: int, duration: float, smooth: float, work: Work) -> tuple[float, float]:
    """Add smoothing, and fill ``work.moved`` with the second derivative by the samples and the duration.

    Returns the right-hand side of the duration and its second derivative.
    """
    q, change, H, pull = work.samples[0:15], work.changes[i], work.curvature, work.pull
    share = smooth / SAMPLES
    right, bend = -1.0, 0.0
    for a in range(9, 12):
        for k in range(SAMPLES):
            H[a, a, k] += share * duration
            pull[a, k] += share * duration * q[a, k]
            right -= 0.5 * share * q[a, k] * q[a, k]
            bend += share * q[a, k] * change[a, k]
    for a in range(pull.shape[0]):
        first, last = (6, 12) if 6 <= a < 12 else (a // 3 * 3, a // 3 * 3 + 3)
        moved = work.moved[a]
        for k in range(SAMPLES):
            moved[k] = share * q[a, k] if 9 <= a < 12 else 0.0
        for b in range(first, last):
            block = H[min(a, b), max(a, b)]
            for k in range(SAMPLES):
                moved[k] += block[k] * change[b, k]
        for k in range(SAMPLES):
            bend += moved[k] * change[a, k]
            right -= pull[a, k] * change[a, k]
    return right, bend


@inlined
def _carry_sums(duration: float, work: Work) -> None:
    """Fill ``work.totals`` with what the samples' sums are by the scaled ends of the segment."""
    pull, moved, totals = work.pull, work.moved, work.totals
    s1 = 1.0 / duration
    s2, s3 = s1 * s1, s1 * s1 * s1
    for a in range(totals.shape[1]):
        right, by_duration = totals[0, a], totals[1, a]
        for e in range(ENTRIES):
            right[e] = by_duration[e] = 0.0
        for k in range(SAMPLES):
            b = BY_SAMPLE[k]
            x0, x1, x2, x3 = pull[a, k], s1 * pull[3 + a, k], s2 * pull[6 + a, k], s3 * pull[9 + a, k]
            z0, z1, z2, z3 = moved[a, k], s1 * moved[3 + a, k], s2 * moved[6 + a, k], s3 * moved[9 + a, k]
            for e in range(ENTRIES):
                right[e] -= x0 * b[0, e] + x1 * b[1, e] + x2 * b[2, e] + x3 * b[3, e]
                by_duration[e] += z0 * b[0, e] + z1 * b[1, e] + z2 * b[2, e] + z3 * b[3, e]


@inlined
def _carry_curvature(duration: float, work: Work) -> None:
    """Fill ``work.pairs`` with what ``work.curvature`` is by the segment's scaled ends, but for positions and drag."""
    H = work.curvature
    s2 = 1.0 / (duration * duration)
    s4, s5, s6 = s2 * s2, s2 * s2 / duration, s2 * s2 * s2
    for a in range(work.pairs.shape[0]):
        for b in range(a, work.pairs.shape[1]):
            target = work.pairs[a, b]
            for m in range(ENTRIES * ENTRIES):
                target[m] = 0.0
            for k in range(SAMPLES):
                vv, jj = s2 * H[3 + a, 3 + b, k], s6 * H[9 + a, 9 + b, k]
                aa = s4 * (H[6 + a, 6 + b, k] + H[12 + a, 12 + b, k])
                aj, ja = s5 * H[6 + a, 9 + b, k], s5 * H[6 + b, 9 + a, k]
                products = PRODUCTS[k]
                for m in range(ENTRIES * ENTRIES):
                    target[m] += (
                        vv * products[0, m]
                        + aa * products[1, m]
                        + jj * products[2, m]
                        + aj * products[3, m]
                        + ja * products[4, m]
                    )


@inlined
def _carry_drag(duration: float, drag: float, work: Work) -> None:
    """Add to ``work.pairs`` what ``work.curvature`` is by way of ``drag``: samples depend on lower derivatives, too."""
    H = work.curvature
    s1 = 1.0 / duration
    d1, d2 = drag, drag * drag
    for a in range(work.pairs.shape[0]):
        for b in range(a, work.pairs.shape[1]):
            target = work.pairs[a, b]
            for k in range(SAMPLES):
                aa, jj = H[6 + a, 6 + b, k], H[9 + a, 9 + b, k]
                aj, ja = H[6 + a, 9 + b, k], H[6 + b, 9 + a, k]
                vv = s1 * s1 * d2 * aa
                va, av = s1**3 * (d1 * aa + d2 * aj), s1**3 * (d1 * aa + d2 * ja)
                vj, jv = s1**4 * d1 * aj, s1**4 * d1 * ja
                more = s1**4 * (d1 * (aj + ja) + d2 * jj)
                both = s1**5 * d1 * jj
                products = PRODUCTS[k]
                for m in range(ENTRIES * ENTRIES):
                    target[m] += (
                        vv * products[0, m]
                        + more * products[1, m]
                        + both * (products[3, m] + products[4, m])
                        + va * products[5, m]
                        + av * products[6, m]
                        + vj * products[7, m]
                        + jv * products[8, m]
                    )


@inlined
def _carry_places(work: Work) -> None:
    """Add to ``work.pairs`` what concerns positions; it does at few samples."""
    for a in range(work.pairs.shape[0]):
        for b in range(a, work.pairs.shape[1]):
            target = work.pairs[a, b]
            for k in range(SAMPLES):
                pp = work.curvature[a, b, k]
                if pp != 0.0:
                    for m in range(ENTRIES * ENTRIES):
                        target[m] += pp * PLACE_PRODUCTS[k, m]


@inlined
def _scatter(i: int, duration: float, work: Work) -> None:
    """Add the sums of segment ``i`` to the blocks of its two knots."""
    near, far, below = work.diagonal[i], work.diagonal[i + 1], work.below[i]
    totals, pairs = work.totals, work.pairs
    orders, axes = totals.shape[2] // 2, pairs.shape[0]
    first = 1.0
    for d in range(orders):
        for a in range(axes):
            row = 3 * d + a
            work.right[i, row] += first * totals[0, a, d]
            work.right[i + 1, row] += first * totals[0, a, 4 + d]
            near[DURATION, row] += first * totals[1, a, d]
            below[row, DURATION] = first * totals[1, a, 4 + d]
            second = first
            for f in range(orders):
                for b in range(axes):
                    column = 3 * f + b
                    if b >= a:
                        block = pairs[a, b]
                        near[row, column] += second * block[8 * d + f]
                        far[row, column] += second * block[36 + 8 * d + f]
                        below[row, column] = second * block[32 + 8 * d + f]
                    else:
                        block = pairs[b, a]
                        near[row, column] += second * block[8 * f + d]
                        far[row, column] += second * block[36 + 8 * f + d]
                        below[row, column] = second * block[4 + 8 * f + d]
                second *= duration
        first *= duration


@inlined
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


@lean_kernel
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
        right, bend = _with_duration(i, duration, problem.smooth, work)
        take_back(problem.drag, work.pull)
        take_back(problem.drag, work.moved)
        _carry_sums(duration, work)
        _carry_curvature(duration, work)
        if problem.drag != 0.0:
            _carry_drag(duration, problem.drag, work)
        if with_places:
            _carry_places(work)
        _scatter(i, duration, work)
        s, weight, slope = work.slack[i, BRIEF], work.dual[i, BRIEF], -1.0 / problem.briefest[i]
        work.right[i, DURATION] = right - slope * (mu + weight * (work.c[i, BRIEF] + s)) / s
        work.diagonal[i, DURATION, DURATION] = bend + weight / s * slope * slope
