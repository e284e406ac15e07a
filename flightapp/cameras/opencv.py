"""Cameras through OpenCV's VideoCapture: V4L2, a Jetson's CSI cameras through GStreamer, streams through FFmpeg.

V4L2's buffers carry the driver's stamps (V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC), which OpenCV hands on as
CAP_PROP_POS_MSEC. Where they are not by CLOCK_MONOTONIC, images are stamped when they arrive.
"""

import os
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from flightapp.cameras.names import Kind, Source, what_there_is
from flightapp.cameras.shots import CameraError, DamagedImageError, Shot, grey
from flightapp.config import Camera
from flightapp.inputs import BadInputError

OLDEST = 1.0
"""s before its arrival that a driver's stamp may be."""
EXPOSURE_UNIT = 1e-4
"""s, V4L2_CID_EXPOSURE_ABSOLUTE."""
MANUAL, AUTOMATIC = 1.0, 3.0
"""V4L2_EXPOSURE_MANUAL and V4L2_EXPOSURE_APERTURE_PRIORITY."""
STALLED = 1
"""s without an image, in whole seconds, after which a V4L2 camera counts as lost."""
PATIENCE = 2000
"""ms to wait for a stream's next image."""
NO_GSTREAMER = (
    "this OpenCV was built without GStreamer, which a Jetson's CSI cameras need (pip's opencv-python-headless has"
    " none): use JetPack's own OpenCV or one that was built with -D WITH_GSTREAMER=ON, or a camera at /dev/videoN"
)

Opener = Callable[..., Any]


def has_gstreamer(information: str | None = None) -> bool:
    """Whether this OpenCV was built with GStreamer, by its build ``information``."""
    lines = (cv2.getBuildInformation() if information is None else information).splitlines()
    return any(line.strip().startswith("GStreamer:") and "YES" in line for line in lines)


def csi_pipeline(source: str, camera: Camera) -> str:
    """GStreamer's pipeline for the sensor of ``source``, csi:N: grey images, the newest only."""
    rate = Fraction(camera.rate).limit_denominator(1001)
    wanted = [f"sensor-id={source.partition(':')[2]}"]
    if not camera.auto_exposure:
        nanoseconds = round(1e9 * camera.exposure)
        wanted.append(f'exposuretimerange="{nanoseconds} {nanoseconds}"')
    if camera.gain >= 0.0:
        wanted.append(f'gainrange="{camera.gain:g} {camera.gain:g}"')
    size = f"width={camera.width}, height={camera.height}"
    return (
        f"nvarguscamerasrc {' '.join(wanted)} ! video/x-raw(memory:NVMM), {size},"
        f" framerate={rate.numerator}/{rate.denominator}, format=NV12 ! nvvidconv ! video/x-raw, {size}, format=GRAY8"
        " ! appsink drop=true max-buffers=1 sync=false"
    )


