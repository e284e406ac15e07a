"""What is left of the last line, moved to where its gates are now: where the next search begins in flight."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.interfaces import PlanRequest
from flightapp.jit import lean_kernel
from flightapp.messages import GateEstimate
from flightapp.planning.race_problem import AT_KNOT, KINDS, PLACES
from flightapp.planning.race_samples import DURATION, KNOT, SAMPLES, motion_at
from flightapp.planning.race_smooth import bend
from flightapp.planning.race_start import Layout, joined, lay_out

OFF = 1.0
"""m from the last line at which a start does not continue it."""
EARLY = 0.15
"""s after the start at which there is a knot, if none is near: a start in the middle of a turn needs one."""
TOO_EARLY, EARLY_ENOUGH = 0.5, 2.0
"""Times that: a knot before it is left out, unless a gate is there, and one before this is enough."""
INSTANT = 0.02
"""s, least duration of a segment to start with."""


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """A line that was planned."""

    request: PlanRequest
    layout: Layout
    """The line as it was found; its anchors are those of the start, of the request's gates, and of the end."""
    drawn: Vector
    """(n, KINDS) shares of the limits that the segments had to keep to at their samples."""
    duals: Vector
    """(2, n + 1, PLACES) slacks and multipliers."""


def continued(memory: Memory, request: PlanRequest, centres: Vector, directions: Vector, ends: Vector) -> Layout | None:
    """A line for ``request`` from what ``memory`` has beyond its start; None where it does not continue it.

    ``centres`` and ``directions`` (m + 2, 3) are those of the start, the gates and the end; ``ends`` as in `lay_out`.
    """
    old = memory.request
    times = np.concatenate(([0.0], np.cumsum(memory.layout.line[:-1, DURATION])))
    t = request.stamp - old.stamp
    if not 0.0 < t < times[-1] - INSTANT or request.limits != old.limits:
        return None
    passed = int(np.count_nonzero(times[memory.layout.anchors[1:-1]] <= t))
    common = _common(old.gates[passed:], request.gates)
    whole = common == len(old.gates) - passed == len(request.gates)
    begun = motion_at(memory.layout.line, times, t)
    if not (whole or common) or math.dist(begun[:3], request.start.position) > OFF:
        return None
    left = _left(memory, times, t, memory.layout.anchors[1 + passed :][: common + whole])
    line, goals = left.line, [gate.position for gate in old.gates[passed : passed + common]] + [old.end] * whole
    moves = np.vstack((request.start.position - begun[:3], centres[1 : len(left.anchors)] - np.array(goals)))
    bend(line, left.anchors, moves, ends[0] - begun[3:].reshape(3, 3))
    if whole:
        line[-1, :3], line[-1, 3:DURATION] = request.end, ends[1].ravel()
        return left
    onwards = np.array([line[-1, 3:DURATION].reshape(3, 3), ends[1]])
    return joined(left, lay_out(centres[common:], directions[common:], onwards, request.limits.v_max, 1.0))


def _left(memory: Memory, times: Vector, t: float, anchors: NDArray[np.intp]) -> Layout:
    """What there is of the line from ``t`` s on, up to the last of its ``anchors`` (m,), which are all after that."""
    last, first = int(anchors[-1]), int(np.searchsorted(times, t, side="right"))
    while first < last and first not in anchors and times[first] - t < TOO_EARLY * EARLY:
        first += 1
    line, drawn, duals = _remainder(memory, times, t, first, last)
    kept = np.concatenate(([0], anchors - (last + 1 - len(line))))
    return Layout(line, kept, len(line) - 1, drawn, duals, memory.layout.lowest)


def _remainder(memory: Memory, times: Vector, t: float, first: int, last: int) -> tuple[Vector, Vector, Vector]:
    """Line, shares and multipliers from ``t`` s on, with the knots ``first`` to ``last`` and perhaps one before."""
    begins = (t,) if times[first] - t <= EARLY_ENOUGH * EARLY else (t, t + EARLY)
    new, n = len(begins), len(begins) + last - first
    line, drawn, duals = np.empty((n + 1, KNOT)), np.empty((n, KINDS)), np.empty((2, n + 1, PLACES))
    line[new:], drawn[new:] = memory.layout.line[first : last + 1], memory.drawn[first:last]
    duals[:, new:] = memory.duals[:, first : last + 1]
    for k, begin in enumerate(begins):
        end = begins[k + 1] if k + 1 < new else float(times[first])
        line[k, :DURATION], line[k, DURATION] = motion_at(memory.layout.line, times, begin), max(end - begin, INSTANT)
        drawn[k] = memory.drawn[int(np.searchsorted(times, 0.5 * (begin + end), side="right")) - 1]
        _recall(memory.duals, times, begin, end, k, duals)
    return line, drawn, duals


@lean_kernel
def _recall(known: Vector, times: Vector, begin: float, end: float, to: int, duals: Vector) -> None:
    """Fill ``duals[:, to]`` (PLACES,) with slacks and multipliers of a segment from ``begin`` to ``end`` s of the line.

    ``known`` (2, n + 1, PLACES) are those of the line, whose knots are passed at ``times`` (n + 1,) s.
    """
    i, n = 0, times.size - 1
    for k in range(SAMPLES):
        at = begin + (end - begin) / SAMPLES * k
        while i < n - 1 and times[i + 1] <= at:
            i += 1
        if k == 0:
            for place in range(AT_KNOT, PLACES):
                duals[0, to, place] = 1.0
                duals[1, to, place] = min(known[1, i, AT_KNOT], known[1, i, AT_KNOT + 1], known[1, i, AT_KNOT + 2])
        span = times[i + 1] - times[i]
        nearest = min(int(SAMPLES * (at - times[i]) / span + 0.5), SAMPLES - 1)
        for kind in range(KINDS):
            duals[0, to, kind * SAMPLES + k] = known[0, i, kind * SAMPLES + nearest]
            duals[1, to, kind * SAMPLES + k] = known[1, i, kind * SAMPLES + nearest] * (end - begin) / span


def _common(old: Sequence[GateEstimate], new: Sequence[GateEstimate]) -> int:
    """How many of the leading gates are the same."""
    count = 0
    while count < min(len(old), len(new)) and old[count].gate_id == new[count].gate_id:
        count += 1
    return count
