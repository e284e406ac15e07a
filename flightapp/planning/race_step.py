"""A step towards a race line: its equations solved, its curve, and how the inequalities change along it."""

import math

from flightapp.frames import Vector
from flightapp.jit import fused
from flightapp.planning.race_blocks import factorise, solve
from flightapp.planning.race_problem import (
    AREA,
    BRIEF,
    CROSSING,
    FLOOR,
    FORCE,
    KINDS,
    RATE,
    SLOW,
    Problem,
    off_centre,
    square,
)
from flightapp.planning.race_rows import S
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
    scaled_ends,
)
from flightapp.planning.race_work import Work

REFUSALS = 12
"""Times that the damping is raised for one step."""


@fused
def _hold(rows: Vector, columns: Vector, block: Vector) -> None:
    """Zero what of ``block`` (13, 13) belongs to ``rows`` and ``columns`` (13,) of 1."""
    for a in range(KNOT):
        if rows[a] != 0.0:
            for b in range(KNOT):
                block[a, b] = 0.0
        if columns[a] != 0.0:
            for b in range(KNOT):
                block[b, a] = 0.0


@fused
def _damp(line: Vector, problem: Problem, damping: float, work: Work) -> None:
    """Copy the blocks to the factor's place, without fixed variables and with damping on the diagonal.

    Damping is relative to the segment's length and duration: with damping 1 a step of that size costs the duration.
    """
    n = line.shape[0] - 1
    for k in range(n + 1):
        D, source, fixed, step = work.factor[k], work.diagonal[k], problem.fixed[k], work.step[k]
        held = 0.0
        for a in range(KNOT):
            held += fixed[a]
            step[a] = work.right[k, a] * (1.0 - fixed[a])
            for b in range(a + 1):
                D[a, b] = source[a, b]
        if held > 0.0:
            _hold(fixed, fixed, D)
        i = min(k, n - 1)
        duration, away = line[i, DURATION], 0.0
        for a in range(3):
            away += (line[i + 1, a] - line[i, a]) ** 2
        measure = damping * duration / max(away, 1e-4)
        for d in range(4):
            for a in range(3 * d, 3 * d + 3):
                D[a, a] += measure * (1.0 - fixed[a]) + fixed[a]
            measure *= duration * duration
        D[DURATION, DURATION] += damping / duration * (1.0 - fixed[DURATION]) + fixed[DURATION]
        if k < n:
            E, below, after = work.factor_below[k], work.below[k], problem.fixed[k + 1]
            for a in range(KNOT):
                held += after[a]
                for b in range(E.shape[1]):
                    E[a, b] = below[a, b]
            if held > 0.0:
                _hold(after, fixed, E)


@fused
def move(line: Vector, step: Vector, share: float, problem: Problem, tried: Vector) -> None:
    """Fill ``tried`` with ``line`` moved by ``share`` of ``step``, derivatives of knots along with durations."""
    n = line.shape[0] - 1
    before = 0.0
    for k in range(n + 1):
        after = share * step[k, DURATION] / line[k, DURATION] if k < n else 0.0
        rate = 0.5 * (before + after) if 0 < k < n else 0.0
        shrink, scale = math.exp(-rate), 1.0
        for d in range(4):
            for a in range(3 * d, 3 * d + 3):
                if problem.fixed[k, a] != 0.0:
                    tried[k, a] = line[k, a]
                else:
                    tried[k, a] = scale * (line[k, a] * (1.0 + d * rate) + share * step[k, a])
            scale *= shrink
        tried[k, DURATION] = line[k, DURATION] * math.exp(after)
        before = after


@fused
def _crossing_slope(k: int, line: Vector, problem: Problem, step: Vector) -> float:
    v, n = line[k, 3:6], problem.normals[k]
    if square(n) == 0.0:
        return 0.0
    speed = math.sqrt(square(v) + SLOW * SLOW)
    total = 0.0
    for a in range(3):
        total += (problem.cosine * v[a] / speed - n[a]) * step[k, 3 + a]
    return total


@fused
def _slopes_at_samples(q: Vector, g: Vector, slope: Vector) -> None:
    """The same at samples that change by ``q``, with the gradients ``g`` (KINDS 6 SAMPLES,), zero where not wanted."""
    for k in range(S):
        x, y, z = q[AT_F + k], q[AT_F + S + k], q[AT_F + 2 * S + k]
        for kind in range(FORCE, FLOOR):
            row = 6 * S * kind + k
            slope[kind * S + k] = g[row] * x + g[row + S] * y + g[row + 2 * S] * z
        row = 6 * S * RATE + 3 * S + k
        slope[RATE * S + k] += (
            g[row] * q[AT_J + k] + g[row + S] * q[AT_J + S + k] + g[row + 2 * S] * q[AT_J + 2 * S + k]
        )
        x, y, z = q[AT_P + k], q[AT_P + S + k], q[AT_P + 2 * S + k]
        for kind in range(FLOOR, KINDS):
            row = 6 * S * kind + k
            slope[kind * S + k] = g[row] * x + g[row + S] * y + g[row + 2 * S] * z
        slope[k] = g[k] * q[AT_V + k] + g[S + k] * q[AT_V + S + k] + g[2 * S + k] * q[AT_V + 2 * S + k]
        slope[S + k] = g[6 * S + k] * q[AT_A + k] + g[7 * S + k] * q[AT_A + S + k] + g[8 * S + k] * q[AT_A + 2 * S + k]


@fused
def slopes(line: Vector, problem: Problem, work: Work) -> None:
    """Fill ``work.slope`` (n + 1, PLACES): how the inequalities change by the step."""
    step, slope, g = work.step, work.slope, work.ends[8]
    q = work.samples
    n = line.shape[0] - 1
    for i in range(n + 1):
        if problem.active[KINDS + 1] != 0.0:
            off_centre(i, line, problem, g)
            slope[i, AREA] = 2.0 * (g[0] * step[i, 0] + g[1] * step[i, 1] + g[2] * step[i, 2])
        if problem.active[KINDS + 2] != 0.0:
            slope[i, CROSSING] = _crossing_slope(i, line, problem, step)
        if i == n:
            break
        duration, longer = line[i, DURATION], step[i, DURATION]
        slope[i, BRIEF] = -longer / problem.briefest[i]
        scaled_ends(i, step, duration, work.ends)
        sample(BY_ENTRY, duration, work.ends, q)
        add_drag(problem.drag, q)
        for k in range(ROWS * S):
            q[k] += longer * work.changes[i, k]
        _slopes_at_samples(q, work.gradients[i], slope[i])


@fused
def take_step(line: Vector, problem: Problem, damping: float, work: Work) -> tuple[float, int]:
    """Fill ``work.step``; returns the damping it took, negative if none was enough, and how often it was raised."""
    for refused in range(REFUSALS):
        _damp(line, problem, damping, work)
        if factorise(work.factor, work.factor_below):
            solve(work.factor, work.factor_below, work.step)
            return damping, refused
        damping = max(10.0 * damping, 1e-4)
    return -1.0, REFUSALS
