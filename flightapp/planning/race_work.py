"""Room for the numbers of the search for a race line."""

import itertools
import math
from typing import NamedTuple

import numpy as np

from flightapp.frames import Vector
from flightapp.planning.race_problem import KINDS, PLACES
from flightapp.planning.race_rows import COLUMNS, LENGTH
from flightapp.planning.race_samples import ENTRIES, KNOT, ROWS, SAMPLES

INACTIVE = (-1.0, -1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0)
"""What the last arrays but one of a `Work`, from `Work.c` on, begin with."""


class Work(NamedTuple):
    """Room for the numbers of one solution with n segments."""

    ends: Vector
    """(11, 3) scaled ends of a segment, and three vectors."""
    samples: Vector
    """(LENGTH,) rows of one segment's samples and of their sums."""
    near: Vector
    """(n + 1, 4 SAMPLES) ways out of obstacles and how much too near these are, as of the line last looked at."""
    changes: Vector
    """(n + 1, 15 SAMPLES) the samples' derivatives by the duration."""
    gradients: Vector
    """(n + 1, KINDS 6 SAMPLES) of the inequalities, from their first row on."""
    carried: Vector
    """(4 SAMPLES COLUMNS,) second derivative by samples, by order of derivative, and scaled entries."""
    pairs: Vector
    """(ENTRIES COLUMNS,) by two scaled entries: by the first, the pair of axes xx to zz, the second."""
    totals: Vector
    """(2, 3, 8) right-hand side by scaled entries, second derivative by them and the duration."""
    powers: Vector
    """(7,) of a segment's duration."""
    diagonal: Vector
    """(n + 1, 13, 13) blocks on the diagonal, lower triangles."""
    below: Vector
    """(n, 13, 13) blocks under it."""
    factor: Vector
    """(n + 1, 13, 13)."""
    factor_below: Vector
    """(n, 13, 13)."""
    right: Vector
    """(n + 1, 13) right-hand side."""
    step: Vector
    """(n + 1, 13)."""
    tried: Vector
    """(n + 1, 13) a line."""
    c: Vector
    """(n + 1, PLACES) inequalities."""
    tried_c: Vector
    """(n + 1, PLACES) those of `tried`."""
    slack: Vector
    """(n + 1, PLACES)."""
    dual: Vector
    """(n + 1, PLACES) multipliers."""
    slope: Vector
    """(n + 1, PLACES) change of the slack by a whole step."""
    turn: Vector
    """(n + 1, PLACES) change of the multiplier."""
    penalty: Vector
    """(n + 1, PLACES) what a violation costs."""
    tried_slack: Vector
    """(n + 1, PLACES) those of `tried`."""
    counted: Vector
    """(2, PLACES) 1 where inequalities are wanted: of a segment, of the last knot."""


class Store:
    """The memory of one search after another: to get it anew every time takes longer than to clear it."""

    def __init__(self) -> None:
        self._numbers: Vector = np.empty(0)

    def room(self, n: int) -> Work:
        """For a line of ``n`` segments, until it is asked for again."""
        sizes = _sizes(n)
        counts = [math.prod(size) for size in sizes]
        ends = list(itertools.accumulate(counts))
        if ends[-1] > self._numbers.size:
            self._numbers = np.empty(ends[-1])
        self._numbers[: ends[-1]] = 0.0
        arrays = [
            self._numbers[end - count : end].reshape(size) for size, count, end in zip(sizes, counts, ends, strict=True)
        ]
        for array, value in zip(arrays[-1 - len(INACTIVE) :], INACTIVE, strict=False):
            array[:] = value
        return Work._make(arrays)


def _sizes(n: int) -> tuple[tuple[int, ...], ...]:
    """Of the arrays of a `Work`."""
    sizes: tuple[tuple[int, ...], ...] = (
        (
            (11, 3),
            (LENGTH,),
            (n + 1, 4 * SAMPLES),
            (n + 1, ROWS * SAMPLES),
            (n + 1, KINDS * 6 * SAMPLES),
            (4 * SAMPLES * COLUMNS,),
            (ENTRIES * COLUMNS,),
            (2, 3, ENTRIES),
            (7,),
        )
        + ((n + 1, KNOT, KNOT), (n, KNOT, KNOT)) * 2
        + ((n + 1, KNOT),) * 3
    )
    return sizes + ((n + 1, PLACES),) * len(INACTIVE) + ((2, PLACES),)
