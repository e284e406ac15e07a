"""Reading a marker's code from the brightness of its cells.

Small and blurred markers have no cleanly black and white pixels left, but their cells still go up and down
with the code: a quad is read by the correlation of its cells with each code in each of its four rotations.
Whether the likeliest code explains the cells is then judged with blur between neighbouring cells allowed for: what
remains unexplained is little and even for a marker, but nearly a cell's whole contrast where one bit differs.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel, lean_kernel
from flightapp.perception.edges import Image, quad_area, sample, within

PROBES = 3
"""Samples along each side of a cell."""
SPREAD = 0.5
"""Part of a cell's side that the samples cover."""
LEAST_CORRELATION = 0.6
"""With the likeliest code, blur not yet allowed for."""
LEAST_CONTRAST = 8.0
"""Grey levels between black and white cells."""
BRIGHT_SHARE = 0.35
"""Of a border's cells that may be bright, where blur takes the outer ones (OpenCV's share)."""
SWEEPS = 24
"""Of coordinate descent, for three weights."""
FEW_EDGES = 12
"""Between black and white cells of a code; markers have 20 at the median, few have less than 14."""
UNEXPLAINED, LEAD = 3.6, 0.62
"""Weights of a doubt beside the likeliest flip's: by logistic regression on 23,000 readings of markers and 100 of codes
that differ from theirs by a cell or two, blurred over up to 6 px."""
RIM, LEAST_RIM = 0.45, 1.0
"""Modules, and at least px, from a marker's edge to where the paper around it is looked at."""


@lean_kernel
def read_cells(image: Image, quad: Vector, probes: int, cells: Vector) -> bool:
    """Brightness of the ``cells`` (n, n) of ``quad`` (4, 2) in ``image`` (h, w); False for one partly outside.

    Each is the mean of ``probes`` squared samples. The map from the square to the quad is that of P. Heckbert,
    "Fundamentals of Texture Mapping and Image Warping" (1989).
    """
    a, b, c, d = quad[0], quad[1], quad[2], quad[3]
    ex, ey, fx, fy = b[0] - c[0], b[1] - c[1], d[0] - c[0], d[1] - c[1]
    sx, sy = a[0] - b[0] + c[0] - d[0], a[1] - b[1] + c[1] - d[1]
    area, modules = ex * fy - ey * fx, cells.shape[0]
    if abs(area) < 1.0:
        return False
    g, h = (sx * fy - sy * fx) / area, (ex * sy - ey * sx) / area
    ux, uy, vx, vy = b[0] * (1.0 + g) - a[0], b[1] * (1.0 + g) - a[1], d[0] * (1.0 + h) - a[0], d[1] * (1.0 + h) - a[1]
    # Where the outermost samples lie in the image, all do.
    edge = 0.5 - 0.5 * SPREAD * (1.0 - 1.0 / probes)
    for k in range(4):
        u, v = (edge + (k & 1) * (modules - 2.0 * edge)) / modules, (edge + (k >> 1) * (modules - 2.0 * edge)) / modules
        w = 1.0 / (1.0 + g * u + h * v)
        if w <= 0.0 or not within(image, (a[0] + ux * u + vx * v) * w, (a[1] + uy * u + vy * v) * w):
            return False
    for row in range(modules):
        for column in range(modules):
            total = 0.0
            for i in range(probes):
                v = (row + 0.5 + SPREAD * ((i + 0.5) / probes - 0.5)) / modules
                for j in range(probes):
                    u = (column + 0.5 + SPREAD * ((j + 0.5) / probes - 0.5)) / modules
                    w = 1.0 / (1.0 + g * u + h * v)
                    total += sample(image, (a[0] + ux * u + vx * v) * w, (a[1] + uy * u + vy * v) * w)
            cells[row, column] = total / (probes * probes)
    return True


@kernel
def has_border(cells: Vector) -> bool:
    """Whether most of the outer ``cells`` (n, n) are as dark as a marker's border among them, and there is contrast."""
    n, low, high, bright = cells.shape[0], cells.min(), cells.max(), 0
    middle = 0.5 * (low + high)
    for i in range(n):
        bright += int(cells[0, i] > middle) + int(cells[n - 1, i] > middle)
        bright += int(cells[i, 0] > middle) + int(cells[i, n - 1] > middle)
    return bool(high - low > LEAST_CONTRAST and bright <= BRIGHT_SHARE * 4 * n)


