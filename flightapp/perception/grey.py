"""Images of any layout as what the detectors' kernels are compiled for."""

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.perception.edges import Image


def check_image(image: NDArray[np.uint8]) -> None:
    """ValueError unless ``image`` is (h, w), (h, w, 1), BGR or BGRA of bytes."""
    if image.dtype != np.uint8 or image.ndim < 2 or (image.shape[2:] or (1,)) not in {(1,), (3,), (4,)}:
        raise ValueError(f"an image must be bytes, grey or colour; this is {image.dtype} of shape {image.shape}")


def grey_image(image: NDArray[np.uint8]) -> Image:
    """A contiguous, writable grey picture (h, w) of ``image``, or itself where it is one."""
    if image.ndim == 3 and image.shape[2] > 1 and image.size:
        code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), code), np.uint8)
    return np.require(image.reshape(image.shape[:2]) if image.size else image[:0, :0], requirements=["C", "W"])
