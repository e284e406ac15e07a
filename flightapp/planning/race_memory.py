"""What is left of the last line, moved to where its gates are now: where the next search begins in flight."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from flightapp.interfaces import PlanRequest
from flightapp.planning.race_problem import AT_KNOT, KINDS, PLACES
from flightapp.planning.race_samples import DURATION, SAMPLES, motion_at
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
    left = [gate.gate_id for gate in old.gates[passed:]]
    common = _common(left, [gate.gate_id for gate in request.gates])
    whole = common == len(left) == len(request.gates)
    if not whole and common == 0:
        return None
    begun = motion_at(memory.layout.line, times, t)
    if math.dist(begun[:3], request.start.position) > OFF:
        return None
    anchors = memory.layout.anchors[1 + passed :]
    last = int(anchors[-1] if whole else anchors[common - 1])
    first = int(np.searchsorted(times, t, side="right"))
    while first < last and first not in anchors and times[first] - t < TOO_EARLY * EARLY:
        first += 1
    line, drawn, duals = _remainder(memory, times, t, first, last)
    kept = np.concatenate(([0], anchors[: common + whole] - (last + 1 - len(line))))
    goals = [gate.position for gate in old.gates[passed : passed + common]] + [old.end]
    moves = np.vstack((request.start.position - begun[:3], centres[1 : len(kept)] - np.array(goals[: len(kept) - 1])))
    bend(line, kept, moves, ends[0] - begun[3:].reshape(3, 3))
    kept_layout = Layout(line, kept, len(line) - 1, drawn, duals, memory.layout.lowest)
    if whole:
        line[-1, :3], line[-1, 3:DURATION] = request.end, ends[1].ravel()
        return kept_layout
    onwards = np.array([line[-1, 3:DURATION].reshape(3, 3), ends[1]])
    rest = lay_out(centres[common:], directions[common:], onwards, request.limits.v_max, 1.0)
    return joined(kept_layout, rest)


def _remainder(memory: Memory, times: Vector, t: float, first: int, last: int) -> tuple[Vector, Vector, Vector]:
    """Line, shares and multipliers from ``t`` s on, with the knots ``first`` to ``last`` and perhaps one before."""
    line, drawn = memory.layout.line[first : last + 1], memory.drawn[first:last]
    duals, end = memory.duals[:, first : last + 1], float(times[first])
    for begin in (t,) if end - t <= EARLY_ENOUGH * EARLY else (t + EARLY, t):
        knot = np.append(motion_at(memory.layout.line, times, begin), max(end - begin, INSTANT))
        segment = int(np.searchsorted(times, 0.5 * (begin + end), side="right")) - 1
        line, drawn = np.vstack((knot, line)), np.vstack((memory.drawn[segment], drawn))
        duals = np.concatenate((_duals(memory, times, begin, end)[:, None], duals), axis=1)
        end = begin
    return line, drawn, duals


def _duals(memory: Memory, times: Vector, begin: float, end: float) -> Vector:
    """(2, PLACES) slacks and multipliers at the samples of a segment from ``begin`` to ``end`` s of the line."""
    at = begin + (end - begin) / SAMPLES * np.arange(SAMPLES)
    i = np.minimum(np.searchsorted(times, at, side="right"), len(times) - 1) - 1
    spans = times[i + 1] - times[i]
    k = np.minimum(np.rint(SAMPLES * (at - times[i]) / spans).astype(int), SAMPLES - 1)
    out = np.empty((2, PLACES))
    samples = memory.duals[:, :, :AT_KNOT].reshape(2, len(times), KINDS, SAMPLES)[:, i, :, k]
    samples[:, 1] *= ((end - begin) / spans)[:, None]
    out[:, :AT_KNOT] = samples.transpose(1, 2, 0).reshape(2, AT_KNOT)
    out[0, AT_KNOT:] = 1.0
    out[1, AT_KNOT:] = memory.duals[1, i[0], AT_KNOT:].min()
    return out


def _common(old: list[int], new: list[int]) -> int:
    """How many of the leading gates are the same."""
    count = 0
    while count < min(len(old), len(new)) and old[count] == new[count]:
        count += 1
    return count
