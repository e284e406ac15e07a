"""Pictures of markers whose corners are known exactly, drawn without the simulator."""

from dataclasses import dataclass

import cv2
import numpy as np

from flightapp.frames import Vector

OVERSAMPLING = 4


@dataclass(frozen=True)
class Scene:
    image: np.ndarray
    """(height, width) grey."""
    corners: dict[int, Vector]
    """(4, 2) pixels of each marker, pixel centres at whole numbers."""


def _poster(marker_id: int, dictionary: int, modules: int, per_module: int) -> np.ndarray:
    """A marker with a white rim one module wide and a grey board around it."""
    marker = cv2.aruco.getPredefinedDictionary(dictionary).generateImageMarker(marker_id, modules * per_module)
    white = cv2.copyMakeBorder(marker, *[per_module] * 4, cv2.BORDER_CONSTANT, value=255)
    return cv2.copyMakeBorder(white, *[per_module] * 4, cv2.BORDER_CONSTANT, value=90)


def _background(rng: np.random.Generator, height: int, width: int, clutter: float) -> np.ndarray:
    """Rooms have large and small patches of all brightnesses."""
    image = np.full((height, width), 110.0)
    for scale in (4, 12, 40):
        patch = rng.normal(0.0, clutter, (height // scale + 2, width // scale + 2))
        image += cv2.resize(patch, (width, height), interpolation=cv2.INTER_NEAREST if scale > 4 else cv2.INTER_LINEAR)
    return np.clip(image, 20.0, 220.0)


def _quad(rng: np.random.Generator, centre: Vector, size: float, tilt: float) -> Vector:
    """Corners of a square of ``size`` px, seen under up to ``tilt`` radians."""
    a, b, roll = *rng.uniform(-tilt, tilt, 2), rng.uniform(-0.5, 0.5)
    square = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
    turn = cv2.Rodrigues(np.array([a, b, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0]
    points = square @ turn.T
    depth = 8.0 + points[:, 2:]
    return centre + size * 8.0 * points[:, :2] / depth


def _warp(poster: np.ndarray, canvas: np.ndarray, quad: Vector, modules: int) -> np.ndarray:
    """Draw the poster on an oversampled canvas so that the marker's corners come to lie on ``quad``."""
    side = poster.shape[0]
    rim = side * 2.0 / (modules + 4)
    # Pixel edges, not centres: a marker that fills the pixels 0..n-1 reaches from -0.5 to n - 0.5.
    source = np.array([[rim, rim], [side - rim, rim], [side - rim, side - rim], [rim, side - rim]]) - 0.5
    target = (quad + 0.5) * OVERSAMPLING - 0.5
    H = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    size = (canvas.shape[1], canvas.shape[0])
    drawn = cv2.warpPerspective(poster, H, size, flags=cv2.INTER_AREA)
    mask = cv2.warpPerspective(np.full_like(poster, 255), H, size, flags=cv2.INTER_NEAREST)
    return np.where(mask > 127, drawn, canvas)


def _blur(image: np.ndarray, length: float, direction: float) -> np.ndarray:
    """Motion blur over ``length`` pixels (of the oversampled image)."""
    n = max(round(length), 1)
    offsets = np.arange(n) - 0.5 * (n - 1)
    out = np.zeros(image.shape, np.float32)
    for offset in offsets:
        shift = np.float32([[1, 0, offset * np.cos(direction)], [0, 1, offset * np.sin(direction)]])
        out += cv2.warpAffine(image.astype(np.float32), shift, image.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    return out / n


def draw(
    seed: int,
    size: float,
    blur: float = 0.0,
    ids: tuple[int, ...] = (0, 1, 2, 3, 4, 5),
    shape: tuple[int, int] = (480, 640),
    tilt: float = 0.7,
    noise: float = 3.0,
    clutter: float = 12.0,
    dictionary: int = cv2.aruco.DICT_4X4_50,
    bits: int = 4,
) -> Scene:
    """``ids`` on a grid, ``size`` px a side, motion blurred over ``blur`` px, with ``noise`` grey levels."""
    rng = np.random.default_rng(seed)
    height, width = shape
    canvas = cv2.resize(
        _background(rng, height, width, clutter).astype(np.uint8),
        (width * OVERSAMPLING, height * OVERSAMPLING),
        interpolation=cv2.INTER_NEAREST,
    )
    columns = int(np.ceil(np.sqrt(len(ids) * width / height)))
    rows = -(-len(ids) // columns)
    corners = {}
    per_module = max(8, round(size * OVERSAMPLING / (bits + 2)))
    for n, marker_id in enumerate(ids):
        cell = np.array([(n % columns + 0.5) * width / columns, (n // columns + 0.5) * height / rows])
        quad = _quad(rng, cell + rng.uniform(-15.0, 15.0, 2), size, tilt)
        canvas = _warp(_poster(marker_id, dictionary, bits + 2, per_module), canvas, quad, bits + 2)
        corners[marker_id] = quad
    if blur > 0.0:
        canvas = _blur(canvas, blur * OVERSAMPLING, rng.uniform(0.0, np.pi))
    small = cv2.resize(np.asarray(canvas, np.float32), (width, height), interpolation=cv2.INTER_AREA)
    dimmed = 20.0 + 0.6 * small + noise * rng.standard_normal(small.shape)
    return Scene(np.clip(np.round(dimmed), 0, 255).astype(np.uint8), corners)
