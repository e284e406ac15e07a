"""Markers in the boxes of an image: the whole search in compiled code."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel, lean_kernel
from flightapp.perception.boxes import merged, unfilled
from flightapp.perception.decoding import (
    PROBES,
    bordered_codes,
    code_templates,
    has_border,
    read_cells,
    recognise,
    rim_brightness,
    simple_codes,
)
from flightapp.perception.edges import Image, quad_area, refine_corners
from flightapp.perception.picture import fit_picture
from flightapp.perception.quads import MOST_QUADS, find_quads

CODE, FIT, WORST, DOUBT, RIM, NOISE, CORNERS = 0, 1, 2, 3, 4, 5, 6
"""Columns of a reading: those of `recognise`, then how much brighter the paper is than the border, in parts of the
contrast, the corners' expected noise (px), and the marker's corners x, y in pixels, clockwise from its own first."""
READING = 14

Limits = Vector
"""(4,) the least fit, the most unexplained in a cell, the most doubt, and the least that the paper is brighter."""

SMALL = 3.3
"""px of a cell, below which a marker's sides are not seen by themselves."""
SIMPLE = np.array((0.98, 0.11, 0.0, 0.45))
"""What `simple_codes` must keep to as well."""
SHARP, SHARP_DOUBT = 0.2, 0.05
"""Width of the edges in cells, below which neighbouring cells hardly mix, and the most doubt that is then left."""
GLARE = (0.985, 0.11, -0.1, 0.45)
"""What a reading must keep to that only a light explains which shines upon the marker."""

SHARP_NOISE, SHARP_WIDTH = 0.052, 0.452
"""px, noise of a sharp marker's corners, and the width of its edges."""
BLURRED_NOISE, BLURRED_POWER = 1.83, 2.4
"""Cells that corners are off where blur makes the edges a cell wide, and the power of that width.

Both by maximum likelihood from 5,014 markers in pictures of `evaluation.detection_images`, 12 to 72 px large and
blurred over up to 6 px: in 18 bins of size and width met to factors of 0.67 to 1.31. Of markers of 72 to 120 px near
the border of a pinhole with strong distortion corners are twice as far off."""


@dataclass(frozen=True, slots=True)
class Codes:
    """The codes of a dictionary as the kernels want them."""

    cells: Vector
    """`bordered_codes` (k, n, n)."""
    templates: Vector
    simple: NDArray[np.bool_]

    @staticmethod
    def of(codes: NDArray[np.uint8]) -> "Codes":
        """Those of `marker_codes`."""
        cells = bordered_codes(codes)
        return Codes(cells, code_templates(cells), simple_codes(cells))


def read_markers(
    image: Image, regions: Vector, offsets: NDArray[np.int64], done: float, limits: Limits, codes: Codes
) -> Vector:
    """The markers in ``regions`` (r, 4) x0, y0, x1, y1 of ``image`` (h, w): readings (m, 14) that keep to ``limits``.

    ``offsets`` are `quads.WHOLE` or `quads.REGION`. Regions of which a large marker fills the share ``done`` aren't
    searched for small ones.
    """
    return _read(image, regions, offsets, done, limits, SIMPLE, codes.templates, codes.cells, codes.simple)


@lean_kernel
def _keeps_to(reading: Vector, limits: Limits | tuple[float, float, float, float]) -> bool:
    good = reading[FIT] >= limits[0] and reading[WORST] <= limits[1]
    return bool(good and reading[DOUBT] <= limits[2] and reading[RIM] >= limits[3])


@lean_kernel
def expected_noise(width: float, cell: float) -> float:
    """px, standard deviation of the corners of a marker whose edges are ``width`` wide and cells ``cell``, in px."""
    blur = math.sqrt(max(width * width - SHARP_WIDTH * SHARP_WIDTH, 0.0)) / max(cell, 1e-9)
    return math.hypot(SHARP_NOISE, BLURRED_NOISE * cell * blur**BLURRED_POWER)


