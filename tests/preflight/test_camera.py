"""What the doctor says of a camera: one that is made up, frame by frame."""

import asyncio

import cv2
import numpy as np
import pytest

from flightapp.autopilot.diagnosis import Light
from flightapp.config import Config, load_config
from flightapp.messages import Frame
from flightapp.preflight import camera

GREEN, AMBER, RED = Light.GREEN, Light.AMBER, Light.RED
OWN = ["camera.focal=[331.0, 330.2, 322.4, 236.1]", "camera.distortion=[-0.05, 0.01, 0.0, 0.0]"]
"""A calibration that is not the default's."""


def room(seed=0, sigma=0.0, noise=3.0, gain=1.0):
    """A picture of boxes of all sizes, (480, 640)."""
    rng = np.random.default_rng(seed)
    image = np.full((480, 640), 110, np.uint8)
    for _ in range(60):
        (x, y), (w, h) = rng.integers(0, (600, 440)).tolist(), rng.integers(10, 80, 2).tolist()
        cv2.rectangle(image, (x, y), (x + w, y + h), int(rng.integers(0, 255)), -1)
    if sigma:
        image = cv2.GaussianBlur(image, (0, 0), sigma)
    return np.clip(gain * image + rng.normal(0.0, noise, image.shape), 0, 255).astype(np.uint8)


class FakeCamera:
    """A camera at ``rate`` Hz whose frames come ``age`` s after their exposure."""

    def __init__(self, config, rate=200.0, age=0.01, image=None, frozen=False):
        self.model = config.camera.model()
        self._period, self._age, self._image, self._frozen = 1.0 / rate, age, image, frozen

    async def frames(self):
        loop = asyncio.get_running_loop()
        image = room() if self._image is None else self._image
        for sequence in range(100_000):
            await asyncio.sleep(self._period)
            shown = image if self._frozen else np.roll(image, sequence, axis=1)
            yield Frame(loop.time() - self._age, sequence, shown)


def seen(stamps=None, ages=0.012, image=None, repeated=0):
    stamps = np.arange(0.0, 3.0, 1.0 / 30.0) if stamps is None else np.asarray(stamps, float)
    return camera.Seen(3.0, stamps, np.full(stamps.shape, ages), repeated, room() if image is None else image)


def found(what, overrides=()):
    config = load_config(None, None, [*OWN, *overrides])
    return {line.name: line for line in camera.lines(what, config, config.camera.model())}


def test_a_good_camera_is_green():
    lines = found(seen())
    assert {line.light for line in lines.values()} == {GREEN}
    assert {"frames", "age", "exposure", "sharpness", "motion blur", "calibration"} == set(lines)


@pytest.mark.parametrize(
    ("what", "overrides", "name", "light", "told"),
    [
        (seen(stamps=[]), [], "frames", RED, "none in 3 s"),
        (seen(stamps=np.arange(0.0, 3.0, 0.05)), [], "frames", AMBER, "20.0 Hz"),
        (seen(stamps=np.delete(np.arange(0.0, 3.0, 1.0 / 30.0), [40, 41])), [], "frames", AMBER, "longest wait 100 ms"),
        (seen(stamps=[0.0, 0.03, 0.02]), [], "frames", RED, "do not ascend"),
        (seen(ages=0.2), [], "age", AMBER, "200 ms"),
        (seen(ages=-0.01), [], "age", RED, "-10 ms"),
        (seen(repeated=80), [], "frozen", RED, "80 of 90"),
        (seen(image=room(gain=0.1)), [], "exposure", AMBER, "black or white"),
        (seen(image=room(gain=3.0)), [], "exposure", AMBER, "black or white"),
        (seen(image=room(sigma=5.0)), [], "sharpness", AMBER, "blurred by"),
        (seen(image=np.full((480, 640), 120, np.uint8)), [], "sharpness", AMBER, "too few edges"),
        (seen(), ["camera.exposure=0.01"], "motion blur", AMBER, "9.9 px"),
        (seen(image=room()[::2, ::2]), [], "calibration", RED, "320 × 240"),
    ],
)
def test_what_is_wrong_is_told_with_its_mend(what, overrides, name, light, told):
    line = found(what, overrides)[name]
    assert line.light is light
    assert told in line.found
    assert line.mend


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["camera.focal=[331.0, 360.0, 322.4, 236.1]"], "fx and fy differ by 9 %"),
        (["camera.focal=[331.0, 330.2, 100.0, 236.1]"], "cx = 100 is far from the middle"),
        (["camera.focal=[3310.0, 3302.0, 322.4, 236.1]"], "a view of 11°"),
        (["camera.distortion=[-2.0, 0.0, 0.0, 0.0]"], "folds"),
    ],
)
def test_a_calibration_that_cannot_be_one_is_told(overrides, told):
    line = found(seen(), overrides)["calibration"]
    assert line.light is AMBER
    assert told in line.found


def test_the_default_s_calibration_is_no_camera_s():
    config = Config()
    (line,) = camera.calibration(config.camera, config.camera.model(), room())
    assert (line.light, "simulated" in line.found) == (AMBER, True)


def test_a_fisheye_may_see_behind_itself():
    overrides = ["camera.lens=fisheye", "camera.focal=[180.0, 180.0, 320.0, 240.0]", "camera.distortion=[0, 0, 0, 0]"]
    config = load_config(None, None, overrides)
    assert camera.view(config.camera, config.camera.model()) == pytest.approx(np.degrees(639 / 180.0), abs=0.5)


@pytest.mark.parametrize("sigma", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("noise", [0.0, 6.0])
def test_blur_is_measured_whatever_the_noise(sigma, noise):
    assert camera.blur(room(sigma=sigma, noise=noise)) == pytest.approx(np.hypot(sigma, 1.0), abs=0.35)


async def test_a_camera_is_watched():
    config = load_config(None, None, OWN)
    what = await camera.watch(FakeCamera(config), 0.4)
    assert 5 < what.stamps.size <= 80
    assert (what.ages >= 0.01).all()
    assert what.repeated == 0
    assert what.image.shape == (480, 640)


async def test_a_frozen_camera_and_a_silent_one():
    config = load_config(None, None, OWN)
    what = await camera.watch(FakeCamera(config, frozen=True), 0.3)
    assert what.repeated == what.stamps.size - 1
    nothing = await camera.watch(FakeCamera(config, rate=0.1), 0.05)
    assert nothing.stamps.size == 0
    assert nothing.image is None
    assert found(nothing)["frames"].light is RED
