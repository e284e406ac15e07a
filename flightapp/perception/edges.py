"""Sub-pixel corners of a marker by fitting curves to its edges.

Each side is crossed by scan lines; on each the edge lies at the centroid of the brightness's rise from the
black square to the white paper around it, which under motion blur is the edge at the middle of the exposure.
Through these points goes a parabola by least squares, whose bend, which lenses make and which grows with the square
of a side's length, is expected to be small. Corners are where the tangents of neighbouring sides meet. All pixels of
the sides contribute, so this is more accurate than looking at the corners alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import inlined, kernel, lean_kernel

Image = NDArray[np.uint8]

SHORTEST_SCAN, LONGEST_SCAN = 1.5, 5.0
"""px to either side of the edge; the longer one finds all of an edge that is blurred over 8 px."""
BORDER_SCAN = 1.0
"""px to either side, where a longer scan would leave the image."""
ROUGHLY = 0.02
"""Of a side, by which corners of large quads are off before they are refined, beyond that."""
FIRST_SCANS = 6
"""Along a side, to come near and to see how wide the edge is."""
SCANS, SCAN_SPACING = (12, 40), 1.5
"""The fewest and the most along a side, to fit, and how far apart (px) otherwise."""
SCAN_WIDTHS = 2.0
"""Of the edge (standard deviations), and a pixel: the second scans' reach, so that no more noise is summed than need
be."""
LONG_SIDE, END = 90.0, 60.0
"""px, beyond which each end of a side is fitted by itself, and how much of it."""
END_SCANS = 40
LEAST_RISE = 8.0
"""Grey levels over a scan, below which it says nothing of the edge."""
LEAST_SCANS = 4
FINE = 20
"""Bits of a pixel's parts in scans."""
CORNER_SHARE = 0.1
"""Fraction of a side next to each corner that isn't scanned: blur rounds it off."""
BEND = 3e-4
"""px of a side's sagitta over its squared length, standard deviation: a camera with strong distortion."""
SCAN_NOISE = 0.2
"""px, standard deviation of the edge on a scan."""
ROUGH, ROUGH_SHARE = 0.15, 0.1
"""px, and share of a module: RMS by which the edge may lie off the curve; markers are of straight cuts, other dark
shapes of as many cells are not."""


@inlined
def within(image: Image, x: float, y: float) -> bool:
    """Whether a point lies between pixel centres."""
    return bool(0.0 <= x < image.shape[1] - 1.0 and 0.0 <= y < image.shape[0] - 1.0)


@inlined
def sample(image: Image, x: float, y: float) -> float:
    """Brightness at a point `within` the image; memory beyond it is read at any other."""
    i, j = np.uint64(y), np.uint64(x)
    fy, fx = y - np.int64(i), x - np.int64(j)
    # Unsigned, so that no index is taken as counted from the end.
    down, right = i + np.uint64(1), j + np.uint64(1)
    top = image[i, j] + fx * (float(image[i, right]) - float(image[i, j]))
    bottom = image[down, j] + fx * (float(image[down, right]) - float(image[down, j]))
    value: float = top + fy * (bottom - top)
    return value


@lean_kernel
def quad_area(quad: Vector) -> float:
    """px², of a quad (4, 2) that goes clockwise in the image."""
    a, b, c, d = quad[0], quad[1], quad[2], quad[3]
    area: float = 0.5 * ((c[0] - a[0]) * (d[1] - b[1]) - (d[0] - b[0]) * (c[1] - a[1]))
    return area


@inlined
def _fine_sample(image: Image, x: int, y: int) -> int:
    """`sample` in whole numbers: 2⁴⁰ of its grey level at 2²⁰ of its ``x`` and ``y``."""
    i, j = np.uint64(y >> FINE), np.uint64(x >> FINE)
    fy, fx = y & (1 << FINE) - 1, x & (1 << FINE) - 1
    down, right = i + np.uint64(1), j + np.uint64(1)
    top = (np.int64(image[i, j]) << FINE) + fx * (np.int64(image[i, right]) - np.int64(image[i, j]))
    bottom = (np.int64(image[down, j]) << FINE) + fx * (np.int64(image[down, right]) - np.int64(image[down, j]))
    return int((top << FINE) + fy * (bottom - top))


