"""What a doctor looks at of the camera: rate, age, exposure, sharpness, and whether its calibration can be one.

`watch` collects frames of any `FrameSource`; the rest are pure functions of what was seen.
"""

import asyncio
import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.autopilot.diagnosis import Light, Line
from flightapp.config import Camera, Config
from flightapp.frames import Vector
from flightapp.interfaces import FrameSource
from flightapp.messages import Frame
from flightapp.perception.camera import CameraModel
from flightapp.sensors.frames import FrameIntake

CAMERA = "camera"
GREEN, AMBER, RED = Light.GREEN, Light.AMBER, Light.RED
RATE_SHARE, GAP = 0.9, 2.5
"""Of the rate that is configured, less is worth a look; as is a wait of so many periods."""
LATE = 0.02
"""s by which frames may be older than camera.latency says."""
DARK, BRIGHT, CLIPPED = 30.0, 225.0, 0.2
"""Grey values between which the mean should lie; the share of pixels that may be black or white all over."""
EDGE, STEP, EDGES = 25, 50.0, 10
"""px around an edge; grey values that it must rise; how many there must be to tell the blur."""
BLURRED = 3.0
"""px, standard deviation: a small marker's cells are hardly wider."""
REPEATED = 0.05
"""Share of frames that may be the one before once more."""
TURNING, SMEAR = 3.0, 6.0
"""rad/s of a quick turn, and the px that it may smear: a small marker's cell."""
OFF_CENTRE, STRETCHED = 0.15, 0.03
"""Of the image, by which a principal point, and of the focal length, by which another, are seldom off."""
VIEWS = (30.0, 200.0)
"""° across that lenses have which were made for this."""
FOLD = 1.0
"""px by which an image's edge may come back from its own ray."""
DEFAULT = Camera()


@dataclass(frozen=True, slots=True)
class Seen:
    """What was seen of a camera in a while."""

    seconds: float
    stamps: Vector
    """(n,) s."""
    ages: Vector
    """(n,) s from each stamp to its arrival."""
    repeated: int
    """Frames that showed the one before once more."""
    image: NDArray[np.uint8] | None
    """The newest."""


async def watch(source: FrameSource, seconds: float) -> Seen:
    """Look at ``source`` for ``seconds``."""
    intake, loop = FrameIntake(), asyncio.get_running_loop()
    stamps: list[float] = []
    ages: list[float] = []
    newest: Frame | None = None
    try:
        async with asyncio.timeout(seconds):
            async for frame in source.frames():
                stamps.append(frame.stamp)
                ages.append(loop.time() - frame.stamp)
                intake.take(frame)
                newest = frame
    except TimeoutError:
        pass
    return Seen(seconds, np.array(stamps), np.array(ages), intake.repeated, None if newest is None else newest.image)


def lines(seen: Seen, config: Config, model: CameraModel) -> Iterator[Line]:
    """All of it."""
    camera = config.camera
    if not seen.stamps.size:
        mend = "look at plug and power, and whether another program holds it"
        yield Line(CAMERA, "frames", RED, f"none in {seen.seconds:g} s", f"{camera.rate:g} Hz", mend)
    else:
        yield _rate(seen, camera.rate)
        yield _age(seen, camera.latency)
    if seen.repeated > REPEATED * seen.stamps.size:
        found = f"{seen.repeated} of {seen.stamps.size} frames were the one before again"
        yield Line(CAMERA, "frozen", RED, found, "another image each time", "unplug it and plug it in again")
    if seen.image is not None:
        yield from _picture(seen.image)
    yield _smear(camera, model)
    yield from calibration(camera, model, seen.image)


def _rate(seen: Seen, wanted: float) -> Line:
    """By the stamps: how evenly the shutter opens, however frames arrive."""
    target = f"{wanted:g} Hz"
    if seen.stamps.size < 2:
        return Line(CAMERA, "frames", AMBER, f"{seen.stamps.size} in {seen.seconds:g} s", target, "look at its driver")
    gaps = np.diff(seen.stamps)
    if not (gaps > 0.0).all():
        mend = "its driver's stamps cannot be used: take another, or have frames stamped on arrival"
        return Line(CAMERA, "frames", RED, "stamps that do not ascend", target, mend)
    rate, longest = 1.0 / float(np.median(gaps)), float(gaps.max())
    found = f"{rate:.1f} Hz, longest wait {1e3 * longest:.0f} ms"
    if rate < RATE_SHARE * wanted:
        mend = "a shorter exposure, another format or size, a USB 3 port; or set camera.rate to what it does"
        return Line(CAMERA, "frames", AMBER, found, target, mend)
    if longest > GAP / wanted:
        return Line(CAMERA, "frames", AMBER, found, target, "frames are lost: look at cable, bandwidth and load")
    return Line(CAMERA, "frames", GREEN, found, target)


def _age(seen: Seen, latency: float) -> Line:
    age = float(np.median(seen.ages))
    found, wanted = f"{1e3 * age:.0f} ms from exposure to here", f"camera.latency, {1e3 * latency:.0f} ms"
    if age < 0.0:
        return Line(CAMERA, "age", RED, found, wanted, "stamps are by another clock than this computer's")
    if age > latency + LATE:
        mend = "fewer buffers in its driver; or set camera.latency to what was found"
        return Line(CAMERA, "age", AMBER, found, wanted, mend)
    return Line(CAMERA, "age", GREEN, found, wanted)


