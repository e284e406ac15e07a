"""Corners of small markers from the brightness of all their pixels.

A marker of few pixels a cell has no side by itself: the cells within and what is behind the paper pull at its edges.
But once it is read all of it is known, so its picture, blurred as the edges are, is fitted to the image by least
squares (B. Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision",
1981), with brightness, contrast and blur.
"""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import fused_kernel, inlined, kernel, lean_kernel
from flightapp.linear import factor, substitute
from flightapp.perception.edges import Image

RIM = 0.3
"""Cells around the marker that are fitted, too: of the paper that little is sure to be there."""
STEPS = 2
BLACK, WHITE, BLUR, UNKNOWNS = 8, 9, 10, 11
"""What is fitted, after the corners' x and y."""
LEAST_BLUR, MOST_BLUR = 0.35, 3.0
"""px, standard deviation."""
BLUR_NOISE = 0.1
"""px, by which the blur may differ from the edges' width."""
NOISE = 4.0
"""Grey levels of a pixel that the picture does not explain."""
STRAY = 0.6
"""px, beyond which a corner is not where its sides meet."""
REACH = 2.5
"""Standard deviations of the blur over which `SHARES` and `SLOPES` go."""
KNOTS = 160
_AT = np.linspace(-REACH, REACH, KNOTS + 1)
SHARES = np.array([0.5 * math.erfc(-x / math.sqrt(2.0)) for x in _AT])
SLOPES = np.exp(-0.5 * _AT**2) / math.sqrt(2.0 * math.pi)
"""Of the normal distribution: cumulative, and its density."""


@inlined
def _shares(x: float, sigma: float, parts: Vector) -> tuple[int, int]:
    """At ``x`` in cells, how much of each cell from 0 on a blur of ``sigma`` cells mixes in: first of ``parts`` (3, n).

    The others are its derivatives by x and by the blur. Only the cells from the first to before the second number that
    is returned are filled in, the others are too far away.
    """
    first = max(math.floor(x - REACH * sigma), 0)
    end = min(math.floor(x + REACH * sigma) + 1, parts.shape[1])
    before, steep, wide, narrow = 0.0, 0.0, 0.0, 1.0 / sigma
    for k in range(first, end + 1):
        t, now, density = (x - k) * narrow, 0.0, 0.0
        if t >= REACH:
            now = 1.0
        elif t > -REACH:
            at = (t + REACH) * (KNOTS / (2.0 * REACH))
            i = np.uint64(at)
            f, j = at - np.int64(i), i + np.uint64(1)
            now = SHARES[i] + f * (SHARES[j] - SHARES[i])
            density = (SLOPES[i] + f * (SLOPES[j] - SLOPES[i])) * narrow
        if k > first:
            parts[0, k - 1], parts[1, k - 1], parts[2, k - 1] = before - now, steep - density, t * density - wide
        before, steep, wide = now, density, t * density
    return first, end


@lean_kernel
def _homography(quad: Vector, n: int, H: Vector) -> bool:
    """Fill ``H`` (3, 3), from pixels to cells of the square of ``n`` cells a side whose corners are ``quad`` (4, 2)."""
    x0, y0, x1, y1 = quad[0, 0], quad[0, 1], quad[1, 0], quad[1, 1]
    x2, y2, x3, y3 = quad[2, 0], quad[2, 1], quad[3, 0], quad[3, 1]
    dx1, dx2, dy1, dy2 = x1 - x2, x3 - x2, y1 - y2, y3 - y2
    sx, sy = x0 - x1 + x2 - x3, y0 - y1 + y2 - y3
    area = dx1 * dy2 - dx2 * dy1
    if abs(area) < 1e-6:
        return False
    g, h = (sx * dy2 - dx2 * sy) / area, (dx1 * sy - sx * dy1) / area
    a, b, c = x1 - x0 + g * x1, x3 - x0 + h * x3, x0
    d, e, f = y1 - y0 + g * y1, y3 - y0 + h * y3, y0
    H[0, 0], H[0, 1], H[0, 2] = n * (e - f * h), n * (c * h - b), n * (b * f - c * e)
    H[1, 0], H[1, 1], H[1, 2] = n * (f * g - d), n * (a - c * g), n * (c * d - a * f)
    H[2, 0], H[2, 1], H[2, 2] = d * h - e * g, b * g - a * h, a * e - b * d
    return True


@fused_kernel
def _multiply(rows: Vector, count: int, A: Vector, b: Vector) -> float:
    """Normal equations ``A`` (11, 11), of which the lower half, and ``b`` (11,) of ``count`` pixels.

    ``rows`` (12, k) are their derivatives and what is to be explained, whose sum of squares is returned.
    """
    total = 0.0
    for p in range(UNKNOWNS + 1):
        for q in range(p + 1):
            total = 0.0
            for k in range(count):
                total += rows[p, k] * rows[q, k]
            if p < UNKNOWNS:
                A[p, q] = total
            elif q < UNKNOWNS:
                b[q] = total
    return total


