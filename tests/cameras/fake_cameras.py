"""Stand-ins for OpenCV's VideoCapture and for a camera that is unplugged."""

import queue
import time

import cv2
import numpy as np

from flightapp.cameras.shots import CameraError, DamagedImageError, Shot

RNG = np.random.default_rng(5)


def noise(width=64, height=64):
    """An image unlike any other."""
    return RNG.integers(0, 255, (height, width), np.uint8)


def fourcc(code):
    return float(cv2.VideoWriter.fourcc(*code))


class FakeCapture:
    """A V4L2 camera as cv2.VideoCapture shows it: it films ``scene`` in the format ``code``, and takes what it can."""

    def __init__(self, scene, code="YUYV", stamps="monotonic", fixed=(), opened=True, size=None):
        self.scene, self.stamps, self.fixed, self.opened = scene, stamps, fixed, opened
        height, width = scene.shape
        self.size = size or (width, height)
        self.values = {
            cv2.CAP_PROP_FRAME_WIDTH: float(self.size[0]),
            cv2.CAP_PROP_FRAME_HEIGHT: float(self.size[1]),
            cv2.CAP_PROP_FOURCC: fourcc(code),
            cv2.CAP_PROP_CONVERT_RGB: 1.0,
        }
        self.released, self.driver = False, 0.0

    def isOpened(self):  # noqa: N802
        return self.opened

    def set(self, key, value):
        size = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        if key in self.fixed or key in size:
            return key in size
        self.values[key] = value
        return True

    def get(self, key):
        return self.driver if key == cv2.CAP_PROP_POS_MSEC else self.values.get(key, 0.0)

    def grab(self):
        time.sleep(0.002)
        now = time.monotonic()
        self.driver = 1e3 * {"monotonic": now - 0.003, "wall": time.time(), "none": 0.0}[self.stamps]
        return True

    def retrieve(self):
        code = int(self.values[cv2.CAP_PROP_FOURCC]).to_bytes(4, "little").decode()
        if self.values[cv2.CAP_PROP_CONVERT_RGB]:
            return True, cv2.cvtColor(self.scene, cv2.COLOR_GRAY2BGR)
        if code == "MJPG":
            return True, cv2.imencode(".jpg", self.scene)[1].reshape(1, -1)
        if code == "GREY":
            return True, self.scene.reshape(1, -1)
        return True, np.dstack((self.scene, np.full_like(self.scene, 128))).reshape(1, -1)

    def release(self):
        self.released = True


class FakeDevice:
    """A camera that a test feeds: images, `gone` when it is unplugged; ``absent`` attempts to open it fail then."""

    GONE = object()
    DAMAGED = object()

    def __init__(self, first=None, absent=0):
        self.name, self.hardware_stamps = "fake", True
        self.script = queue.Queue()
        self.absent, self.opened, self.closed, self.attempts = absent, 0, 0, 0
        if first is not None:
            self.film(first)

    def film(self, image, stamp=None):
        self.script.put((image, stamp))

    def open(self):
        self.attempts += 1
        if self.opened and self.absent:
            self.absent -= 1
            raise CameraError("not there")
        self.opened += 1
        return ("gain was refused",)

    def read(self):
        while True:
            try:
                image, stamp = self.script.get(timeout=10.0)
            except queue.Empty:
                raise CameraError("camera 'fake' delivers nothing any more") from None
            if image is self.GONE:
                raise CameraError("camera 'fake' was unplugged")
            if image is self.DAMAGED:
                raise DamagedImageError("no JPEG")
            return Shot(image, time.monotonic() if stamp is None else stamp)

    def close(self):
        self.closed += 1
