"""Pictures of markers whose corners are known exactly, seen through any camera model.

Generated markers are put on planes before the camera, and each pixel's rays meet the paper; nothing of the
simulator is used. Blur, noise and compression come as a camera adds them: blur before noise before compression.
"""

from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.perception.camera import CameraModel

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]

SUBPIXELS = 4
"""Rays along each side of a pixel."""
PER_MODULE = 24
"""Texture pixels along a module."""
BLACK, WHITE = 28, 225
"""Grey levels of ink and paper in full light."""


class Blur(StrEnum):
    """What smears an image."""

    MOTION = "motion"
    DEFOCUS = "defocus"


@dataclass(frozen=True, slots=True)
class Conditions:
    """How markers are seen."""

    size: float = 35.0
    """px, a marker's mean side."""
    blur: float = 0.0
    """px: a motion's length, or twice the standard deviation of a defocus."""
    blur_kind: Blur = Blur.MOTION
    noise: float = 3.0
    """Grey levels, standard deviation."""
    brightness: float = 1.0
    """Share of full light; also its fall across the image is drawn at random."""
    rim: float = 1.0
    """Modules of white paper around the marker."""
    tilt: float = 0.6
    """rad, largest about each axis."""
    slant: float = 0.0
    """rad, by which each is turned besides, about an axis at random in its plane."""
    clutter: float = 14.0
    """Grey levels, standard deviation of the background's patches at each scale."""
    jpeg: int = 0
    """Quality of the compression, 1 to 100; 0 for none."""


@dataclass(frozen=True, slots=True)
class Picture:
    """An image and what is in it."""

    image: Image
    """(h, w) grey."""
    corners: dict[int, Vector]
    """(4, 2) pixels of each marker; pixel centres are at whole numbers."""


