"""The compiled part of `corridor` that makes one way: searched on a grid, moved clear, and with no needless corners."""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.planning.grid import search
from flightapp.planning.legs import blocked_on, corners, nudged, reaches
from flightapp.planning.obstacles import BALL, CENTRE, MARGIN

CELL = 0.35
"""m between the points of the grid on which ways are searched."""
CELLS = 20_000
"""The most points of a grid; where the room is larger, they are farther apart."""
GRID, NODE, SOLID = 70.0, 0.13, 0.0015
"""Effort to set up a grid, to look at a node, and for each solid that this looks at; one is about 2 µs, as in
`race_solver`."""
PAIR = 0.01
"""Effort to look at one solid for one point of a way from which there might be a straight leg."""


@kernel
def _within(rows: Vector, low: Vector, high: Vector) -> Vector:
    """Those of ``rows`` that matter for ways within ``low`` .. ``high`` (3,) m."""
    out, count = np.empty_like(rows), 0
    for i in range(rows.shape[0]):
        reach, near = rows[i, BALL] + rows[i, MARGIN] + CELL, True
        for j in range(3):
            near = near and low[j] - reach < rows[i, CENTRE + j] < high[j] + reach
        if near:
            for j in range(rows.shape[1]):
                out[count, j] = rows[i, j]
            count += 1
    return out[:count]


@kernel
def _blocked(way: Vector, rows: Vector, reach: Vector) -> NDArray[np.int64]:
    """For each leg of ``way`` (n, 3) that is not clear of ``rows``, the first that it is too close to."""
    out, count = np.empty(way.shape[0], np.int64), 0
    for k in range(way.shape[0] - 1):
        found = blocked_on(way[k], way[k + 1], rows, reach)
        if found >= 0:
            out[count] = found
            count += 1
    return out[:count]


@kernel
def bypass(
    start: Vector,
    goal: Vector,
    rows: Vector,
    low: Vector,
    high: Vector,
    toll: float,
    greed: float,
    moves: Vector,
    effort: float,
) -> tuple[Vector, Vector, float]:
    """A way from ``start`` to ``goal`` (3,) m clear of ``rows``, within ``low`` .. ``high`` (3,) m.

    Returns its corners (n, 3) m, both ends included, and which rows (k, `WIDTH`) it is too close to: it is only good if
    there are none, and there is none if it has no corners. Last, the effort it took, up to about ``effort``. The rest
    is as in `grid.search`.
    """
    room = 1.0
    for j in range(3):
        room *= high[j] - low[j]
    cell = max(CELL, (room / CELLS) ** (1.0 / 3.0))
    near = _within(rows, low, high)
    price = NODE + SOLID * near.shape[0]
    apart = reaches(start, goal, near, math.sqrt(3.0) * cell)
    way, looked = search(start, goal, near, apart, low, high, cell, toll, greed, moves, (effort - GRID) / price)
    reach = reaches(start, goal, near, 0.0)
    nudged(way, near, reach)
    blocked = _blocked(way, near, reach)
    taken = GRID + price * looked + PAIR * way.shape[0] * near.shape[0]
    if blocked.size == 0 and way.shape[0] > 0:
        return way[corners(way, near, reach)], near[blocked], taken
    return way, near[blocked], taken
