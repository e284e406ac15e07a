"""What is dark in an image: darker than its surroundings.

The threshold is the mean of a square about each pixel (D. Bradley and G. Roth, "Adaptive Thresholding Using the
Integral Image", 2007), which changes so little from pixel to pixel that means of the image at half the size do.
"""

import numpy as np
from numpy.typing import NDArray

from flightapp.jit import kernel
from flightapp.perception.boxes import Boxes
from flightapp.perception.edges import Image

NEAR, WIDE = 2, 4
"""Pixels of half the image's size from the middle of the squares to their sides: the narrow one for sharp and small
markers, the wide one for blurred and large ones."""

Bytes = NDArray[np.uint8]


@kernel
def halved(image: Image, x0: int, y0: int, x1: int, y1: int) -> Bytes:
    """The part from (x0, y0) to before (x1, y1) of ``image`` (h, w) at half its size."""
    half = np.empty((y1 - y0, x1 - x0), np.uint8)
    for y in range(y1 - y0):
        above, below = image[2 * (y0 + y), 2 * x0 :], image[2 * (y0 + y) + 1, 2 * x0 :]
        row = half[y]
        for x in range(row.size):
            row[x] = (above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1] + 2) >> 2
    return half


@kernel
def means_of(image: Image, reach: int) -> Bytes:
    """(h, w) means of the squares about the pixels of ``image`` (h, w), ``reach`` px from the middle to the sides.

    Beyond its border it goes on as it is there.
    """
    height, width = image.shape
    side = 2 * reach + 1
    # So many 2⁻²⁰ are a pixel's share; exact for what sums there are.
    share = np.uint32((1 << 20) // (side * side) + 1)
    means, columns = np.empty_like(image), np.zeros(width + side, np.uint16)
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
    return means


@kernel
def marked_dark(image: Image, box: Boxes, scale: int, offset: int) -> Bytes:
    """(h + 2, w + 2) 1 where ``image`` is darker by ``offset`` than about there, with a rim of 0.

    It is the part in ``box`` (4,), whose first row and column are even ones, at half the size with ``scale`` 2.
    """
    reach, width, height = WIDE if scale == 2 else NEAR, image.shape[1] // 2, image.shape[0] // 2
    x0, y0, x1, y1 = box[0] // 2, box[1] // 2, min((box[2] + 1) // 2, width), min((box[3] + 1) // 2, height)
    left, top = max(x0 - reach, 0), max(y0 - reach, 0)
    half = halved(image, left, top, min(x1 + reach, width), min(y1 + reach, height))
    means = means_of(half, reach)[y0 - top : y1 - top, x0 - left : x1 - left]
    if scale == 2:
        return _below(half[y0 - top : y1 - top, x0 - left : x1 - left], means, 1, offset)
    return _below(image[2 * y0 : box[3], 2 * x0 : box[2]], means, 2, offset)


@kernel
def _below(image: Image, means: Image, size: int, offset: int) -> Bytes:
    """(h + 2, w + 2) 1 where ``image`` (h, w) is by ``offset`` below ``means``, of one for ``size`` by ``size`` pixels.

    The rim is 0. Pixels in the last row and column may be without a mean and have that of those before them.
    """
    height, width = image.shape
    dark, limit = np.zeros((height + 2, width + 2), np.uint8), np.empty(size * means.shape[1] + 1, np.int16)
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
    return dark