def marker_codes(dictionary: Any) -> NDArray[np.uint8]:
    """(k, n, n) cells of all markers of OpenCV's ``dictionary``, 1 for white."""
    side = dictionary.markerSize + 2
    pictures = [dictionary.generateImageMarker(marker, side) for marker in range(len(dictionary.bytesList))]
    return np.stack([picture[1:-1, 1:-1] > 127 for picture in pictures]).astype(np.uint8)


def bordered_codes(codes: NDArray[np.uint8]) -> Vector:
    """(4 k, n + 2, n + 2) cells of ``codes`` (k, n, n), 1 for white, with the black border.

    Row 4 i + r is code i as a quad shows it whose first corner is the marker's corner r.
    """
    bordered = np.pad(codes.astype(float), ((0, 0), (1, 1), (1, 1)))
    turned = np.stack([np.rot90(bordered, r, axes=(1, 2)) for r in range(4)], axis=1)
    return turned.reshape(-1, *bordered.shape[1:])


def simple_codes(codes: Vector) -> NDArray[np.bool_]:
    """(k,) which of `bordered_codes` (k, n, n) have few edges inside, as any dark shape with a bright spot has."""
    edges = np.abs(np.diff(codes, axis=1)).sum(axis=(1, 2)) + np.abs(np.diff(codes, axis=2)).sum(axis=(1, 2))
    return np.asarray(edges < FEW_EDGES)


def code_templates(cells: Vector) -> Vector:
    """(n · n, k) zero-mean unit vectors of ``cells`` (k, n, n)."""
    flat = cells.reshape(len(cells), -1)
    centred = flat - flat.mean(axis=1, keepdims=True)
    return np.ascontiguousarray((centred / np.linalg.norm(centred, axis=1, keepdims=True)).T)


@kernel
def _smear(cells: Vector, code: Vector, glare: bool, parts: Vector, gram: Vector) -> None:
    """Fill ``parts`` (4, n, n) and ``gram`` (4, 4), their products, with what `_explain` fits.

    They are ``cells``, ``code`` and the means of its neighbours to the left and right, and above and below, all without
    their means and slopes, as light may fall off across a marker, and with ``glare`` without their bulges, as it may
    shine upon it. The paper around it is white.
    """
    n = cells.shape[0]
    for i in range(n):
        for j in range(n):
            parts[0, i, j] = cells[i, j]
            parts[1, i, j] = code[i, j]
            parts[2, i, j] = 0.5 * ((code[i, j - 1] if j > 0 else 1.0) + (code[i, j + 1] if j + 1 < n else 1.0))
            parts[3, i, j] = 0.5 * ((code[i - 1, j] if i > 0 else 1.0) + (code[i + 1, j] if i + 1 < n else 1.0))
    # A bulge is what (i - middle)² + (j - middle)² is beyond its mean.
    middle, spread = 0.5 * (n - 1), n * n * (n * n - 1) / 12.0
    level, bulging = (n * n - 1) / 6.0, n * n * (n * n - 1) * (n * n - 4) / 90.0
    for k in range(4):
        mean, across, down, bulge = parts[k].mean(), 0.0, 0.0, 0.0
        for i in range(n):
            for j in range(n):
                across += parts[k, i, j] * (j - middle) / spread
                down += parts[k, i, j] * (i - middle) / spread
                if glare:
                    bulge += parts[k, i, j] * ((i - middle) ** 2 + (j - middle) ** 2 - level) / bulging
        for i in range(n):
            for j in range(n):
                round_ = (i - middle) ** 2 + (j - middle) ** 2 - level
                parts[k, i, j] -= mean + across * (j - middle) + down * (i - middle) + bulge * round_
        for m in range(k + 1):
            gram[k, m] = (parts[k] * parts[m]).sum()
            gram[m, k] = gram[k, m]


