"""Room for the numbers of the search for a race line."""

from typing import NamedTuple

import numpy as np

from flightapp.frames import Vector
from flightapp.planning.race_problem import KINDS, PLACES
from flightapp.planning.race_samples import ENTRIES, KNOT, ROWS, SAMPLES


class Work(NamedTuple):
    """Room for the numbers of one solution with n segments."""

    ends: Vector
    """(9, 3) scaled ends of a segment, and a vector."""
    samples: Vector
    """(20, SAMPLES) samples, directions away from obstacles."""
    changes: Vector
    """(n + 1, 15, SAMPLES) the samples' derivatives by the duration."""
    pull: Vector
    """(15, SAMPLES) right-hand side by the samples."""
    moved: Vector
    """(15, SAMPLES) second derivative by the samples and the duration."""
    weights: Vector
    """(2, SAMPLES)."""
    curvature: Vector
    """(15, 15, SAMPLES) second derivative by the samples: upper halves of the blocks 0 : 3 : 6 : 12 : 15."""
    gradients: Vector
    """(n + 1, KINDS, 6, SAMPLES) of the inequalities, from their first row on."""
    pairs: Vector
    """(3, 3, 64) second derivative by scaled entries, between axes b >= a."""
    totals: Vector
    """(2, 3, 8) right-hand side by scaled entries, second derivative by them and the duration."""
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


def room(n: int) -> Work:
    """For a line of ``n`` segments."""
    sizes = (
        (
            (9, 3),
            (20, SAMPLES),
            (n + 1, ROWS, SAMPLES),
            (ROWS, SAMPLES),
            (ROWS, SAMPLES),
            (2, SAMPLES),
            (ROWS, ROWS, SAMPLES),
            (n + 1, KINDS, 6, SAMPLES),
        )
        + ((3, 3, ENTRIES * ENTRIES), (2, 3, ENTRIES))
        + ((n + 1, KNOT, KNOT), (n, KNOT, KNOT)) * 2
        + ((n + 1, KNOT),) * 3
    )
    inactive = (-1.0, -1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    arrays = [np.zeros(size) for size in sizes] + [np.full((n + 1, PLACES), value) for value in inactive]
    return Work._make(arrays)
