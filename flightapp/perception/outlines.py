"""Outlines of dark components, along the cracks between pixels.

After A. Rosenfeld and A. Kak, "Digital Picture Processing" (1982). A vertex is told by which of the four pixels about
it are dark: where an outline goes on from there depends on that and on the way it came alone.
"""

import numpy as np
from numpy.typing import NDArray

from flightapp.jit import inlined, lean_kernel
from flightapp.perception.threshold import Bytes

Points = NDArray[np.int32]
"""(k, 2) x, y."""

VISITED = 16
"""Added to a vertex from which an outline has gone up."""


def _turns() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(128,) where to go on and the way there, x + 1000 y, from each vertex reached on each way.

    Ways are right, down, left, up with the dark on the right; a vertex is told by `mark_vertices`. Where the pixel
    ahead on the right is bright the outline turns right, where both are dark left, else it goes straight on.
    """
    # The bits of the pixels ahead on the right and on the left.
    ahead = ((1, 8), (2, 1), (4, 2), (8, 4))
    way = np.empty(128, np.int64)
    for d in range(4):
        for pixels in range(32):
            right, left = (pixels & bit > 0 for bit in ahead[d])
            way[32 * d + pixels] = (d + (3 if right and left else 0 if right else 1)) % 4
    return way, np.array((1, 1000, -1, -1000))[way]


_WAYS, STEPS = _turns()


@lean_kernel
def mark_vertices(dark: Bytes, vertices: Bytes) -> None:
    """Fill ``vertices`` (h, w), of each pixel's upper left one, but for the first row and column, which are 0.

    1, 2, 4 and 8 where the pixels to its lower right, lower left, upper left and upper right are ``dark`` (h, w).
    """
    for y in range(1, dark.shape[0]):
        above, below, row = dark[y - 1], dark[y], vertices[y]
        for x in range(1, row.size):
            row[x] = below[x] | below[x - 1] << 1 | above[x - 1] << 2 | above[x] << 3


@inlined
def left_edges(vertices: Bytes, found: NDArray[np.int64]) -> int:
    """Put those of a row of ``vertices`` (w,) from which outlines go up a left edge into ``found`` (w,); how many.

    Outlines that have gone up there are left out, and single pixels, which most are.
    """
    count = 0
    for x in range(vertices.size - 1):
        # Without a branch, as in `follow`.
        found[count] = x
        count += (vertices[x] & 28 == 8) & ((vertices[x] != 8) | (vertices[x + 1] & 9 != 0))
    return count


@inlined
def follow(vertices: Bytes, steps: NDArray[np.int64], start: int, up: int, line: NDArray[np.int32]) -> int:
    """Follow the outline up from vertex ``start``, ``up`` from one to the next: its length, 0 if it is too long.

    ``vertices`` (height · width,) get `VISITED` added where the outline goes up, so that it is followed once;
    ``steps`` (128,) are `STEPS` in them. Vertices go into ``line`` (k,) as far as there is room.
    """
    room, count, d, at, step = line.size, 0, 3, start, up
    while True:
        if count < room:
            line[count] = at
        count += 1
        # Without a branch: nothing foresees an outline's turns.
        vertices[np.uint64(at)] |= np.uint8((d == 3) << 4)
        at += step
        turn = np.uint64(d << 5 | vertices[np.uint64(at)])
        step, d = steps[turn], _WAYS[turn]
        if at == start and d == 3:
            break
    return count if count <= room else 0


@lean_kernel
def unpack(line: NDArray[np.int32], count: int, width: int, points: Points, box: NDArray[np.int64]) -> int:
    """The vertices of ``line`` as ``points`` (k, 2) x, y, and the ``box`` about them; twice the area inside."""
    before, area2 = line[count - 1], 0
    x, y = before % width, before // width
    box[0], box[1], box[2], box[3] = x, y, x, y
    for i in range(count):
        step, before = line[i] - before, line[i]
        across = step if -1 <= step <= 1 else 0
        area2 -= 2 * across * y
        x, y = x + across, y + (step > 1) - (step < -1)
        points[i, 0], points[i, 1] = x, y
        box[0], box[1], box[2], box[3] = min(box[0], x), min(box[1], y), max(box[2], x), max(box[3], y)
    return area2


@lean_kernel
def hull_of(points: Points, count: int, top: int, bottom: int, ends: Points, hull: Points) -> int:
    """Put the corners of the convex hull of ``points`` (k, 2) into ``hull`` (j, 2), clockwise; how many there are.

    The points are of an outline from row ``top`` to row ``bottom``: its ends in each row are taken in turn (A. Andrew,
    "Another efficient algorithm for convex hulls in two dimensions", 1979), and noted in ``ends`` (rows, 2).
    """
    rows, corners = bottom - top + 1, 0
    for k in range(rows):
        ends[k, 0], ends[k, 1] = np.iinfo(np.int32).max, -1
    for i in range(count):
        x, k = points[i, 0], points[i, 1] - top
        ends[k, 0], ends[k, 1] = min(ends[k, 0], x), max(ends[k, 1], x)
    for n in range(2 * rows):
        k, side = (n, 1) if n < rows else (2 * rows - 1 - n, 0)
        x, y = ends[k, side], top + k
        while corners > 1:
            ax, ay = hull[corners - 2, 0], hull[corners - 2, 1]
            bx, by = hull[corners - 1, 0], hull[corners - 1, 1]
            if (bx - ax) * (y - by) > (by - ay) * (x - bx):
                break
            corners -= 1
        hull[corners, 0], hull[corners, 1] = x, y
        corners += 1
    return corners
