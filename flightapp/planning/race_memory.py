"""What is left of the last line, moved to where its gates are now: where the next search begins in flight."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.interfaces import PlanRequest
from flightapp.planning.race_samples import DURATION, knot_at
from flightapp.planning.race_smooth import bend
from flightapp.planning.race_start import Layout, joined, lay_out

OFF = 1.0
"""m from the last line at which a start does not continue it."""
STUB = 0.35
"""Share of the next segment's duration that the rest of the first one must have to stay one of its own."""
EARLY = 0.15
"""s after the start at which there is a knot, if the first segment is twice as long or more."""
INSTANT = 0.02
"""s, least duration of a segment to start with."""


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """A line that was planned."""

    request: PlanRequest
    line: Vector
    """(n + 1, 13)."""
    anchors: NDArray[np.intp]
    """(m + 2,) the knots of the start, of the request's gates, and of the end."""
    drawn: Vector
    """(n, KINDS) shares of the limits that the segments had to keep to at their samples."""


def continued(memory: Memory, request: PlanRequest, centres: Vector, directions: Vector, ends: Vector) -> Layout | None:
    """A line for ``request`` from what ``memory`` has beyond its start; None where it does not continue it.

    ``centres`` and ``directions`` (m + 2, 3) are those of the start, the gates and the end; ``ends`` as in `lay_out`.
    """
    old = memory.request
    times = np.concatenate(([0.0], np.cumsum(memory.line[:-1, DURATION])))
    t = request.stamp - old.stamp
    if not 0.0 < t < times[-1] - INSTANT or request.limits != old.limits:
        return None
    passed = int(np.count_nonzero(times[memory.anchors[1:-1]] <= t))
    left = [gate.gate_id for gate in old.gates[passed:]]
    common = _common(left, [gate.gate_id for gate in request.gates])
    whole = common == len(left) == len(request.gates)
    if not whole and common == 0:
        return None
    first = int(np.searchsorted(times, t, side="right"))
    share = (t - times[first - 1]) / (times[first] - times[first - 1])
    near = (1.0 - share) * memory.line[first - 1, :3] + share * memory.line[first, :3]
    if math.dist(near, request.start.position) > OFF:
        return None
    anchors = memory.anchors[1 + passed :]
    if first not in anchors and times[first] - t < STUB * memory.line[first, DURATION]:
        first += 1
    last = int(anchors[-1] if whole else anchors[common - 1])
    line = memory.line[first - 1 : last + 1].copy()
    line[0, DURATION] = max(times[first] - t, INSTANT)
    line[0, :3], line[0, 3:DURATION] = request.start.position, ends[0].ravel()
    kept = np.concatenate(([0], anchors[: common + whole] - (first - 1)))
    drawn = memory.drawn[first - 1 : last]
    if line[0, DURATION] > 2.0 * EARLY:
        # A start in the middle of a turn needs a knot soon after it.
        line, drawn = _divided(line), np.vstack((drawn[:1], drawn))
        kept[1:] += 1
    goals = [gate.position for gate in old.gates[passed : passed + common]] + [old.end]
    moves = np.vstack((np.zeros(3), centres[1 : len(kept)] - np.array(goals[: len(kept) - 1])))
    if not bend(line, kept, moves):
        return None
    kept_layout = Layout(line, kept, np.zeros(len(line)), drawn)
    if whole:
        line[-1, :3], line[-1, 3:DURATION] = request.end, ends[1].ravel()
        return kept_layout
    onwards = np.array([line[-1, 3:DURATION].reshape(3, 3), ends[1]])
    rest = lay_out(centres[common:], directions[common:], onwards, request.limits.v_max, 1.0)
    return joined(kept_layout, rest)


def _divided(line: Vector) -> Vector:
    """``line`` with another knot in its first segment."""
    early = np.concatenate((knot_at(line, 0, EARLY / line[0, DURATION]), [line[0, DURATION] - EARLY]))
    divided = np.vstack((line[:1], early, line[1:]))
    divided[0, DURATION] = EARLY
    return divided


def _common(old: list[int], new: list[int]) -> int:
    """How many of the leading gates are the same."""
    count = 0
    while count < min(len(old), len(new)) and old[count] == new[count]:
        count += 1
    return count
