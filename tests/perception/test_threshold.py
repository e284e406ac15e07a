"""What is dark in a box is what is dark there in the whole image, with OpenCV's means."""

import cv2
import numpy as np
import pytest

from flightapp.perception.threshold import NEAR, WIDE, marked_dark

OFFSET = 6


def darker(image, scale):
    """Of the whole image (h, w), at half the size with ``scale`` 2."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    half = cv2.resize(image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
    side = 2 * (WIDE if scale == 2 else NEAR) + 1
    means = cv2.boxFilter(half, -1, (side, side), borderType=cv2.BORDER_REPLICATE).astype(int)
    if scale == 2:
        return half < means - OFFSET
    rows, columns = (np.minimum(np.arange(length) // 2, length // 2 - 1) for length in image.shape)
    return image < means[rows][:, columns] - OFFSET


@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize("shape", [(90, 121), (61, 80)])
@pytest.mark.parametrize("corners", [(0, 0, 1000, 1000), (31, 20, 59, 51), (0, 7, 12, 1000), (50, 3, 1000, 14)])
def test_what_is_dark_in_a_box_is_so_in_the_image(scale, shape, corners):
    image = np.random.default_rng(sum(shape)).integers(0, 256, shape).astype(np.uint8)
    x0, y0, x1, y1 = np.minimum(corners, shape[::-1] * 2)
    dark = marked_dark(image, np.array((x0, y0, x1, y1)), scale, OFFSET)
    rows, columns = slice(y0 // 2 * 2, y1), slice(x0 // 2 * 2, x1)
    if scale == 2:
        rows, columns = slice(y0 // 2, (y1 + 1) // 2), slice(x0 // 2, (x1 + 1) // 2)
    np.testing.assert_array_equal(dark, np.pad(darker(image, scale)[rows, columns], 1))