def _picture(image: NDArray[np.uint8]) -> Iterator[Line]:
    mean = float(image.mean())
    clipped = float(np.mean((image <= 2) | (image >= 253)))
    found, wanted = f"mean {mean:.0f} of 255, {100 * clipped:.0f} % black or white", f"{DARK:g} to {BRIGHT:g}"
    if DARK <= mean <= BRIGHT and clipped <= CLIPPED:
        yield Line(CAMERA, "exposure", GREEN, found, wanted)
    else:
        dark = mean < 127.5
        mend = "more light, more gain; a longer exposure smears" if dark else "a shorter exposure, less gain"
        yield Line(CAMERA, "exposure", AMBER, found, wanted, mend)
    sigma, wanted = blur(image), f"under {BLURRED:g} px"
    if math.isnan(sigma):
        mend = "take off the cap, or show it something with edges: a gate, a shelf"
        yield Line(CAMERA, "sharpness", AMBER, "too few edges to tell", wanted, mend)
        return
    mend = "" if sigma < BLURRED else "focus it and fix the ring; hold it still; clean the lens"
    light = AMBER if mend else GREEN
    yield Line(CAMERA, "sharpness", light, f"edges are blurred by {sigma:.1f} px", wanted, mend)


def blur(image: NDArray[np.uint8]) -> float:
    """Standard deviation (px) of the blur of ``image`` (h, w), by its edges; NaN where there are too few.

    A step of height A that is blurred by a Gaussian of σ has the slope A / (σ √2π) at its steepest. σ is the median
    over all places that are the steepest of their surroundings; what a smoothing of 3 px against noise adds is left
    in, so that a sharp image has about 1 px.
    """
    grey = cv2.GaussianBlur(image, (3, 3), 0).astype(np.float32)
    across, down = grey[1:-1, 2:] - grey[1:-1, :-2], grey[2:, 1:-1] - grey[:-2, 1:-1]
    slope, around = 0.5 * cv2.magnitude(across, down), np.ones((EDGE, EDGE), np.uint8)
    height = cv2.dilate(grey[1:-1, 1:-1], around) - cv2.erode(grey[1:-1, 1:-1], around)
    steepest = cv2.dilate(slope, around)
    edges = (slope == steepest) & (height >= STEP)
    if np.count_nonzero(edges) < EDGES:
        return math.nan
    return float(np.median(height[edges] / steepest[edges])) / math.sqrt(2.0 * math.pi)


def _smear(camera: Camera, model: CameraModel) -> Line:
    """Motion blur that the exposure lets a quick turn make in the middle of the image."""
    smear = camera.exposure * TURNING * float(model.focal[0])
    found = f"{smear:.1f} px at {TURNING:g} rad/s with camera.exposure {1e3 * camera.exposure:g} ms"
    if smear <= SMEAR:
        return Line(CAMERA, "motion blur", GREEN, found, f"under {SMEAR:g} px")
    mend = "a shorter exposure and more light: markers are lost while it turns"
    return Line(CAMERA, "motion blur", AMBER, found, f"under {SMEAR:g} px", mend)


def calibration(camera: Camera, model: CameraModel, image: NDArray[np.uint8] | None) -> Iterator[Line]:
    """Whether what the configuration says of the lens can be true of this camera."""
    name, mend = "calibration", "calibrate the camera (section camera)"
    wrong = tuple(_implausible(camera, model))
    if image is not None and image.shape[:2] != (camera.height, camera.width):
        height, width = image.shape[:2]
        yield Line(CAMERA, name, RED, f"images are {width} × {height}", f"{camera.width} × {camera.height}", mend)
    elif (camera.focal, camera.distortion) == (DEFAULT.focal, DEFAULT.distortion):
        yield Line(CAMERA, name, AMBER, "the default's: the simulated camera's", "this camera's own", mend)
    elif wrong:
        yield Line(CAMERA, name, AMBER, "; ".join(wrong), "plausible", mend)
    else:
        yield Line(CAMERA, name, GREEN, f"{model.lens}, {view(camera, model):.0f}° across", "plausible")


def view(camera: Camera, model: CameraModel) -> float:
    """° between the rays of the middle of the image's left and right edge."""
    middle = 0.5 * (camera.height - 1)
    left, right = model.bearings(np.array([[0.0, middle], [camera.width - 1.0, middle]]))
    return float(np.degrees(np.arctan2(-left[0], left[2]) + np.arctan2(right[0], right[2])))


def _implausible(camera: Camera, model: CameraModel) -> Iterator[str]:
    fx, fy, cx, cy = camera.focal
    if abs(fx - fy) > STRETCHED * fx:
        yield f"fx and fy differ by {100 * abs(fx - fy) / fx:.0f} %"
    for what, place, size in (("cx", cx, camera.width), ("cy", cy, camera.height)):
        if abs(place - 0.5 * (size - 1)) > OFF_CENTRE * size:
            yield f"{what} = {place:.0f} is far from the middle"
    across, (least, most) = view(camera, model), VIEWS
    if not least <= across <= most:
        yield f"a view of {across:.0f}°"
    w, h = camera.width - 1.0, camera.height - 1.0
    places = [(x * w, y * h) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0) if (x, y) != (0.5, 0.5)]
    edge = np.array(places)
    back = model.project(model.bearings(edge))
    if not (np.linalg.norm(back - edge, axis=1) < FOLD).all():
        yield "the distortion folds the image's edge over"