class OpencvDevice:
    """A live camera; ``opener`` makes what OpenCV's VideoCapture is."""

    def __init__(self, source: Source, camera: Camera, opener: Opener = cv2.VideoCapture) -> None:
        if source.kind is Kind.CSI and opener is cv2.VideoCapture and not has_gstreamer():
            raise BadInputError(f"camera '{source.text}': {NO_GSTREAMER}")
        self.name = source.text
        self.hardware_stamps = False
        self._kind, self._camera, self._opener = source.kind, camera, opener
        self._capture: Any = None
        self._code = ""
        # OpenCV reads it at its first look for an image, which it else waits 10 s for.
        os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", f"{STALLED}")

    def open(self) -> tuple[str, ...]:
        """Begin to deliver; what the driver refused, in words. Raises `CameraError`."""
        self.close()
        if self._kind is Kind.V4L2 and self._opener is cv2.VideoCapture and not Path(self.name).exists():
            raise CameraError(f"camera '{self.name}' is not there; {what_there_is()}")
        capture = self._opener(*self._arguments())
        if not capture.isOpened():
            capture.release()
            raise CameraError(f"camera '{self.name}' cannot be opened: {self._why()}")
        self._capture = capture
        try:
            refused = self._configure() if self._kind is Kind.V4L2 else ()
            self._choose_stamps()
        except CameraError:
            self.close()
            raise
        return refused

    def read(self) -> Shot:
        """The next image, waited for; raises `CameraError`, or `DamagedImageError` for this one alone."""
        arrived, driver = self._grab()
        ok, raw = self._capture.retrieve()
        if not ok or raw is None:
            raise DamagedImageError("it cannot be decoded")
        image = grey(np.asarray(raw), self._code, self._camera.width, self._camera.height)
        if self.hardware_stamps and 0.0 <= arrived - driver < OLDEST:
            return Shot(image, driver - self._camera.driver_delay)
        return Shot(image, arrived - self._camera.latency)

    def close(self) -> None:
        """Give the camera back; a second time changes nothing."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def _arguments(self) -> tuple[Any, ...]:
        if self._kind is Kind.CSI:
            return csi_pipeline(self.name, self._camera), cv2.CAP_GSTREAMER
        if self._kind is Kind.V4L2:
            return self.name, cv2.CAP_V4L2
        patience = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, PATIENCE, cv2.CAP_PROP_READ_TIMEOUT_MSEC, PATIENCE]
        return self.name, cv2.CAP_FFMPEG, patience

    def _why(self) -> str:
        if self._kind is Kind.V4L2:
            return f"another program has it, or it films nothing (a metadata node), or you may not; {what_there_is()}"
        if self._kind is Kind.CSI:
            return "look at what nvargus-daemon says (journalctl -u nvargus-daemon), and at the cable"
        return "nothing serves images there"

    def _grab(self) -> tuple[float, float]:
        """Wait for an image; when it arrived, and the driver's stamp."""
        if self._capture is None or not self._capture.grab():
            raise CameraError(f"camera '{self.name}' delivers nothing any more")
        return time.monotonic(), 1e-3 * float(self._capture.get(cv2.CAP_PROP_POS_MSEC))

    def _choose_stamps(self) -> None:
        """Whether the driver's stamps are by our clock: as two images say."""
        wanted = self._camera.stamps
        sound = self._kind is Kind.V4L2 and wanted != "arrival"
        stamps = []
        for _ in range(2 if sound else 0):
            arrived, driver = self._grab()
            sound = sound and driver > 0.0 and 0.0 <= arrived - driver < OLDEST
            stamps.append(driver)
        self.hardware_stamps = sound and stamps[0] < stamps[1]
        if wanted == "driver" and not self.hardware_stamps:
            raise CameraError(
                f"camera '{self.name}': its driver's stamps are not by CLOCK_MONOTONIC; set camera.stamps = 'arrival'"
                " and calibrate camera.latency (for USB cameras also: modprobe uvcvideo clock=CLOCK_MONOTONIC)"
            )

    def _configure(self) -> tuple[str, ...]:
        """Set what is wanted, read it back, and say what is otherwise; raises `CameraError` for another size."""
        camera, refused = self._camera, []
        self._set(cv2.CAP_PROP_MODE, 0.0)  # values are the driver's own, not shares of their range
        if camera.format != "any":
            self._set(cv2.CAP_PROP_FOURCC, float(cv2.VideoWriter.fourcc(*camera.format)))
        for key, value in ((cv2.CAP_PROP_FRAME_WIDTH, camera.width), (cv2.CAP_PROP_FRAME_HEIGHT, camera.height)):
            self._set(key, float(value))
        self._set(cv2.CAP_PROP_FPS, camera.rate)
        self._set(cv2.CAP_PROP_BUFFERSIZE, 2.0)
        size = round(self._get(cv2.CAP_PROP_FRAME_WIDTH)), round(self._get(cv2.CAP_PROP_FRAME_HEIGHT))
        if size != (camera.width, camera.height):
            raise CameraError(
                f"camera '{self.name}' films {size[0]} × {size[1]} px, not {camera.width} × {camera.height}; set"
                f" camera.width = {size[0]}, camera.height = {size[1]} and calibrate it at that size, or choose a size"
                " that v4l2-ctl --list-formats-ext lists"
            )
        code = int(self._get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True).decode("latin-1").strip()
        if camera.format not in ("any", code):
            refused.append(f"camera.format = {camera.format} was refused: it films {code}")
        self._code = code
        # OpenCV then hands the buffer on as it is, a row of bytes, and only the brightness is taken of it.
        if code not in ("MJPG", "YUYV", "GREY") or not self._set(cv2.CAP_PROP_CONVERT_RGB, 0.0):
            self._code = ""
        rate = self._get(cv2.CAP_PROP_FPS)
        if abs(rate - camera.rate) > 0.02 * camera.rate:
            refused.append(f"camera.rate = {camera.rate:g} Hz was refused: it films at {rate:g} Hz")
        return (*refused, *self._expose())

    def _expose(self) -> list[str]:
        """Set exposure and gain; what was refused."""
        camera, refused = self._camera, []
        wanted = [(cv2.CAP_PROP_AUTO_EXPOSURE, AUTOMATIC if camera.auto_exposure else MANUAL, "auto_exposure")]
        if not camera.auto_exposure:
            wanted.append((cv2.CAP_PROP_EXPOSURE, float(round(camera.exposure / EXPOSURE_UNIT)), "exposure"))
        if camera.gain >= 0.0:
            wanted.append((cv2.CAP_PROP_GAIN, camera.gain, "gain"))
        for key, value, name in wanted:
            done, is_now = self._set(key, value), self._get(key)
            if not done or abs(is_now - value) > 0.5 + 0.02 * abs(value):
                unit = " (units of 0.1 ms)" if name == "exposure" else ""
                refused.append(
                    f"camera.{name}: {value:g} was refused, it stays at {is_now:g}{unit}; v4l2-ctl"
                    f" -d {self.name} --list-ctrls tells what it can"
                )
        return refused

    def _set(self, key: int, value: float) -> bool:
        return bool(self._capture.set(key, value))

    def _get(self, key: int) -> float:
        return float(self._capture.get(key))
