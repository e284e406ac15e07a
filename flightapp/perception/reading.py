"""Markers in the boxes of an image: the whole search in compiled code."""

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.perception.decoding import PROBES, has_border, read_cells, recognise
from flightapp.perception.edges import Image, refine_corners
from flightapp.perception.quads import MOST_QUADS, find_quads
from flightapp.perception.threshold import means_of

CODE, FIT, WORST, LEAD, CORNERS = 0, 1, 2, 3, 4
"""Columns of a reading; see `recognise`."""
READING = 12


def read_markers(
    image: Image, boxes: NDArray[np.int64], offsets: NDArray[np.int64], templates: Vector, codes: Vector
) -> Vector:
    """What may be markers in ``boxes`` (b, 4) x0, y0, x1, y1 of ``image`` (h, w): readings (m, 12).

    ``offsets`` are those of `quads`, ``templates`` and ``codes`` those of `decoding`. A reading ends with the
    corners x, y in pixels, clockwise from the quad's first, not the marker's.
    """
    means = means_of(image)
    return _read(image, means.half, means.near, means.wide, boxes, offsets, templates, codes)


@kernel
def _read(
    image: Image,
    half: Image,
    near: Image,
    wide: Image,
    boxes: NDArray[np.int64],
    offsets: NDArray[np.int64],
    templates: Vector,
    codes: Vector,
) -> Vector:
    quads, modules = np.empty((MOST_QUADS, 4, 2)), codes.shape[1]
    readings = np.empty((MOST_QUADS, READING))
    refined, cells = np.empty((4, 2)), np.empty((modules, modules))
    count = 0
    for m in range(find_quads(image, half, near, wide, boxes, offsets, modules, quads)):
        # A glance spares most of what is no marker the fit.
        if not (read_cells(image, quads[m], 1, cells) and has_border(cells)):
            continue
        if not refine_corners(image, quads[m], modules, refined):
            continue
        if not (read_cells(image, refined, PROBES, cells) and has_border(cells)):
            continue
        recognise(cells, templates, codes, readings[count])
        for k in range(8):
            readings[count, CORNERS + k] = refined[k // 2, k % 2]
        if readings[count, FIT] > 0.0:
            count += 1
    return readings[:count].copy()