@inlined
def _edge(image: Image, x: float, y: float, nx: float, ny: float, reach: float) -> tuple[float, float]:
    """Distance along the outward normal from (x, y) to the edge, NaN where there is none, and the square of its width.

    That is the variance of the brightness's rise.
    """
    if not (within(image, x - reach * nx, y - reach * ny) and within(image, x + reach * nx, y + reach * ny)):
        reach = BORDER_SCAN
        if not (within(image, x - reach * nx, y - reach * ny) and within(image, x + reach * nx, y + reach * ny)):
            return math.nan, 0.0
    count = int(2.0 * reach) + 2
    # Whole numbers take a third of the time; steps are rounded towards 0, so that none leaves the image.
    unit = float(1 << FINE)
    at_x, at_y = int(unit * (x - reach * nx)), int(unit * (y - reach * ny))
    step_x = int((int(unit * (x + reach * nx)) - at_x) / count)
    step_y = int((int(unit * (y + reach * ny)) - at_y) / count)
    rise, moment, second = 0, 0, 0
    previous = _fine_sample(image, at_x, at_y)
    for k in range(1, count + 1):
        at_x, at_y = at_x + step_x, at_y + step_y
        value = _fine_sample(image, at_x, at_y)
        more = max(value - previous, 0)
        rise, moment, second = rise + more, moment + more * k, second + more * k * k
        previous = value
    if rise < LEAST_RISE * unit * unit:
        return math.nan, 0.0
    middle, spacing = moment / rise, 2.0 * reach / count
    return (middle - 0.5) * spacing - reach, (second / rise - middle * middle) * spacing * spacing


