"""Dark quads in grey images: what may be markers.

The quad of locally largest area is put into the outline of each dark component. It is a candidate where outline runs
along most of each of its sides: gaps in an outline and bites out of it, as blur and shadows make them, do no
harm.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel, lean_kernel
from flightapp.perception.boxes import Boxes
from flightapp.perception.edges import Image, quad_area, sample, within
from flightapp.perception.outlines import STEPS, VISITED, Points, follow, hull_of, left_edges, mark_vertices, unpack
from flightapp.perception.threshold import Bytes, marked_dark

MOST_QUADS = 512
"""Candidates in one search, beyond which an image is nothing but clutter."""
SHORTEST_OUTLINE = 28
"""Cracks: those of a square of 7 px, which at half the size is one of 14."""
SHORTEST_SIDE = 6.0
LONGEST_OUTLINE = 6
"""Outlines so many times as long as the box about them are no square's, not even with gaps."""
SMALLEST_AREA = 80
"""px², twice the area inside an outline."""
LEAST_FILL = 0.3
"""Of the box about an outline's area, unless the outline goes in through a gap and around twice."""
LEAST_GAP = 3.0
"""Length of such an outline over the sum of the box's sides."""
BINS = 8
"""Parts of each side in which outline is looked for."""
LEAST_BINS = 5
BEND = 0.05
"""Share of a quad's mean side by which outline may lie off a side, beyond a pixel."""
LEAST_SINE = 0.25
"""Of a corner's angle."""
LEAST_CONTRAST = 8.0
"""Grey levels between the two sides of a quad's edge."""
POINTS = 256
"""Of an outline, that are looked at."""

WHOLE = np.array((7, 4))
"""Grey levels by which dark pixels are darker than the means about them, in an image and at half its size: with these
markers of 15 to 200 px are found in whole images."""
REGION = np.array((5, 4))
"""With these fainter ones too, for where there is little to search."""


@lean_kernel
def _farthest(hull: Points, count: int, a: int, b: int) -> int:
    """The corner furthest to the left of the line from corner ``a`` to ``b``, as seen in the image."""
    ax, ay = hull[a, 0], hull[a, 1]
    dx, dy = hull[b, 0] - ax, hull[b, 1] - ay
    best, most = a, 0
    for i in range(count):
        off = (hull[i, 0] - ax) * dy - (hull[i, 1] - ay) * dx
        if off > most:
            best, most = i, off
    return best


@lean_kernel
def _from(hull: Points, count: int, x2: int, y2: int) -> int:
    """The corner furthest from the point (``x2`` / 2, ``y2`` / 2)."""
    best, most = 0, -1
    for i in range(count):
        off = (2 * hull[i, 0] - x2) ** 2 + (2 * hull[i, 1] - y2) ** 2
        if off > most:
            best, most = i, off
    return best


@lean_kernel
def _inscribe(hull: Points, count: int, box: NDArray[np.int64], quad: Vector) -> bool:
    """Put the corners of a quad of locally largest area in the ``hull`` into ``quad`` (4, 2), clockwise.

    The hull is of ``count`` corners, with the ``box`` (4,) about it.
    """
    a = _from(hull, count, box[0] + box[2], box[1] + box[3])
    c = _from(hull, count, 2 * hull[a, 0], 2 * hull[a, 1])
    b, d = _farthest(hull, count, a, c), _farthest(hull, count, c, a)
    for _ in range(2):
        a, c = _farthest(hull, count, d, b), _farthest(hull, count, b, d)
        b, d = _farthest(hull, count, a, c), _farthest(hull, count, c, a)
    for k, i in enumerate((a, b, c, d)):
        quad[k, 0], quad[k, 1] = hull[i, 0], hull[i, 1]
    for k in range(4):
        ux, uy = quad[k, 0] - quad[k - 1, 0], quad[k, 1] - quad[k - 1, 1]
        vx, vy = quad[(k + 1) % 4, 0] - quad[k, 0], quad[(k + 1) % 4, 1] - quad[k, 1]
        u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(vx * vx + vy * vy)
        if u < SHORTEST_SIDE or ux * vy - uy * vx < LEAST_SINE * u * v:
            return False
    return True


@lean_kernel
def _outlined(points: Points, count: int, step: int, quad: Vector) -> bool:
    """Whether outline runs along most of each side of ``quad`` (4, 2)."""
    perimeter = 0.0
    for k in range(4):
        a, b = quad[k], quad[(k + 1) % 4]
        perimeter += math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)
    slack = 1.0 + BEND * 0.25 * perimeter
    for k in range(4):
        ax, ay = quad[k, 0], quad[k, 1]
        dx, dy = quad[(k + 1) % 4, 0] - ax, quad[(k + 1) % 4, 1] - ay
        length2 = dx * dx + dy * dy
        reach, bins = slack * math.sqrt(length2), BINS / length2
        seen = 0
        for i in range(0, count, step):
            px, py = points[i, 0] - ax, points[i, 1] - ay
            part = (px * dx + py * dy) * bins
            if abs(px * dy - py * dx) < reach and 0.0 <= part < BINS:
                seen |= 1 << int(part)
        covered = 0
        for part in range(BINS):
            covered += seen >> part & 1
        if covered < LEAST_BINS:
            return False
    return True


