"""Sub-pixel corners of a marker by fitting lines to its edges.

Each side is crossed by scan lines; on each the edge lies at the centroid of the brightness's rise from the
black square to the white paper around it, which under motion blur is the edge at the middle of the exposure.
A line is fitted to these points by total least squares, and corners are where neighbouring lines meet. All
pixels of the sides contribute, so this is more accurate than looking at the corners alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import assign, kernel

Image = NDArray[np.uint8]

PASSES = 2
LONGEST_SCAN = 5.0
"""px to either side of the edge, which finds all of an edge that is blurred over 8 px."""
MOST_SCANS = 20
LEAST_RISE = 12.0
"""Grey levels over a scan, below which it says nothing of the edge."""
LEAST_SCANS = 4
CORNER_SHARE = 0.1
"""Fraction of a side next to each corner that isn't scanned: blur rounds it off."""


@kernel
def sample(image: Image, x: float, y: float) -> float:
    """Brightness at a point between pixel centres; NaN outside the image."""
    i, j = math.floor(y), math.floor(x)
    if i < 0 or j < 0 or i + 1 >= image.shape[0] or j + 1 >= image.shape[1]:
        return math.nan
    fy, fx = y - i, x - j
    top = (1.0 - fx) * image[i, j] + fx * image[i, j + 1]
    bottom = (1.0 - fx) * image[i + 1, j] + fx * image[i + 1, j + 1]
    value: float = (1.0 - fy) * top + fy * bottom
    return value


@kernel
def _edge_offset(image: Image, x: float, y: float, nx: float, ny: float, reach: float) -> float:
    """Distance along the outward normal from (x, y) to the edge; NaN where there is none."""
    count = int(2.0 * reach) + 2
    spacing = 2.0 * reach / count
    rise, moment = 0.0, 0.0
    previous = sample(image, x - reach * nx, y - reach * ny)
    for k in range(1, count + 1):
        s = k * spacing - reach
        value = sample(image, x + s * nx, y + s * ny)
        if value > previous:
            rise += value - previous
            moment += (value - previous) * (s - 0.5 * spacing)
        previous = value
        if math.isnan(value):
            return math.nan
    return moment / rise if rise >= LEAST_RISE else math.nan


@kernel
def _fit_side(image: Image, a: Vector, b: Vector, reach: float, line: Vector) -> bool:
    """Fit ``line`` (3,), n·x = c with unit n pointing outward, to the edge near the side from ``a`` to ``b``."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.sqrt(dx * dx + dy * dy)
    if length < 4.0:
        return False
    nx, ny = dy / length, -dx / length
    scans = min(max(int(length), 8), MOST_SCANS)
    n, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(scans):
        t = CORNER_SHARE + (1.0 - 2.0 * CORNER_SHARE) * (k + 0.5) / scans
        x, y = a[0] + t * dx, a[1] + t * dy
        offset = _edge_offset(image, x, y, nx, ny, reach)
        if math.isnan(offset):
            continue
        x, y = x + offset * nx - a[0], y + offset * ny - a[1]
        n += 1
        sx, sy = sx + x, sy + y
        sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
    if n < LEAST_SCANS:
        return False
    mx, my = sx / n, sy / n
    angle = 0.5 * math.atan2(2.0 * (sxy / n - mx * my), (sxx / n - mx * mx) - (syy / n - my * my))
    line[0], line[1] = math.sin(angle), -math.cos(angle)
    if line[0] * nx + line[1] * ny < 0.0:
        line[0], line[1] = -line[0], -line[1]
    line[2] = line[0] * (mx + a[0]) + line[1] * (my + a[1])
    return bool(line[0] * nx + line[1] * ny > 0.9)


@kernel
def _meet(p: Vector, q: Vector, corner: Vector) -> bool:
    """Put the point where two lines cross into ``corner``."""
    determinant = p[0] * q[1] - p[1] * q[0]
    if abs(determinant) < 0.05:
        return False
    corner[0] = (p[2] * q[1] - p[1] * q[2]) / determinant
    corner[1] = (p[0] * q[2] - p[2] * q[0]) / determinant
    return True


@kernel
def refine_corners(image: Image, corners: Vector, modules: int) -> Vector:
    """Corners (m, 4, 2) in pixels, refined in ``image`` (h, w); ``modules`` a side, with the black border.

    Corners go clockwise in the image, as detectors give them. A marker whose edges can't be fitted, or whose
    corners would move further than a module and two pixels, keeps the corners that it came with.
    """
    refined = corners.copy()
    lines = np.empty((4, 3))
    for m in range(corners.shape[0]):
        quad = corners[m].copy()
        good = True
        for _ in range(PASSES):
            for side in range(4):
                a, b = quad[side], quad[(side + 1) % 4]
                module = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2) / modules
                reach = min(max(0.9 * module, 1.5), LONGEST_SCAN)
                good = good and _fit_side(image, a, b, reach, lines[side])
            for side in range(4):
                good = good and _meet(lines[side - 1], lines[side], quad[side])
            if not good:
                break
        for side in range(4):
            moved = math.sqrt(((quad[side] - corners[m, side]) ** 2).sum())
            module = math.sqrt(((corners[m, side] - corners[m, (side + 1) % 4]) ** 2).sum()) / modules
            good = good and moved < module + 2.0
        if good:
            assign(refined[m].reshape(8), quad.reshape(8))
    return refined
