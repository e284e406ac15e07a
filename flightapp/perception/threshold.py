"""What is dark in an image: darker than its surroundings.

The threshold is the mean of a square about each pixel (D. Bradley and G. Roth, "Adaptive Thresholding Using the
Integral Image", 2007), which changes so little from pixel to pixel that means of the image at half the size do.
"""

import numpy as np
from numpy.typing import NDArray

from flightapp.jit import kernel, lean_kernel
from flightapp.perception.boxes import Boxes
from flightapp.perception.edges import Image

NEAR, WIDE = 2, 4
"""Pixels of half the image's size from the middle of the squares to their sides: the narrow one for sharp and small
markers, the wide one for blurred and large ones."""

Bytes = NDArray[np.uint8]


@lean_kernel
def halve(image: Image, x0: int, y0: int, half: Bytes) -> None:
    """Fill ``half`` (h, w) with what is in ``image`` from pixel (2 ``x0``, 2 ``y0``) on, at half its size."""
    for y in range(half.shape[0]):
        above, below, row = image[2 * (y0 + y), 2 * x0 :], image[2 * (y0 + y) + 1, 2 * x0 :], half[y]
        for x in range(row.size):
            row[x] = (above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1] + 2) >> 2


@lean_kernel
def average(image: Image, reach: int, columns: NDArray[np.uint16], means: Bytes) -> None:
    """Fill ``means`` (h, w) of the squares about the pixels of ``image`` (h, w), ``reach`` px from middle to sides.

    Beyond its border it goes on as it is there. ``columns`` (w + 2 ``reach`` + 1,) are sums to begin with, of 0.
    """
    height, width = image.shape
    side = 2 * reach + 1
    # So many 2⁻²⁰ are a pixel's share; exact for what sums there are.
    share = np.uint32((1 << 20) // (side * side) + 1)
    inner = columns[reach : reach + width]
    for y in range(-reach, height + reach):
        new, old = image[min(max(y, 0), height - 1)], image[min(max(y - side, 0), height - 1)]
        if y <= reach:
            for x in range(width):
                inner[x] += new[x]
        else:
            for x in range(width):
                inner[x] += new[x] - old[x]
        if y < reach:
            continue
        columns[:reach] = inner[0]
        columns[reach + width :] = inner[width - 1]
        total, row = np.uint32(side * side // 2), means[y - reach]
        for x in range(side):
            total += np.uint32(columns[x])
        for x in range(width):
            row[x] = total * share >> np.uint32(20)
            total += np.uint32(columns[x + side]) - np.uint32(columns[x])


@lean_kernel
def _mark(image: Image, means: Image, size: int, offset: int, limit: NDArray[np.int16], dark: Bytes) -> None:
    """Fill ``dark`` (h + 2, w + 2), but for its rim: 1 where ``image`` (h, w) is darker by ``offset`` than ``means``.

    There is a mean for ``size`` by ``size`` pixels; those in the last row and column may be without one and have that
    of those before them. ``limit`` (``size`` times the means in a row, and 1,) becomes the last row's limits.
    """
    height, width = image.shape
    for y in range(height):
        if y % size == 0 and y // size < means.shape[0]:
            mean = means[y // size]
            if size == 1:
                for x in range(mean.size):
                    limit[x] = np.int16(mean[x]) - np.int16(offset)
            else:
                for x in range(mean.size):
                    limit[2 * x] = limit[2 * x + 1] = np.int16(mean[x]) - np.int16(offset)
            limit[-1] = limit[-2]
        row, out = image[y], dark[y + 1, 1 : width + 1]
        for x in range(width):
            out[x] = row[x] < limit[x]


@kernel
def marked_dark(image: Image, box: Boxes, scale: int, offset: int) -> Bytes:
    """(h + 2, w + 2) 1 where ``image`` is darker by ``offset`` than about there, with a rim of 0.

    It is the part in ``box`` (4,), whose first row and column are even ones, at half the size with ``scale`` 2.
    """
    reach, width, height = WIDE if scale == 2 else NEAR, image.shape[1] // 2, image.shape[0] // 2
    x0, y0, x1, y1 = box[0] // 2, box[1] // 2, min((box[2] + 1) // 2, width), min((box[3] + 1) // 2, height)
    left, top = max(x0 - reach, 0), max(y0 - reach, 0)
    half = np.empty((min(y1 + reach, height) - top, min(x1 + reach, width) - left), np.uint8)
    means, columns = np.empty_like(half), np.zeros(half.shape[1] + 2 * reach + 1, np.uint16)
    halve(image, left, top, half)
    average(half, reach, columns, means)
    size = 2 // scale
    part = half[y0 - top : y1 - top, x0 - left : x1 - left] if scale == 2 else image[2 * y0 : box[3], 2 * x0 : box[2]]
    dark = np.zeros((part.shape[0] + 2, part.shape[1] + 2), np.uint8)
    limit = np.empty(size * (x1 - x0) + 1, np.int16)
    _mark(part, means[y0 - top : y1 - top, x0 - left : x1 - left], size, offset, limit, dark)
    return dark
