"""Reading a marker's code from the brightness of its cells.

Small and blurred markers have no cleanly black and white pixels left, but their cells still go up and down
with the code: a quad is read by the correlation of its cells with each code in each of its four rotations.
Whether the likeliest code explains the cells is then judged with blur between neighbouring cells allowed for: what
remains unexplained is little and even for a marker, but nearly a cell's whole contrast where one bit differs.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.perception.edges import Image, sample, within

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


@kernel
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


def bordered_codes(codes: NDArray[np.uint8]) -> Vector:
    """(4 k, n + 2, n + 2) cells of ``codes`` (k, n, n), 1 for white, with the black border.

    Row 4 i + r is code i as a quad shows it whose first corner is the marker's corner r.
    """
    bordered = np.pad(codes.astype(float), ((0, 0), (1, 1), (1, 1)))
    turned = np.stack([np.rot90(bordered, r, axes=(1, 2)) for r in range(4)], axis=1)
    return turned.reshape(-1, *bordered.shape[1:])


def code_templates(cells: Vector) -> Vector:
    """(n · n, k) zero-mean unit vectors of ``cells`` (k, n, n)."""
    flat = cells.reshape(len(cells), -1)
    centred = flat - flat.mean(axis=1, keepdims=True)
    return np.ascontiguousarray((centred / np.linalg.norm(centred, axis=1, keepdims=True)).T)


@kernel
def _smear(cells: Vector, code: Vector, parts: Vector, gram: Vector) -> None:
    """Fill ``parts`` (4, n, n) and ``gram`` (4, 4), their products, with what `_explain` fits; all of zero mean.

    They are ``cells``, ``code`` and the means of its neighbours to the left and right, and above and below. The paper
    around the marker is white.
    """
    n = cells.shape[0]
    for i in range(n):
        for j in range(n):
            parts[0, i, j] = cells[i, j]
            parts[1, i, j] = code[i, j]
            parts[2, i, j] = 0.5 * ((code[i, j - 1] if j > 0 else 1.0) + (code[i, j + 1] if j + 1 < n else 1.0))
            parts[3, i, j] = 0.5 * ((code[i - 1, j] if i > 0 else 1.0) + (code[i + 1, j] if i + 1 < n else 1.0))
    for k in range(4):
        parts[k] -= parts[k].mean()
        for m in range(k + 1):
            gram[k, m] = (parts[k] * parts[m]).sum()
            gram[m, k] = gram[k, m]


@kernel
def _explain(cells: Vector, code: Vector) -> tuple[float, float]:
    """How well ``code`` (n, n), smeared along rows and columns, explains ``cells`` (n, n).

    The multiple correlation, and the largest part of the contrast that stays unexplained in a cell. The code and its
    neighbours' means get the weights of least squares that are not negative (coordinate descent).
    """
    parts, gram, weights = np.empty((4, *cells.shape)), np.empty((4, 4)), np.zeros(4)
    _smear(cells, code, parts, gram)
    for _ in range(SWEEPS):
        for k in range(1, 4):
            rest = gram[k, 0] - gram[k, 1] * weights[1] - gram[k, 2] * weights[2] - gram[k, 3] * weights[3]
            weights[k] = max(weights[k] + rest / max(gram[k, k], 1e-9), 0.0)
    contrast = weights.sum()
    if contrast < LEAST_CONTRAST:
        return 0.0, math.inf
    left = parts[0] - weights[1] * parts[1] - weights[2] * parts[2] - weights[3] * parts[3]
    fit = math.sqrt(max(1.0 - (left * left).sum() / gram[0, 0], 0.0))
    return fit, np.abs(left).max() / contrast


@kernel
def recognise(cells: Vector, templates: Vector, codes: Vector, reading: Vector) -> None:
    """What ``cells`` (n, n) show, into ``reading`` (4,): the code's index, its fit, its worst cell and its lead.

    ``codes`` (k, n, n) are `bordered_codes`, ``templates`` theirs. The fit is a multiple correlation, the worst cell
    the part of the contrast that is unexplained there, the lead by how much the fit of the best code of another
    marker is less. A fit of 0 is none.
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
        return
    other = -1
    for k in range(scores.size):
        if k // 4 != best // 4 and (other < 0 or scores[k] > scores[other]):
            other = k
    reading[1], reading[2] = _explain(cells, codes[best])
    reading[3] = reading[1] - (_explain(cells, codes[other])[0] if other >= 0 else 0.0)
