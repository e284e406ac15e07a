"""Boxes in images: which to search, so that no pixel is searched twice."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import inlined, kernel

COST_OF_A_BOX = 6000
"""px that could be searched in the time that it takes to begin another box."""

Box = tuple[int, int, int, int]
Boxes = NDArray[np.int64]
"""(b, 4) x0, y0, x1, y1 in whole pixels, from the first to before the last."""


def merge_regions(regions: Sequence[Vector], width: int, height: int) -> list[Box]:
    """The `merged` ones of ``regions``, (4,) each."""
    return [(x0, y0, x1, y1) for x0, y0, x1, y1 in merged(stacked(regions), width, height).tolist()]


def stacked(regions: Sequence[Vector | Box]) -> Vector:
    """(r, 4) of ``regions``, (4,) each."""
    return np.array(regions, float).reshape(-1, 4)


@inlined
def _inside(x: float, length: int) -> float:
    return min(max(x, 0.0), float(length))


@inlined
def _drop(rows: Boxes | Vector, k: int) -> None:
    """Move the rows after row ``k`` of ``rows`` (n, 4) up by one."""
    for m in range(k + 1, rows.shape[0]):
        for i in range(4):
            rows[m - 1, i] = rows[m, i]


@kernel
def merged(regions: Vector, width: int, height: int) -> Boxes:
    """Whole-pixel boxes inside an image that cover ``regions`` (r, 4), with no pixel searched twice.

    Boxes are merged where they overlap, and where one search of both costs less than two. Boxes that are empty,
    outside the image or not finite are left out.
    """
    boxes, count = np.empty(regions.shape, np.int64), 0
    for region in regions:
        if not np.isfinite(region).all():
            continue
        x0, y0 = math.floor(_inside(region[0], width)), math.floor(_inside(region[1], height))
        x1, y1 = math.ceil(_inside(region[2], width)), math.ceil(_inside(region[3], height))
        if x1 <= x0 or y1 <= y0:
            continue
        k = 0
        while k < count:
            a, b, c, d = boxes[k]
            apart = x0 >= c or a >= x1 or y0 >= d or b >= y1
            left, top, right, bottom = min(x0, a), min(y0, b), max(x1, c), max(y1, d)
            both, each = (right - left) * (bottom - top), (x1 - x0) * (y1 - y0) + (c - a) * (d - b)
            if apart and both > each + COST_OF_A_BOX:
                k += 1
                continue
            x0, y0, x1, y1 = left, top, right, bottom
            _drop(boxes[:count], k)
            k, count = 0, count - 1
        boxes[count, 0], boxes[count, 1], boxes[count, 2], boxes[count, 3] = x0, y0, x1, y1
        count += 1
    return boxes[:count].copy()


@kernel
def unfilled(regions: Vector, quads: Vector, least: float) -> Vector:
    """Those of ``regions`` (r, 4) of which none of the markers ``quads`` (m, 4, 2) fills the ``least`` share.

    Each marker fills but one region, that whose middle is nearest.
    """
    left = regions.copy()
    for quad in quads:
        x0, y0, x1, y1 = quad[:, 0].min(), quad[:, 1].min(), quad[:, 0].max(), quad[:, 1].max()
        x, y, area = 0.5 * (x0 + x1), 0.5 * (y0 + y1), (x1 - x0) * (y1 - y0)
        nearest, shortest = -1, math.inf
        for n in range(left.shape[0]):
            a, b, c, d = left[n]
            off = abs(x - 0.5 * (a + c)) + abs(y - 0.5 * (b + d))
            if a <= x <= c and b <= y <= d and off < shortest and area >= least * (c - a) * (d - b):
                nearest, shortest = n, off
        if nearest >= 0:
            _drop(left, nearest)
            left = left[:-1]
    return left
