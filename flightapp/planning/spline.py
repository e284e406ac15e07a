"""A plan in the making, and its pieces: the first and last of them are bent to the motion that is asked for there."""

from typing import NamedTuple

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import inlined
from flightapp.planning.hermite import DENSE_PLACES, Order, bend_end, bend_start, segment_ends, segment_polynomial
from flightapp.trajectory import ORDER


class Spline(NamedTuple):
    """A plan in the making, through n + 1 points, and room to work in."""

    points: Vector
    """(n + 1, 3) m."""
    ends: Vector
    """(2, 3, 3) v, a and j at both ends."""
    times: Vector
    """(n,) s."""
    derivatives: Vector
    """(n + 1, 3, 3) v, a and j of each knot, as far as they are free."""
    factors: Vector
    """(n + 1, 3, 3), see `minimum`."""
    couplings: Vector
    """(n + 1, 3, 3), see `minimum`."""
    pulls: Vector
    """(n + 1, 3, 3) gradient by the derivatives."""
    y: Vector
    """(7, 3), see `hermite`."""
    c: Vector
    """(8, 3) coefficients of one segment, in powers of u."""
    g: Vector
    """(8, 3) gradient by them."""
    motion: Vector
    """(3, 3) v, a and j."""
    over: Vector
    """(8 samples,) excesses."""
    maps: Vector
    """(4, 8, 8) coefficients of the parts of the first and last segment from those of the whole."""
    spans: Vector
    """(4,) their shares of its duration."""


def spline(points: Vector, ends: Vector) -> Spline:
    """Room for a plan through ``points`` (n + 1, 3) with ``ends`` (2, 3, 3)."""
    blocks, block, row = (len(points), 3, 3), (3, 3), (ORDER, 3)
    empty = np.empty  # one by one: twice as fast as views of one array
    return Spline(
        points,
        ends,
        empty(len(points) - 1),
        empty(blocks),
        empty(blocks),
        empty(blocks),
        empty(blocks),
        empty(row),
        empty(row),
        empty(row),
        empty(block),
        empty(DENSE_PLACES.size),
        empty((4, ORDER, ORDER)),
        empty(4),
    )


@inlined
def _part(p: int, n: int) -> tuple[int, int]:
    """Of piece ``p`` of n + 2: its segment, and which of the parts of the first and last segment it is, else -1.

    The first and last of the pieces are the bent ones.
    """
    if p <= 1:
        return 0, p
    if p >= n:
        return n - 1, p - n + 2
    return p - 1, -1


@inlined
def divide(s: Spline, first: float, last: float) -> None:
    """Bend the share ``first`` of the first segment and ``last`` of the last one, of at most a half each."""
    n = s.times.size
    for part in range(4):
        begin, end = 0.0, 1.0
        if part == 0:
            end = first
        elif part == 1:
            begin = first
            end = 1.0 - last if n == 1 else 1.0
        elif part == 2:
            end = 1.0 - last
        else:
            begin = 1.0 - last
        s.spans[part] = end - begin
        power = 1.0
        for m in range(ORDER):
            choose = 1.0
            for k in range(ORDER):
                s.maps[part, m, k] = 0.0
                if k >= m:
                    s.maps[part, m, k] = choose * power
                    choose *= begin * (k + 1.0) / (k + 1.0 - m)
            power *= end - begin


@inlined
def piece(order: Order, p: int, s: Spline, y: Vector, c: Vector) -> tuple[int, int, float]:
    """Fill ``y`` (7, 3) of the segment of piece ``p`` and the piece's coefficients ``c`` (8, 3) in powers of u.

    Returns what `_part` does, and the piece's duration.
    """
    i, part = _part(p, s.times.size)
    t = s.times[i]
    segment_ends(order, i, t, s.points, s.derivatives, y)
    segment_polynomial(order, y, c)
    if part >= 0:
        t *= s.spans[part]
        for axis in range(3):
            for m in range(2 * len(order) + 2):
                total = 0.0
                for k in range(m, 2 * len(order) + 2):
                    total += s.maps[part, m, k] * c[k, axis]
                c[m, axis] = total
        if part == 0:
            bend_start(order, t, s.ends[0], c)
        if part == 3:
            bend_end(order, t, s.ends[1], c)
    return i, part, t