@lean_kernel
def _narrow(quad: Vector) -> float:
    """px, width of a ``quad`` (4, 2) across its longest side."""
    longest2 = 1e-9
    for k in range(4):
        dx, dy = quad[(k + 1) % 4, 0] - quad[k, 0], quad[(k + 1) % 4, 1] - quad[k, 1]
        longest2 = max(longest2, dx * dx + dy * dy)
    return quad_area(quad) / math.sqrt(longest2)


@kernel
def _make_out(
    cells: Vector, rim: float, sharp: bool, templates: Vector, codes: Vector, limits: Vector, reading: Vector
) -> float:
    """What ``cells`` (n, n) show, into ``reading`` (14,); the contrast, 0 for nothing that keeps to ``limits``.

    ``rim`` is how many grey levels the paper is brighter than the border; ``sharp`` cells leave hardly any doubt.
    """
    contrast = recognise(cells, templates, codes, False, reading)
    reading[RIM] = rim / max(contrast, 1e-9)
    if _keeps_to(reading, limits) and not (sharp and reading[DOUBT] > SHARP_DOUBT):
        return contrast
    contrast = recognise(cells, templates, codes, True, reading)
    reading[RIM] = rim / max(contrast, 1e-9)
    return contrast if _keeps_to(reading, GLARE) else 0.0


@kernel
def _read_quad(image: Image, quad: Vector, templates: Vector, codes: Vector, limits: Vector, reading: Vector) -> bool:
    """What ``quad`` (4, 2) shows, into ``reading`` (14,). False for nothing that keeps to ``limits``."""
    modules = codes.shape[1]
    refined, cells = np.empty((4, 2)), np.empty((modules, modules))
    # A glance spares most of what is no marker the fit.
    if not (read_cells(image, quad, 1, cells) and has_border(cells)):
        return False
    width = refine_corners(image, quad, modules, refined)
    if math.isnan(width) or not (read_cells(image, refined, PROBES, cells) and has_border(cells)):
        return False
    dark, n = 0.0, modules - 1
    for i in range(n):
        dark += (cells[0, i] + cells[i, n] + cells[n, n - i] + cells[n - i, 0]) / (4 * n)
    rim, cell = rim_brightness(image, refined, modules) - dark, _narrow(refined) / modules
    contrast = _make_out(cells, rim, width < SHARP * cell, templates, codes, limits, reading)
    if not contrast > 0.0:
        return False
    reading[NOISE] = expected_noise(width, cell)
    if quad_area(refined) < (SMALL * modules) ** 2:
        fit_picture(image, refined.copy(), codes[int(reading[CODE])], dark, dark + contrast, width, refined)
    turns = int(reading[CODE])
    for k in range(8):
        reading[CORNERS + (k + 2 * turns) % 8] = refined[k // 2, k % 2]
    return True


@kernel
def _read(
    image: Image,
    regions: Vector,
    offsets: NDArray[np.int64],
    done: float,
    limits: Vector,
    stricter: Vector,
    templates: Vector,
    codes: Vector,
    simple: NDArray[np.bool_],
) -> Vector:
    height, width = image.shape
    quads, readings, found = np.empty((MOST_QUADS, 4, 2)), np.empty((2 * MOST_QUADS, READING)), 0
    known, left = np.empty((0, 4, 2)), regions
    for scale in (2, 1):
        boxes = merged(left, width, height)
        for m in range(find_quads(image, boxes, scale, offsets[scale - 1], codes.shape[1], known, quads)):
            row = readings[found]
            if _read_quad(image, quads[m], templates, codes, limits, row):
                found += int(not simple[int(row[CODE])] or _keeps_to(row, stricter))
        known = readings[:found, CORNERS:].copy().reshape(found, 4, 2)
        left = unfilled(regions, known, done)
    return readings[:found].copy()
