"""What is dark in an image: darker than its surroundings.

The threshold is the mean of a square about each pixel (D. Bradley and G. Roth, "Adaptive Thresholding Using the
Integral Image", 2007), which changes so little from pixel to pixel that means of the image at half the size do.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.jit import kernel
from flightapp.perception.edges import Image

NEAR, WIDE = 5, 9
"""Pixels of half the image's size along a side of the squares: the narrow one for sharp and small markers, the wide
one for blurred and large ones."""

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Means:
    """An image at half its size, and the means about each pixel there."""

    half: Image
    near: Image
    wide: Image


def means_of(image: Image) -> Means:
    """Those of ``image`` (h, w), at least 2 px a side; its last row and column are left out if they are odd."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    half = cv2.resize(image[: 2 * height, : 2 * width], (width, height), None, 0.0, 0.0, cv2.INTER_AREA)
    near, wide = (cv2.boxFilter(half, -1, (n, n), borderType=cv2.BORDER_REPLICATE) for n in (NEAR, WIDE))
    return Means(np.asarray(half, np.uint8), np.asarray(near, np.uint8), np.asarray(wide, np.uint8))


@kernel
def marked_dark(image: Image, mean: Image, offset: int) -> Bytes:
    """(h + 2, w + 2) 1 where ``image`` (h, w) is darker by ``offset`` than ``mean``, with a rim of 0.

    ``mean`` is as large as the image, or has one pixel for two by two of it.
    """
    height, width = image.shape
    scale = 1 if mean.shape[0] == height else 2
    dark = np.zeros((height + 2, width + 2), np.uint8)
    limit = np.empty(width, np.int16)
    for y in range(height):
        if y % scale == 0:
            means = mean[min(y // scale, mean.shape[0] - 1)]
            if scale == 1:
                for x in range(width):
                    limit[x] = np.int16(means[x]) - np.int16(offset)
            else:
                for x in range(means.size):
                    limit[2 * x] = limit[2 * x + 1] = np.int16(means[x]) - np.int16(offset)
                limit[2 * means.size :] = limit[2 * means.size - 1]
        row, out = image[y], dark[y + 1, 1 : width + 1]
        for x in range(width):
            out[x] = row[x] < limit[x]
    return dark
