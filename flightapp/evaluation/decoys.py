"""Pictures without any known marker, full of what might be taken for one.

They are drawn quickly rather than exactly, so that a hundred thousand can be: textures on planes, warped onto a
cluttered background at three times its resolution, then light, blur, noise and compression.
"""

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.evaluation.detection_images import BLACK, WHITE, Floats, Image, streak
from flightapp.frames import Vector
from flightapp.perception.decoding import marker_codes

SHAPE = (240, 320)
"""px, height and width of a picture."""
MOST = 4
"""Decoys in a picture; every fifth picture has none."""
FINE = 3
"""Drawn pixels along a pixel."""
PER_CELL = 8
"""Texture pixels along a cell."""
IDS = range(50)
"""Of the dictionary 4X4_50, all of which count as known."""
OTHERS = (
    cv2.aruco.DICT_5X5_1000,
    cv2.aruco.DICT_6X6_1000,
    cv2.aruco.DICT_7X7_1000,
    cv2.aruco.DICT_ARUCO_ORIGINAL,
    cv2.aruco.DICT_APRILTAG_16h5,
    cv2.aruco.DICT_APRILTAG_25h9,
    cv2.aruco.DICT_APRILTAG_36h11,
)

Cells = NDArray[np.uint8]


def decoy_picture(generator: np.random.Generator) -> tuple[Image, list[Vector]]:
    """A picture (240, 320), and the boxes (4,) x0, y0, x1, y1 of the decoys in it."""
    canvas, boxes = _background(generator), []
    count = int(generator.integers(MOST + 1))
    for n in range(count):
        centre = np.array((SHAPE[1] * (0.25 + 0.5 * (n % 2)), SHAPE[0] * (0.25 + 0.5 * (n // 2))))
        boxes.append(_paste(canvas, decoy_texture(generator), centre + generator.uniform(-20.0, 20.0, 2), generator))
    return _exposed(canvas, generator), boxes


def decoy_texture(generator: np.random.Generator) -> Image:
    """Square, 0 to 255: something like a marker of `IDS`, but none."""
    kinds: tuple[Callable[[np.random.Generator], Image], ...] = (
        *(_near_code,) * 3,
        _other_dictionary,
        _mirrored,
        _inverted,
        _random_code,
        _cut,
        _squares,
        _qr,
        _text,
        _blobs,
        _nested,
    )
    return kinds[int(generator.integers(len(kinds)))](generator)


def texture_of(cells: Cells, per_cell: int = PER_CELL) -> Image:
    """A picture of ``cells`` (n, n), 1 for white."""
    return np.asarray(cv2.resize(255 * cells, None, None, per_cell, per_cell, cv2.INTER_NEAREST), np.uint8)


@cache
def _bordered(dictionary: int) -> Cells:
    """(k, n + 2, n + 2) cells of all markers of ``dictionary`` with their black border."""
    return np.pad(marker_codes(cv2.aruco.getPredefinedDictionary(dictionary)), ((0, 0), (1, 1), (1, 1)))


@cache
def _known() -> Floats:
    """(200, 6, 6) cells of all markers of `IDS` in all turns."""
    codes = _bordered(cv2.aruco.DICT_4X4_50)[list(IDS)].astype(np.float32)
    return np.concatenate([np.rot90(codes, turn, axes=(1, 2)) for turn in range(4)])


def _unlike(texture: Image, generator: np.random.Generator) -> Image:
    """``texture``, or another decoy where it is a marker: some are another's mirror image, or lose little by a cut.

    It is none where it differs from each marker by three quarters of a cell at least, somewhere.
    """
    cells = cv2.resize(texture, (6, 6), None, 0.0, 0.0, cv2.INTER_AREA) / np.float32(255.0)
    differ = np.abs(cells - _known()).max(axis=(1, 2)).min() >= 0.75
    return texture if differ else decoy_texture(generator)


def _unknown(cells: Cells, generator: np.random.Generator) -> Image:
    return _unlike(texture_of(np.ascontiguousarray(cells)), generator) if len(cells) == 6 else texture_of(cells)


def _near_code(generator: np.random.Generator) -> Image:
    return _unknown(_bordered(cv2.aruco.DICT_4X4_1000)[generator.integers(IDS.stop, 1000)], generator)


def _other_dictionary(generator: np.random.Generator) -> Image:
    markers = _bordered(int(generator.choice(OTHERS)))
    return _unknown(markers[generator.integers(len(markers))], generator)


def _mirrored(generator: np.random.Generator) -> Image:
    return _unknown(_bordered(cv2.aruco.DICT_4X4_50)[generator.choice(IDS)][:, ::-1], generator)


def _inverted(generator: np.random.Generator) -> Image:
    return texture_of(np.asarray(1 - _bordered(cv2.aruco.DICT_4X4_50)[generator.choice(IDS)], np.uint8))


def _random_code(generator: np.random.Generator) -> Image:
    code = generator.random((4, 4)) < generator.uniform(0.05, 0.95)
    return _unknown(np.pad(code.astype(np.uint8), 1), generator)


def _cut(generator: np.random.Generator) -> Image:
    """A marker of which two cells in five or more are hidden, by something dark, grey or bright."""
    texture = texture_of(_bordered(cv2.aruco.DICT_4X4_50)[generator.choice(IDS)])
    side = texture.shape[0]
    texture[: round(generator.uniform(0.4, 0.7) * side)] = generator.choice((0, 128, 255))
    return _unlike(texture, generator)


def _squares(generator: np.random.Generator) -> Image:
    """Black squares, chessboards, and grids as of windows and keyboards."""
    n = int(generator.integers(2, 9))
    rows, columns = np.indices((n, n))
    kind = generator.integers(3)
    if kind < 2:
        return texture_of(np.asarray((rows + columns) % 2 * kind, np.uint8), 48 // n + 1)
    pane = generator.integers(0, 120, (n, n)).astype(np.uint8)
    texture = cv2.resize(pane, None, None, 12, 12, cv2.INTER_NEAREST)
    bar = int(generator.integers(1, 5))
    for k in range(n + 1):
        texture[max(12 * k - bar, 0) : 12 * k + bar] = 255
        texture[:, max(12 * k - bar, 0) : 12 * k + bar] = 255
    return np.asarray(texture, np.uint8)


def _qr(generator: np.random.Generator) -> Image:
    """Random cells with a QR code's three finder patterns."""
    n = int(generator.integers(11, 30))
    cells = (generator.random((n, n)) < 0.5).astype(np.uint8)
    finder = np.zeros((8, 8), np.uint8)
    finder[1:6, 1:6], finder[2:5, 2:5] = 1, 0
    finder[7], finder[:, 7] = 1, 1
    cells[:8, :8], cells[:8, n - 8 :], cells[n - 8 :, :8] = finder, finder[:, ::-1], finder[::-1]
    return texture_of(cells, 96 // n + 1)


def _text(generator: np.random.Generator) -> Image:
    texture = np.full((96, 96), 255, np.uint8)
    size = generator.uniform(0.4, 2.5)
    for line in range(int(96 / (24 * size)) + 1):
        letters = "".join(chr(n) for n in generator.integers(33, 127, 8))
        font, thick = int(generator.integers(8)), int(generator.integers(1, 5))
        cv2.putText(texture, letters, (2, round(24 * size * (line + 1))), font, size, 0, thick)
    return texture if generator.random() < 0.7 else np.asarray(255 - texture, np.uint8)


def _blobs(generator: np.random.Generator) -> Image:
    """Dark shapes with bright ones inside."""
    texture = np.full((96, 96), 255, np.uint8)
    shift, angle = generator.uniform(-8.0, 8.0, 2), generator.uniform(0.0, 360.0)
    cv2.ellipse(texture, (tuple(48.0 + shift), tuple(generator.uniform(40.0, 96.0, 2)), angle), 0, -1)
    for _ in range(int(generator.integers(6))):
        x, y = generator.integers(20, 76, 2)
        w, h = generator.integers(6, 30, 2)
        cv2.rectangle(texture, (int(x), int(y)), (int(x + w), int(y + h)), int(generator.integers(256)), -1)
    return texture


def _nested(generator: np.random.Generator) -> Image:
    """A black square with bright and dark rectangles inside, on the lines of a marker's cells or off them."""
    texture = np.zeros((48, 48), np.uint8)
    for _ in range(int(generator.integers(1, 5))):
        a, b = np.sort(generator.uniform(6.0, 42.0, (2, 2)), axis=0)
        if generator.random() < 0.5:
            a, b = 8.0 * np.round(a / 8.0), 8.0 * np.round(b / 8.0)
        texture[int(a[0]) : int(b[0]), int(a[1]) : int(b[1])] = generator.choice((0, 255, 255))
    return _unlike(texture, generator)


def _background(generator: np.random.Generator) -> Floats:
    """Patches of several sizes; in one picture of four black and white ones, as fine as a marker's cells."""
    height, width = SHAPE
    image = np.full(SHAPE, generator.uniform(70.0, 160.0), np.float32)
    clutter = generator.uniform(0.0, 40.0)
    for scale in (5, 16, 60):
        patches = generator.normal(0.0, clutter, (height // scale + 2, width // scale + 2)).astype(np.float32)
        kind = cv2.INTER_NEAREST if scale == 16 else cv2.INTER_LINEAR
        image += cv2.resize(patches, (width, height), interpolation=kind)
    if generator.random() < 0.25:
        scale = int(generator.integers(3, 14))
        cells = (generator.random((height // scale + 2, width // scale + 2)) < generator.uniform(0.2, 0.6)) * 170.0
        image = image * 0.3 + cv2.resize(cells.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST)
    return np.clip(image, 15.0, 235.0)


def _paste(canvas: Floats, texture: Image, centre: Vector, generator: np.random.Generator) -> Vector:
    """Draw ``texture`` on white paper about ``centre`` (2,); the box (4,) around it without the paper."""
    rim = round(generator.uniform(0.4, 1.5) * texture.shape[0] / 6.0)
    paper = cv2.copyMakeBorder(texture, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=255)
    size = float(np.exp(generator.uniform(np.log(12.0), np.log(80.0))))
    tilt, roll = generator.uniform(-0.9, 0.9, 2), generator.uniform(-np.pi, np.pi)
    turn = cv2.Rodrigues(np.array((*tilt, 0.0)))[0] @ cv2.Rodrigues(np.array((0.0, 0.0, roll)))[0]
    reach = np.array((0.5, 0.5 * paper.shape[0] / texture.shape[0]))
    square = np.array(((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)))
    inner, outer = (
        (s[:, :2] / (1.0 + 0.15 * s[:, 2:])) * size + centre for s in reach[:, None, None] * (square @ turn.T)
    )
    x0, y0 = np.maximum(np.floor(outer.min(axis=0)).astype(int) - 1, 0)
    x1, y1 = np.minimum(np.ceil(outer.max(axis=0)).astype(int) + 2, (SHAPE[1], SHAPE[0]))
    edge = paper.shape[0] - 0.5
    source = np.array(((-0.5, -0.5), (edge, -0.5), (edge, edge), (-0.5, edge)), np.float32)
    target = ((outer - (x0, y0) + 0.5) * FINE - 0.5).astype(np.float32)
    warp = cv2.getPerspectiveTransform(source, target)
    fine = int(FINE * (x1 - x0)), int(FINE * (y1 - y0))
    drawn = cv2.warpPerspective(paper, warp, fine, flags=cv2.INTER_LINEAR)
    mask = cv2.fillConvexPoly(np.zeros(fine[::-1], np.uint8), np.round(target).astype(np.int32), 255)
    light, share = (
        cv2.resize(part, (int(x1 - x0), int(y1 - y0)), None, 0.0, 0.0, cv2.INTER_AREA).astype(np.float32) / 255.0
        for part in (np.minimum(drawn, mask), mask)
    )
    ink = BLACK * share + (WHITE - BLACK) * light
    canvas[y0:y1, x0:x1] += ink - share * canvas[y0:y1, x0:x1]
    return np.concatenate((inner.min(axis=0), inner.max(axis=0)))


@cache
def _noise() -> Floats:
    """White noise, of which each picture gets a part."""
    return np.random.default_rng(0).standard_normal((SHAPE[0] + 256, SHAPE[1] + 256), np.float32)


def _exposed(canvas: Floats, generator: np.random.Generator) -> Image:
    """What a sensor makes of ``canvas``."""
    height, width = SHAPE
    fall = generator.uniform(-0.25, 0.25, 2).astype(np.float32)
    x, y = np.linspace(-1.0, 1.0, width, dtype=np.float32), np.linspace(-1.0, 1.0, height, dtype=np.float32)
    light = fall[0] * x + fall[1] * y[:, None]
    light += 1.0
    light *= np.float32(generator.uniform(0.3, 1.0)) / light.max()
    light *= canvas
    canvas = light
    blur = generator.uniform(0.0, 6.0)
    if generator.random() < 0.5:
        canvas = np.asarray(cv2.filter2D(canvas, -1, streak(blur, generator.uniform(0.0, np.pi))), np.float32)
    elif blur > 0.2:
        canvas = np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.5 * blur), np.float32)
    dx, dy = generator.integers(0, 256, 2)
    canvas += np.float32(generator.uniform(1.0, 8.0)) * _noise()[dy : dy + height, dx : dx + width]
    image = np.asarray(cv2.convertScaleAbs(np.maximum(canvas, 0.0)), np.uint8)
    quality = int(generator.choice((0, 40, 80)))
    if quality:
        packed = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)
    return image