@lean_kernel
def _contrasts(image: Image, quad: Vector, modules: int) -> bool:
    """Whether ``image`` is brighter outside each side of ``quad`` (4, 2) than inside."""
    for k in range(4):
        ax, ay = quad[k, 0], quad[k, 1]
        dx, dy = quad[(k + 1) % 4, 0] - ax, quad[(k + 1) % 4, 1] - ay
        length = math.sqrt(dx * dx + dy * dy)
        off = max(0.4 * quad_area(quad) / (length * modules), 1.0)
        nx, ny = off * dy / length, -off * dx / length
        total, n = 0.0, 0
        for i in range(6):
            x, y = ax + dx * (i + 1.0) / 7.0, ay + dy * (i + 1.0) / 7.0
            if within(image, x + nx, y + ny) and within(image, x - nx, y - ny):
                total += sample(image, x + nx, y + ny) - sample(image, x - nx, y - ny)
                n += 1
        if n > 0 and total < n * LEAST_CONTRAST:
            return False
    return True


@lean_kernel
def _is_new(quads: Vector, count: int) -> bool:
    """Whether quad ``count`` of ``quads`` (k, 4, 2) lies elsewhere than those before it."""
    quad = quads[count]
    side2 = (quad[0, 0] - quad[1, 0]) ** 2 + (quad[0, 1] - quad[1, 1]) ** 2
    near = max(0.003 * side2, 1.0)
    for m in range(count):
        for turn in range(4):
            apart = 0.0
            for k in range(4):
                other = quads[m, (k + turn) % 4]
                apart = max(apart, (other[0] - quad[k, 0]) ** 2 + (other[1] - quad[k, 1]) ** 2)
            if apart < near:
                return False
    return True


@kernel
def _add(image: Image, dark: Bytes, scale: int, x0: int, y0: int, modules: int, quads: Vector, count: int) -> int:
    """Add the quads of ``dark``, which is ``image`` from (x0, y0) on made smaller by ``scale``; how many there are."""
    height, width = dark.shape
    vertices, box, steps = np.zeros_like(dark), np.empty(4, np.int64), np.empty(128, np.int64)
    mark_vertices(dark, vertices)
    for k in range(128):
        steps[k] = STEPS[k] if abs(STEPS[k]) == 1 else width * (STEPS[k] // 1000)
    line, edges = np.empty(4 * (height + width), np.int32), np.empty(width, np.int64)
    points, hull = np.empty((line.size, 2), np.int32), np.empty((2 * height, 2), np.int32)
    ends = np.empty((height, 2), np.int32)
    for y in range(2, height):
        row = vertices[y]
        for x in edges[: left_edges(row, edges)]:
            if row[x] & VISITED:
                continue
            length = follow(vertices.ravel(), steps, y * width + x, -width, line)
            if length < SHORTEST_OUTLINE or count >= quads.shape[0]:
                continue
            area2 = unpack(line, length, width, points, box)
            across, down = box[2] - box[0], box[3] - box[1]
            if area2 < SMALLEST_AREA or min(across, down) < SHORTEST_SIDE or length > LONGEST_OUTLINE * (across + down):
                continue
            if area2 < 2.0 * LEAST_FILL * across * down and length < LEAST_GAP * (across + down):
                continue
            quad, step = quads[count], 1 + length // POINTS
            corners = hull_of(points, length, box[1], box[3], ends, hull)
            if not _inscribe(hull, corners, box, quad) or not _outlined(points, length, step, quad):
                continue
            for k in range(4):
                # Vertex (1, 1) is the upper left corner of the first pixel, whose centre is (0, 0).
                quad[k, 0] = x0 + scale * (quad[k, 0] - 1.0) - 0.5
                quad[k, 1] = y0 + scale * (quad[k, 1] - 1.0) - 0.5
            if _contrasts(image, quad, modules) and _is_new(quads, count):
                count += 1
    return count


@kernel
def _blank(dark: Bytes, x0: int, y0: int, quad: Vector) -> None:
    """Blank what lies in ``quad`` (4, 2) of ``dark``, which is an image from (x0, y0) on with a rim of one."""
    top, bottom = quad[:, 1].min(), quad[:, 1].max()
    for y in range(max(math.floor(top) - y0 - 1, 0), min(math.ceil(bottom) - y0 + 2, dark.shape[0] - 2)):
        left, right = math.inf, -math.inf
        for k in range(4):
            ax, ay, bx, by = quad[k, 0], quad[k, 1], quad[(k + 1) % 4, 0], quad[(k + 1) % 4, 1]
            # Where the side meets the row, or the end of it that is nearest.
            low, high = min(ay, by), max(ay, by)
            if y + y0 < low - 1.0 or y + y0 > high + 1.0:
                continue
            t = (min(max(float(y + y0), low), high) - ay) / (by - ay) if high > low else 0.0
            left, right = min(left, ax + t * (bx - ax)), max(right, ax + t * (bx - ax))
        if left > right:
            continue
        for x in range(max(math.floor(left) - x0 - 1, 0), min(math.ceil(right) - x0 + 2, dark.shape[1] - 2)):
            dark[y + 1, x + 1] = 0


@kernel
def find_quads(image: Image, boxes: Boxes, scale: int, offset: int, modules: int, known: Vector, quads: Vector) -> int:
    """Put the dark quads in ``boxes`` (b, 4) of ``image`` (h, w) into ``quads`` (k, 4, 2); how many there are.

    Corners go clockwise, in pixels. ``offset`` is of `WHOLE` or `REGION`, ``modules`` those of a marker along a side.
    Blurred and large quads are found with ``scale`` 2, at half the size; sharp and small ones with 1. The quads
    ``known`` (j, 4, 2) aren't looked into.
    """
    count = 0
    for box in boxes:
        if min(box[2] - box[0], box[3] - box[1]) < SHORTEST_SIDE:
            continue
        dark, x0, y0 = marked_dark(image, box, scale, offset), box[0] // 2 * 2, box[1] // 2 * 2
        if scale == 1:
            for quad in known:
                _blank(dark, x0, y0, quad)
        count = _add(image, dark, scale, x0, y0, modules, quads, count)
    return count
