"""Reading a marker's code from the brightness of its cells.

Small and blurred markers have no cleanly black and white pixels left, but their cells still go up and down
with the code: a quad is read by the correlation of its cells with each code in each of its four rotations.
"""

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.perception.edges import Image, sample

PROBES = 3
"""Samples along each side of a cell."""
SPREAD = 0.5
"""Part of a cell's side that the samples cover."""


@kernel
def read_cells(image: Image, quads: Vector, modules: int) -> Vector:
    """Brightness (m, modules, modules) of the cells of ``quads`` (m, 4, 2); zero for one partly outside.

    The map from the square to each quad is that of P. Heckbert, "Fundamentals of Texture Mapping and Image
    Warping" (1989).
    """
    cells = np.zeros((quads.shape[0], modules, modules))
    for m in range(quads.shape[0]):
        a, b, c, d = quads[m, 0], quads[m, 1], quads[m, 2], quads[m, 3]
        across, down, skew = b - c, d - c, a - b + c - d
        area = across[0] * down[1] - down[0] * across[1]
        if abs(area) < 1.0:
            continue
        g = (skew[0] * down[1] - down[0] * skew[1]) / area
        h = (across[0] * skew[1] - skew[0] * across[1]) / area
        for row in range(modules):
            for column in range(modules):
                total = 0.0
                for k in range(PROBES * PROBES):
                    u = (column + 0.5 + SPREAD * ((k % PROBES + 0.5) / PROBES - 0.5)) / modules
                    v = (row + 0.5 + SPREAD * ((k // PROBES + 0.5) / PROBES - 0.5)) / modules
                    w = 1.0 + g * u + h * v
                    x = (a[0] + (b[0] * (1.0 + g) - a[0]) * u + (d[0] * (1.0 + h) - a[0]) * v) / w
                    y = (a[1] + (b[1] * (1.0 + g) - a[1]) * u + (d[1] * (1.0 + h) - a[1]) * v) / w
                    total += sample(image, x, y)
                cells[m, row, column] = total / (PROBES * PROBES)
        if np.isnan(cells[m]).any():
            cells[m] = 0.0
    return cells


def code_templates(codes: NDArray[np.uint8]) -> Vector:
    """(k · 4, cells) zero-mean unit vectors of ``codes`` (k, n, n), 1 for white, with the black border.

    Row 4 i + r is code i as a quad shows it whose first corner is the marker's corner r.
    """
    bordered = np.pad(codes.astype(float), ((0, 0), (1, 1), (1, 1)))
    turned = np.stack([np.rot90(bordered, r, axes=(1, 2)) for r in range(4)], axis=1)
    return _normalised(turned.reshape(4 * len(codes), -1))


def correlate(cells: Vector, templates: Vector) -> Vector:
    """(m, k) correlation, −1..1, of ``cells`` (m, n, n) with ``templates`` (k, n·n)."""
    scores: Vector = _normalised(cells.reshape(len(cells), templates.shape[1])) @ templates.T
    return scores


def _normalised(vectors: Vector) -> Vector:
    centred = vectors - vectors.mean(axis=1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    unit: Vector = centred / np.maximum(length, 1e-9)
    return unit