@lean_kernel
def _fit_side(
    image: Image, a: Vector, b: Vector, bend: float, reach: float, scans: int, least: int, lines: Vector
) -> tuple[float, float, float]:
    """Fit the edge near the side from ``a`` to ``b``, bent by ``bend``; its tangents there into ``lines`` (2, 3).

    At ``least`` so many of the ``scans`` must see it. The tangents are n·x = c with n pointing outward. RMS (px) by
    which the edge lies off the fit, NaN where there is none, the edge's width (px, standard deviation) and its bend
    (px; a quarter of it is the sagitta, inward).
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.sqrt(dx * dx + dy * dy)
    if length < 4.0:
        return math.nan, 0.0, 0.0
    nx, ny = dy / length, -dx / length
    # Normal equations of an offset c0 + c1 t + c2 (t² - 1/4), t from -1/2 to 1/2 along the side; -4 c2 is its sagitta.
    n, s1, s2, s3, s4, r0, r1, r2, squares = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    width2 = 0.0
    for k in range(scans):
        t = (1.0 - 2.0 * CORNER_SHARE) * ((k + 0.5) / scans - 0.5)
        q = t * t - 0.25
        px, py = a[0] + (t + 0.5) * dx + bend * q * nx, a[1] + (t + 0.5) * dy + bend * q * ny
        offset, wide2 = _edge(image, px, py, nx, ny, reach)
        if math.isnan(offset):
            continue
        offset += bend * q
        n += 1
        s1, s2, s3, s4 = s1 + t, s2 + q, s3 + t * q, s4 + q * q
        r0, r1, r2, squares = r0 + offset, r1 + offset * t, r2 + offset * q, squares + offset * offset
        width2 += wide2
    if n < least:
        return math.nan, 0.0, 0.0
    t2 = s2 + 0.25 * n
    s4 += (SCAN_NOISE / (4.0 * BEND * length * length)) ** 2
    # Without the constant, then without the slope.
    a11, a12, a22 = t2 - s1 * s1 / n, s3 - s1 * s2 / n, s4 - s2 * s2 / n
    b1, b2 = r1 - s1 * r0 / n, r2 - s2 * r0 / n
    if a11 < 1e-6:
        return math.nan, 0.0, 0.0
    c2 = (b2 - a12 * b1 / a11) / (a22 - a12 * a12 / a11)
    c1 = (b1 - a12 * c2) / a11
    c0 = (r0 - c1 * s1 - c2 * s2) / n
    for end in range(2):
        t = end - 0.5
        slope = (c1 + 2.0 * c2 * t) / length
        offset = c0 + c1 * t
        px, py = a[0] + end * dx + offset * nx, a[1] + end * dy + offset * ny
        lines[end, 0], lines[end, 1] = nx - slope * dx / length, ny - slope * dy / length
        lines[end, 2] = lines[end, 0] * px + lines[end, 1] * py
    off = math.sqrt(max(squares - c0 * r0 - c1 * r1 - c2 * r2, 0.0) / n)
    return off if abs(c1) < 0.4 * length else math.nan, math.sqrt(max(width2 / n, 0.0)), c2


@kernel
def _fit_ends(image: Image, a: Vector, b: Vector, bend: float, reach: float, lines: Vector) -> None:
    """Fit anew the tangents ``lines`` (2, 3) at the ends of a long side, each to the part of the side next to it.

    No parabola follows all of a long side through a lens of strong distortion.
    """
    dx, dy, near, far = b[0] - a[0], b[1] - a[1], np.empty(2), np.empty((2, 3))
    length = math.sqrt(dx * dx + dy * dy)
    share = END / length
    for end in range(2):
        t = share - 0.5 if end == 0 else 0.5 - share
        lift = bend * (t * t - 0.25) / length
        near[0], near[1] = a[0] + (t + 0.5) * dx + lift * dy, a[1] + (t + 0.5) * dy - lift * dx
        first, last = (a, near) if end == 0 else (near, b)
        off = _fit_side(image, first, last, bend * share * share, reach, END_SCANS, END_SCANS - 4, far)[0]
        if not math.isnan(off):
            for k in range(3):
                lines[end, k] = far[end, k]


@lean_kernel
def _meet(p: Vector, q: Vector, corner: Vector) -> bool:
    """Put the point where two lines cross into ``corner``."""
    determinant = p[0] * q[1] - p[1] * q[0]
    if abs(determinant) < 0.05:
        return False
    corner[0] = (p[2] * q[1] - p[1] * q[2]) / determinant
    corner[1] = (p[0] * q[2] - p[2] * q[0]) / determinant
    return True


@kernel
def refine_corners(image: Image, corners: Vector, modules: int, refined: Vector) -> float:
    """Put ``corners`` (4, 2) in pixels, refined in ``image`` (h, w), into ``refined`` (4, 2).

    Corners go clockwise in the image; a marker has ``modules`` a side, with the black border. Returns the edges' RMS
    width (px), NaN where there are no edges, or not of straight sides, or corners would move further than a module and
    two pixels.
    """
    quad, lines, widths, bends = corners.copy(), np.empty((4, 2, 3)), np.empty(4), np.zeros(4)
    good, straight = True, True
    for turn in range(2):
        straight = True
        for side in range(4):
            a, b = quad[side], quad[(side + 1) % 4]
            length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)
            # Across the side: of markers seen askew that is less than along it.
            module = quad_area(quad) / (modules * length + 1e-9)
            if turn == 0:
                reach, scans = LONGEST_SCAN + ROUGHLY * length, FIRST_SCANS
            else:
                reach = min(max(SHORTEST_SCAN, SCAN_WIDTHS * widths[side] + 1.0), LONGEST_SCAN)
                scans = min(max(int(length / SCAN_SPACING), SCANS[0]), SCANS[1])
            reach, off = min(reach, max(0.9 * module, SHORTEST_SCAN)), math.nan
            if good:
                off, widths[side], bends[side] = _fit_side(
                    image, a, b, bends[side], reach, scans, LEAST_SCANS, lines[side]
                )
            if turn > 0 and length > LONG_SIDE and not math.isnan(off):
                _fit_ends(image, a, b, bends[side], reach, lines[side])
            good, straight = not math.isnan(off), straight and not off > ROUGH + ROUGH_SHARE * module
        for side in range(4):
            good = good and _meet(lines[side - 1, 1], lines[side, 0], quad[side])
    for side in range(4):
        moved = math.sqrt((quad[side, 0] - corners[side, 0]) ** 2 + (quad[side, 1] - corners[side, 1]) ** 2)
        a, b = corners[side], corners[(side + 1) % 4]
        module = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2) / modules
        good = good and moved < module + 2.0
    for side in range(4):
        refined[side, 0], refined[side, 1] = quad[side, 0], quad[side, 1]
    return math.sqrt((widths * widths).mean()) if good and straight else math.nan
