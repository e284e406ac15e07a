"""Pictures as cameras take them of printed markers, each with one thing that makes them hard."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.evaluation.detection_images import Blur, Conditions, Picture, draw_picture, marker_texture
from flightapp.perception.camera import CameraModel

Image = NDArray[np.uint8]


SHARP = Conditions(size=45.0, blur=0.8, blur_kind=Blur.DEFOCUS, noise=2.0, tilt=0.5)


@dataclass(frozen=True)
class Effect:
    """What is unlike a good picture."""

    conditions: Conditions = SHARP
    shadow: float = 0.0
    """Share of the light that a shadow takes, whose soft edge crosses the markers."""
    contrast: float = 1.0
    exposure: float = 1.0
    gamma: float = 1.0
    jpeg: int = 0
    glare: float = 0.0
    """Grey levels of a broad bright spot on each marker."""


GOOD = Effect()


def _with(**conditions: float) -> Effect:
    return replace(GOOD, conditions=replace(GOOD.conditions, **conditions))


EFFECTS = {
    "good": GOOD,
    "near": _with(size=110.0),
    "covered in part": _with(size=140.0),
    "small": _with(size=22.0),
    "slanted by 60°": _with(slant=np.radians(60.0), tilt=0.0),
    "slanted by 70°": _with(size=60.0, slant=np.radians(70.0), tilt=0.0),
    "shadow": replace(GOOD, shadow=0.75),
    "low contrast": replace(GOOD, contrast=0.15),
    "dark": replace(GOOD, exposure=0.12),
    "overexposed": replace(GOOD, exposure=2.2),
    "gamma": replace(GOOD, gamma=2.2),
    "glare": replace(GOOD, glare=120.0),
    "margin of half a cell": _with(rim=0.5),
    "margin of a quarter": _with(rim=0.25),
    "noise": _with(noise=18.0),
    "defocus": _with(blur=4.0),
    "compression": replace(GOOD, jpeg=12),
    "clutter": _with(clutter=45.0),
}


def photograph(
    effect: Effect, camera: CameraModel, seed: int, ids: tuple[int, ...], dictionary: int = cv2.aruco.DICT_4X4_50
) -> Picture:
    """A picture of markers ``ids`` with ``effect``."""
    rng = np.random.default_rng(seed)
    textures = {n: marker_texture(dictionary, n) for n in ids}
    conditions = replace(effect.conditions, noise=0.0)
    picture = draw_picture(camera, textures, conditions, rng)
    light = picture.image.astype(np.float32)
    for quad in picture.corners.values():
        _relight(light, quad, effect, rng)
    light = 255.0 * (effect.exposure * light / 255.0) ** effect.gamma
    light = light.mean() + effect.contrast * (light - light.mean())
    image = np.clip(np.rint(light + effect.conditions.noise * rng.standard_normal(light.shape)), 0, 255).astype(
        np.uint8
    )
    if effect.jpeg:
        packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, effect.jpeg])[1]
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)
    return Picture(image, picture.corners)


def _relight(light: NDArray[np.float32], quad: NDArray[np.float64], effect: Effect, rng: np.random.Generator) -> None:
    """Throw a shadow's edge and a glare upon the marker at ``quad`` (4, 2)."""
    middle, reach = quad.mean(axis=0), float(np.linalg.norm(quad[0] - quad[2]))
    x0, y0 = np.maximum((middle - 1.5 * reach).astype(int), 0)
    part = light[y0 : int(middle[1] + 1.5 * reach), x0 : int(middle[0] + 1.5 * reach)]
    rows, columns = np.indices(part.shape)
    x, y, angle = columns + x0 - middle[0], rows + y0 - middle[1], rng.uniform(0.0, 2.0 * np.pi)
    across = x * np.cos(angle) + y * np.sin(angle) + rng.uniform(-0.2, 0.2) * reach
    part *= 1.0 - effect.shadow / (1.0 + np.exp(-np.clip(across / 2.0, -50.0, 50.0)))
    part += effect.glare * np.exp(-(x * x + y * y) / (0.5 * reach) ** 2)