@kernel
def _compare(image: Image, quad: Vector, cells: Vector, levels: Vector, A: Vector, b: Vector) -> float:
    """Mean squared difference (grey levels²) of ``image`` and picture; normal equations ``A`` (11, 11), ``b`` (11,).

    The picture is that of ``cells`` (n, n), 1 for white, in ``quad`` (4, 2); ``levels`` (3,) are black, white and blur
    (px). NaN where it leaves the image.
    """
    n = cells.shape[0]
    H, across, down = np.empty((3, 3)), np.empty((3, n)), np.empty((3, n))
    if not _homography(quad, n, H):
        return math.nan
    ex, ey = 0.5 * (quad[1] + quad[2] - quad[0] - quad[3]) / n, 0.5 * (quad[2] + quad[3] - quad[0] - quad[1]) / n
    wide, high = math.hypot(ex[0], ex[1]), math.hypot(ey[0], ey[1])
    area = ex[0] * ey[1] - ex[1] * ey[0]
    sx, sy, contrast = levels[2] / wide, levels[2] / high, levels[1] - levels[0]
    margin = RIM * max(wide, high)
    left, right = math.ceil(quad[:, 0].min() - margin), int(quad[:, 0].max() + margin)
    top, bottom = math.ceil(quad[:, 1].min() - margin), int(quad[:, 1].max() + margin)
    if left < 0 or top < 0 or right >= image.shape[1] or bottom >= image.shape[0]:
        return math.nan
    # By the pixel's place in the image for a change in cells.
    xx, xy, yx, yy = contrast * ey[1] / area, contrast * ex[1] / area, contrast * ey[0] / area, contrast * ex[0] / area
    rows, count = np.empty((UNKNOWNS + 1, (right - left + 1) * (bottom - top + 1))), 0
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            w = 1.0 / (H[2, 0] * column + H[2, 1] * row + H[2, 2])
            x = (H[0, 0] * column + H[0, 1] * row + H[0, 2]) * w
            y = (H[1, 0] * column + H[1, 1] * row + H[1, 2]) * w
            if not (-RIM <= x <= n + RIM and -RIM <= y <= n + RIM):
                continue
            i0, i1 = _shares(x, sx, across)
            j0, j1 = _shares(y, sy, down)
            black, by_x, by_y, by_blur = 0.0, 0.0, 0.0, 0.0
            for j in range(j0, j1):
                total, slope, widening = 0.0, 0.0, 0.0
                for i in range(i0, i1):
                    ink = 1.0 - cells[j, i]
                    total += ink * across[0, i]
                    slope += ink * across[1, i]
                    widening += ink * across[2, i]
                black += down[0, j] * total
                by_x += down[0, j] * slope
                by_y += down[1, j] * total
                by_blur += down[0, j] * widening / wide + down[2, j] * total / high
            # The corners move the picture, which is the more bright the less black there is.
            gx, gy = by_x * xx - by_y * xy, by_y * yy - by_x * yx
            s, t = x / n, y / n
            for k, share in enumerate(((1.0 - s) * (1.0 - t), s * (1.0 - t), s * t, (1.0 - s) * t)):
                rows[2 * k, count], rows[2 * k + 1, count] = gx * share, gy * share
            rows[BLACK, count], rows[WHITE, count], rows[BLUR, count] = black, 1.0 - black, -contrast * by_blur
            rows[UNKNOWNS, count] = image[row, column] - (levels[1] - contrast * black)
            count += 1
    return _multiply(rows, count, A, b) / count if count > 2 * UNKNOWNS else math.nan


@kernel
def fit_picture(
    image: Image, corners: Vector, cells: Vector, black: float, white: float, blur: float, fitted: Vector
) -> bool:
    """Put the ``corners`` (4, 2) in pixels, clockwise, of a marker of ``cells`` (n, n) into ``fitted`` (4, 2), refined.

    ``black`` and ``white`` (grey levels) are about those of its cells, ``blur`` the edges' width (px, standard
    deviation). False where the first step does not make the picture more like the image, or a corner moves further than
    `STRAY`: ``fitted`` is then ``corners``.
    """
    quad, A, b = corners.copy(), np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS)
    expected = min(max(blur, LEAST_BLUR), MOST_BLUR)
    levels = np.array((black, white, expected))
    for k in range(8):
        fitted[k // 2, k % 2] = corners[k // 2, k % 2]
    first = math.inf
    for _ in range(STEPS):
        off = _compare(image, quad, cells, levels, A, b)
        if not off <= first:
            return False
        first = off
        A[BLUR, BLUR] += (NOISE / BLUR_NOISE) ** 2
        b[BLUR] += (NOISE / BLUR_NOISE) ** 2 * (expected - levels[2])
        if not factor(A):
            return False
        substitute(A, b)
        for k in range(8):
            quad[k // 2, k % 2] += b[k]
        levels[0], levels[1] = levels[0] + b[BLACK], levels[1] + b[WHITE]
        levels[2] = min(max(levels[2] + b[BLUR], LEAST_BLUR), MOST_BLUR)
    for k in range(8):
        if not abs(quad[k // 2, k % 2] - corners[k // 2, k % 2]) < STRAY:
            return False
    for k in range(8):
        fitted[k // 2, k % 2] = quad[k // 2, k % 2]
    return True