@kernel
def _explain(cells: Vector, code: Vector, glare: bool, parts: Vector, weights: Vector) -> float:
    """How well ``code`` (n, n), smeared along rows and columns, explains ``cells`` (n, n): the multiple correlation.

    The code and its neighbours' means get the ``weights`` (4,), from the second on, of least squares that are not
    negative (coordinate descent); what they leave unexplained goes into the first of ``parts`` (4, n, n).
    """
    gram = np.empty((4, 4))
    _smear(cells, code, glare, parts, gram)
    weights[:] = 0.0
    for _ in range(SWEEPS):
        for k in range(1, 4):
            rest = gram[k, 0] - gram[k, 1] * weights[1] - gram[k, 2] * weights[2] - gram[k, 3] * weights[3]
            weights[k] = max(weights[k] + rest / max(gram[k, k], 1e-9), 0.0)
    if weights.sum() < LEAST_CONTRAST:
        return 0.0
    squares = 0.0
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            for k in range(1, 4):
                parts[0, i, j] -= weights[k] * parts[k, i, j]
            squares += parts[0, i, j] ** 2
    return math.sqrt(max(1.0 - squares / gram[0, 0], 0.0))


@kernel
def _likeliest_flip(left: Vector, code: Vector, weights: Vector) -> float:
    """Of all cells inside the border, the largest share of its change in which a flip of one is seen in ``left``.

    ``left`` (n, n) is what ``code`` leaves unexplained with `_explain`'s ``weights``. It is 1 where the image shows
    another code, which differs from this in one cell, and about 0 for the right code (a matched filter).
    """
    n, most = code.shape[0], 0.0
    across, down = 0.5 * weights[2], 0.5 * weights[3]
    energy = weights[1] ** 2 + 2.0 * across**2 + 2.0 * down**2 - weights.sum() ** 2 / (n * n)
    for i in range(1, n - 1):
        for j in range(1, n - 1):
            seen = weights[1] * left[i, j] + across * (left[i, j - 1] + left[i, j + 1])
            seen += down * (left[i - 1, j] + left[i + 1, j])
            most = max(most, (1.0 - 2.0 * code[i, j]) * seen)
    share: float = most / energy
    return share


@kernel
def recognise(cells: Vector, templates: Vector, codes: Vector, glare: bool, reading: Vector) -> float:
    """What ``cells`` (n, n) show, into ``reading``: the code's index, its fit, its worst cell and its doubt.

    With ``glare`` a light may shine upon them. ``codes`` (k, n, n) are `bordered_codes`, ``templates`` theirs. The fit
    is a multiple correlation, the worst cell the part of the contrast that is unexplained there. A fit of 0 is none.
    The doubt grows with what is unexplained and with `_likeliest_flip`, and falls with the lead over the fit of the
    best code of another marker. Returns the contrast of black and white.
    """
    scores, mean = np.zeros(templates.shape[1]), cells.mean()
    squares, flat = 0.0, cells.ravel()
    for i in range(flat.size):
        value, row = flat[i] - mean, templates[i]
        squares += value * value
        for k in range(scores.size):
            scores[k] += value * row[k]
    best = int(np.argmax(scores))
    reading[0], reading[1] = best, 0.0
    if scores[best] < LEAST_CORRELATION * math.sqrt(squares):
        return 0.0
    other = -1
    for k in range(scores.size):
        if k // 4 != best // 4 and (other < 0 or scores[k] > scores[other]):
            other = k
    parts, weights = np.empty((4, *cells.shape)), np.zeros(4)
    rival = _explain(cells, codes[other], glare, parts, weights) if other >= 0 else 0.0
    fit = _explain(cells, codes[best], glare, parts, weights)
    contrast: float = weights.sum()
    if fit > 0.0:
        flip = _likeliest_flip(parts[0], codes[best], weights)
        reading[1], reading[2] = fit, np.abs(parts[0]).max() / contrast
        reading[3] = UNEXPLAINED * (1.0 - fit) + flip - LEAD * (fit - rival)
    return contrast


@lean_kernel
def rim_brightness(image: Image, quad: Vector, modules: int) -> float:
    """Grey level of the paper along the darkest side of a marker's ``quad`` (4, 2) of ``modules`` a side, near it."""
    least, area = 255.0, quad_area(quad)
    for k in range(4):
        ax, ay = quad[k, 0], quad[k, 1]
        dx, dy = quad[(k + 1) % 4, 0] - ax, quad[(k + 1) % 4, 1] - ay
        length = math.sqrt(dx * dx + dy * dy) + 1e-9
        off = max(RIM * area / (length * modules), LEAST_RIM)
        nx, ny = off * dy / length, -off * dx / length
        total, n = 0.0, 0
        for i in range(modules):
            x, y = ax + dx * (i + 0.5) / modules + nx, ay + dy * (i + 0.5) / modules + ny
            if within(image, x, y):
                total += sample(image, x, y)
                n += 1
        if n > 0:
            least = min(least, total / n)
    return least