def draw_picture(
    camera: CameraModel, textures: dict[int, Image], conditions: Conditions, generator: np.random.Generator
) -> Picture:
    """One picture of every marker of ``textures`` (id to square grey texture), spread over the image.

    They need ids only to be told apart: other textures are drawn in the same way.
    """
    canvas = _background(camera, conditions.clutter, generator)
    columns = int(np.ceil(np.sqrt(max(len(textures), 1) * camera.width / camera.height)))
    rows = -(-len(textures) // columns)
    corners = {}
    for n, (marker_id, texture) in enumerate(textures.items()):
        share = (np.array((n % columns, n // columns)) + generator.uniform(0.35, 0.65, 2)) / (columns, max(rows, 1))
        # Fisheyes have dark corners where no ray arrives.
        centre = np.array((camera.width, camera.height)) * (0.5 + 0.8 * (share - 0.5))
        corners[marker_id] = _paste(canvas, camera, texture, centre, conditions, generator)
    return Picture(_exposed(canvas, conditions, generator), corners)


def marker_texture(dictionary: int, marker_id: int) -> Image:
    """A marker of OpenCV's ``dictionary``, without rim."""
    markers = cv2.aruco.getPredefinedDictionary(dictionary)
    side = (markers.markerSize + 2) * PER_MODULE
    return np.asarray(markers.generateImageMarker(marker_id, side), np.uint8)


def _background(camera: CameraModel, clutter: float, generator: np.random.Generator) -> Floats:
    """Smooth and sharp patches of several sizes, as in rooms."""
    size = camera.width, camera.height
    image = np.full((camera.height, camera.width), generator.uniform(70.0, 160.0), np.float32)
    for scale in (5, 16, 60):
        shape = camera.height // scale + 2, camera.width // scale + 2
        patches = generator.normal(0.0, clutter, shape).astype(np.float32)
        kind = cv2.INTER_NEAREST if scale == 16 else cv2.INTER_LINEAR
        image += cv2.resize(patches, size, interpolation=kind)
    return np.clip(image, 15.0, 235.0)


def _placed(
    camera: CameraModel, centre: Vector, conditions: Conditions, generator: np.random.Generator
) -> tuple[Vector, Vector, Vector, float]:
    """Centre and axes (3,) of a marker that appears at ``centre`` (2,) with the wanted size, and its side in m."""
    ahead = camera.bearings(centre[None])[0]
    across = np.cross((0.0, 1.0, 0.0), ahead)
    across /= np.linalg.norm(across)
    facing = np.column_stack((across, np.cross(ahead, across), ahead))
    tilt = generator.uniform(-conditions.tilt, conditions.tilt, 2)
    roll = generator.uniform(-np.pi, np.pi)
    if conditions.slant > 0.0:
        way = generator.uniform(-np.pi, np.pi)
        facing = facing @ cv2.Rodrigues(conditions.slant * np.array((np.cos(way), np.sin(way), 0.0)))[0]
    turn = facing @ cv2.Rodrigues(np.array((*tilt, 0.0)))[0] @ cv2.Rodrigues(np.array((0.0, 0.0, roll)))[0]
    x, y = np.asarray(turn[:, 0], float), np.asarray(turn[:, 1], float)
    side = conditions.size / float(camera.focal[0])
    for _ in range(3):
        quad = camera.project(_square(ahead, x, y, side))
        seen = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1).mean()
        side *= conditions.size / float(seen)
    return ahead, x, y, side


def _square(centre: Vector, x: Vector, y: Vector, side: float) -> Vector:
    """(4, 3) corners, clockwise from the upper left."""
    half = 0.5 * side
    return np.stack([centre + half * (i * x + j * y) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def _paste(
    canvas: Floats,
    camera: CameraModel,
    texture: Image,
    centre: Vector,
    conditions: Conditions,
    generator: np.random.Generator,
) -> Vector:
    """Draw ``texture`` with its rim into ``canvas`` (h, w), and return its corners (4, 2) in pixels."""
    p, x, y, side = _placed(camera, centre, conditions, generator)
    rim = round(conditions.rim * PER_MODULE)
    paper = cv2.copyMakeBorder(texture, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=255)
    ink = (BLACK + (WHITE - BLACK) / 255.0 * paper).astype(np.float32)
    outline = camera.project(_square(p, x, y, side * paper.shape[0] / texture.shape[0]))
    x0, y0 = np.maximum(np.floor(outline.min(axis=0)).astype(int) - 2, 0)
    x1, y1 = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 3, (camera.width, camera.height))
    columns, rows = np.meshgrid(np.arange(x0, x1, dtype=float), np.arange(y0, y1, dtype=float))
    rays = camera.bearings(np.column_stack((columns.ravel(), rows.ravel())))
    normal = np.cross(x, y)
    points = rays * ((p @ normal) / (rays @ normal))[:, None] - p
    # A texture that fills the pixels 0..n-1 reaches from -0.5 to n - 0.5.
    scale, middle = texture.shape[0] / side, 0.5 * paper.shape[0] - 0.5
    u = (scale * (points @ x) + middle).reshape(rows.shape)
    v = (scale * (points @ y) + middle).reshape(rows.shape)
    covered, light = np.zeros((2, *rows.shape), np.float32)
    (u_y, u_x), (v_y, v_x) = np.gradient(u), np.gradient(v)
    for k in range(SUBPIXELS**2):
        dx, dy = (k % SUBPIXELS + 0.5) / SUBPIXELS - 0.5, (k // SUBPIXELS + 0.5) / SUBPIXELS - 0.5
        at = (u + dx * u_x + dy * u_y).astype(np.float32), (v + dx * v_x + dy * v_y).astype(np.float32)
        inside = (at[0] > -0.5) & (at[1] > -0.5) & (at[0] < paper.shape[1] - 0.5) & (at[1] < paper.shape[0] - 0.5)
        covered += inside
        light += inside * cv2.remap(ink, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    patch = canvas[y0:y1, x0:x1]
    patch += (light - covered * patch) / SUBPIXELS**2
    return camera.project(_square(p, x, y, side))


def _exposed(canvas: Floats, conditions: Conditions, generator: np.random.Generator) -> Image:
    """What the sensor makes of ``canvas``."""
    height, width = canvas.shape
    fall = generator.uniform(-0.25, 0.25, 2)
    light = 1.0 + fall[0] * np.linspace(-1.0, 1.0, width) + fall[1] * np.linspace(-1.0, 1.0, height)[:, None]
    lit = canvas * (conditions.brightness * light / light.max()).astype(np.float32)
    if conditions.blur > 0.0:
        if conditions.blur_kind is Blur.MOTION:
            lit = cv2.filter2D(lit, -1, streak(conditions.blur, generator.uniform(0.0, np.pi)))
        else:
            lit = cv2.GaussianBlur(lit, (0, 0), 0.5 * conditions.blur)
    noisy = lit + generator.normal(0.0, conditions.noise, lit.shape)
    image: Image = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
    if conditions.jpeg:
        packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, conditions.jpeg])[1]
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)
    return image


def streak(length: float, direction: float) -> Floats:
    """Kernel of a straight motion over ``length`` px, symmetric about its centre."""
    half, fine = int(np.ceil(0.5 * length)) + 1, 9
    s = (np.arange(64) + 0.5) / 64 - 0.5
    # Spread over a pixel's width, so that the weights change smoothly with the direction.
    off = ((np.arange(fine) + 0.5) / fine - 0.5)[:, None]
    rows = np.rint(half + s * length * np.sin(direction) + off).astype(int)
    columns = np.floor(half + s * length * np.cos(direction) + off + 0.5).astype(int)
    hits = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    np.add.at(hits, (rows, columns), 1.0)
    weights: Floats = hits / hits.sum()
    return weights
