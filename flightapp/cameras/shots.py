"""What a camera's driver hands over: raw images of several formats as grey ones."""

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.inputs import BadInputError
from flightapp.perception.camera import CameraModel
from flightapp.perception.grey import grey_image


class CameraError(Exception):
    """A camera does not answer, or gives what cannot be used; the text says which and why."""


class DamagedImageError(Exception):
    """One image is of no use; the next may be."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One image as it came from a camera."""

    image: NDArray[np.uint8]
    """(height, width) grey, contiguous."""
    stamp: float
    """s by CLOCK_MONOTONIC, middle of the exposure."""


class Device(Protocol):
    """A camera that may be unplugged and come back; all calls block, and come from one thread at a time."""

    name: str
    """As the configuration names it."""
    hardware_stamps: bool
    """Whether stamps are the driver's own; else they are those of arrival. Known once it is open."""

    def open(self) -> tuple[str, ...]:
        """Begin to deliver; what the driver refused, in words. Raises `CameraError`."""
        ...

    def read(self) -> Shot:
        """The next image, waited for; raises `CameraError`, or `DamagedImageError` for this one alone."""
        ...

    def close(self) -> None:
        """Give the camera back; a second time changes nothing."""
        ...


def grey(raw: NDArray[np.uint8], code: str, width: int, height: int) -> NDArray[np.uint8]:
    """``raw`` (of V4L2 format ``code`` where it isn't converted) as (height, width) grey; raises `DamagedImageError`.

    Of YUYV the brightness is every other byte; of a JPEG only the brightness is decoded.
    """
    if code == "MJPG" and min(raw.shape[:2]) == 1:
        image = cv2.imdecode(raw.reshape(-1), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise DamagedImageError("it is no JPEG")
        return np.asarray(image, np.uint8)
    if code == "YUYV" and raw.size == 2 * width * height:
        return np.ascontiguousarray(raw.reshape(height, width, 2)[:, :, 0])
    if code == "GREY" and raw.size == width * height:
        return np.ascontiguousarray(raw.reshape(height, width))
    if code and raw.shape[:2] != (height, width):
        raise DamagedImageError(f"it has {raw.size} bytes, which is no image of format {code}")
    if raw.ndim < 2 or not raw.size or (raw.ndim == 3 and raw.shape[2] not in (1, 3, 4)):
        raise DamagedImageError(f"its form is unknown: {raw.shape} of format {code or 'unknown'}")
    return grey_image(np.asarray(raw, np.uint8))


def size_problem(image: NDArray[np.uint8], model: CameraModel, name: str) -> str:
    """Why ``image`` of the camera ``name`` is none of the calibrated ``model``, and how to mend it; empty if it is."""
    height, width = image.shape[:2]
    if (width, height) == (model.width, model.height):
        return ""
    return (
        f"camera '{name}': its images have {width} × {height} px, but the calibration is for {model.width} ×"
        f" {model.height}; set the camera to that size, or calibrate it at its own: set camera.width = {width},"
        f" camera.height = {height} and run flightapp calibrate camera {name}"
    )


def check_size(image: NDArray[np.uint8], model: CameraModel, name: str) -> None:
    """Raise `BadInputError` where `size_problem` has something to say."""
    if problem := size_problem(image, model, name):
        raise BadInputError(problem)
