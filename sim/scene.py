"""What the simulated cameras look at: gates with their markers, obstacles and the ground, from the true track.

Everything solid is a flat quad. A gate is one thin quad with a square hole, whose coordinates (s, t) are the
gate's y and z; a box is its six faces. A cylinder is the upright quad between the two lines at which who looks at it
sees its sides end, and at each end some rectangles that fill its disc. Brightness is in grey levels (0..255) of the
camera.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.track import Box, Cylinder, Gate, GateShape, Track

NOT_DRAWN = -1.0
"""Shade of a side that cannot be seen."""

FRAME_SHADE = 96.0
BACK_SHADE = 68.0
BOX_SHADE = 120.0
SIDE_SHADES = np.array([0.75, 0.9, 1.2])
"""Of `BOX_SHADE` on sides that face along x, y and z."""
END_QUADS = 6
"""Rectangles that an end of a cylinder is made of: they lack 9 % of its area."""
MARKER_WHITE = (185.0, 220.0)
MARKER_BLACK = (22.0, 42.0)


class Quads(NamedTuple):
    """Flat rectangles, perhaps with a hole; n of them."""

    origin: Vector
    """(n, 3) m, world: where (s, t) is zero."""
    along: Vector
    """(n, 3) unit, world: the direction of s."""
    up: Vector
    """(n, 3) unit, world: the direction of t. The front is seen by who looks along ``along`` × ``up``."""
    bounds: Vector
    """(n, 4) m: s from, s to, t from, t to; what would be underground is cut off."""
    hole: Vector
    """(n, 4) m: the same of the opening; s from > s to where there is none."""
    shade: Vector
    """(n, 2) grey levels of the front and the back; `NOT_DRAWN` where it cannot be seen."""
    boards: NDArray[np.int64]
    """(n, 2): the quad's boards are those from .. to of `Boards`."""


class Boards(NamedTuple):
    """Markers on white boards on the front of quads; m of them."""

    quad: NDArray[np.int64]
    """(m,) index of the quad."""
    ids: NDArray[np.int64]
    """(m,) marker ids."""
    look: Vector
    """(m, 6): s, t of the middle; sides of the black square and of the white board, all m; black, white level."""
    black: Vector
    """(m, k + 1, k + 1) cells²: black area below and to the lower s of each grid point, indexed by t, s."""
    corners: Vector
    """(m, 4, 3) m, world: in the order of `MarkerDetection`."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that can be seen."""

    quads: Quads
    """As seen from afar along x."""
    boards: Boards
    seed: int
    """Varies brightness, contrast and the ground."""
    pillars: Vector
    """(k, 4): the cylinders' upright quads, and the x, y and radius of each, m."""

    @classmethod
    def from_track(cls, track: Track, seed: int = 0) -> "Scene":
        """The scene of the true ``track``."""
        rng = np.random.default_rng(seed)
        dictionary = marker_dictionary(track.gate.dictionary)
        frames = [_gate_quad(gate, track.gate, rng) for gate in track.gates]
        solids, pillars = list(frames), []
        for obstacle in track.obstacles:
            drawn = _box_faces(obstacle) if isinstance(obstacle, Box) else _cylinder_faces(obstacle)
            faces = [face for face in drawn if face.bounds[2] < face.bounds[3]]
            if faces and isinstance(obstacle, Cylinder):
                pillars.append((len(solids), *obstacle.base[:2], obstacle.radius))
            solids += faces
        return cls(
            _stack(solids, track.gate.marker_count, len(frames)),
            _make_boards(track, dictionary, rng),
            seed,
            np.array(pillars, float).reshape(-1, 4),
        )

    def seen_from(self, eye: Vector) -> Quads:
        """The quads with each cylinder turned towards ``eye`` (3,) m, world, between its tangents from there."""
        if not len(self.pillars):
            return self.quads
        which, r = self.pillars[:, 0].astype(int), self.pillars[:, 3]
        towards = eye[:2] - self.pillars[:, 1:3]
        away = np.maximum(np.hypot(towards[:, 0], towards[:, 1]), 1e-9)
        towards /= away[:, None]
        nearer = np.minimum(r / away, 1.0)
        half = r * np.sqrt(1.0 - np.square(nearer))
        origin, along, bounds = self.quads.origin.copy(), self.quads.along.copy(), self.quads.bounds.copy()
        origin[which, :2] = self.pillars[:, 1:3] + (r * nearer)[:, None] * towards
        along[which, 0], along[which, 1] = towards[:, 1], -towards[:, 0]
        bounds[which, 0], bounds[which, 1] = -half, half
        return self.quads._replace(origin=origin, along=along, bounds=bounds)


def marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's predefined ArUco dictionary ``name`` (without DICT_)."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


def marker_cells(dictionary: cv2.aruco.Dictionary, marker_id: int) -> NDArray[np.bool_]:
    """(k, k) which cells of a marker are black, its border included, from the top left."""
    cells: NDArray[np.bool_] = cv2.aruco.generateImageMarker(dictionary, marker_id, dictionary.markerSize + 2) < 128
    return cells


def board_side(shape: GateShape, cells: int) -> float:
    """Side in m of the white board: a quiet zone of one cell around the marker, if the border has room for it."""
    return min(shape.border, shape.marker_size * (1.0 + 2.0 / cells))


class _Quad(NamedTuple):
    origin: Vector
    along: Vector
    up: Vector
    bounds: tuple[float, float, float, float]
    hole: tuple[float, float, float, float]
    shade: tuple[float, float]


_NO_HOLE = (1.0, -1.0, 1.0, -1.0)
_UP = np.array([0.0, 0.0, 1.0])


def _gate_quad(gate: Gate, shape: GateShape, rng: np.random.Generator) -> _Quad:
    inner = 0.5 * shape.opening
    outer = inner + shape.border
    left = np.array([-np.sin(gate.yaw), np.cos(gate.yaw), 0.0])
    bottom = max(-outer, -gate.position[2])
    gain = rng.uniform(0.85, 1.15)
    return _Quad(
        np.array(gate.position),
        left,
        _UP,
        (-outer, outer, bottom, outer),
        (-inner, inner, -inner, inner),
        (gain * FRAME_SHADE, gain * BACK_SHADE),
    )


def _box_faces(box: Box) -> Iterator[_Quad]:
    centre, half = np.array(box.centre), 0.5 * np.array(box.size)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            outward = np.zeros(3)
            outward[axis] = sign
            up = _UP if axis < 2 else np.array([1.0, 0.0, 0.0])
            width, height = np.abs(np.cross(up, outward)) @ half, np.abs(up) @ half
            yield _face(centre + half[axis] * outward, outward, up, float(width), float(height))


def _cylinder_faces(cylinder: Cylinder) -> Iterator[_Quad]:
    """The upright quad first."""
    half, r = 0.5 * cylinder.height, cylinder.radius
    centre = np.array(cylinder.base) + half * _UP
    yield _face(centre, np.array([-1.0, 0.0, 0.0]), _UP, r, half)
    for sign in (-1.0, 1.0):
        for i in range(END_QUADS):
            angle = 0.5 * math.pi * (i + 0.5) / END_QUADS
            width, height = r * math.cos(angle), r * math.sin(angle)
            yield _face(centre + sign * half * _UP, sign * _UP, np.array([1.0, 0.0, 0.0]), width, height)


def _face(middle: Vector, outward: Vector, up: Vector, width: float, height: float) -> _Quad:
    """A face seen from ``outward``, ``width`` m to both sides and ``height`` m up and down from its ``middle``.

    Where it would be underground it is cut off: an upright one in part, a level one whole, so that nothing is left.
    """
    bottom = -height
    if outward[2] == 0.0:
        bottom = max(bottom, -float(middle[2]))
    elif middle[2] <= 0.0:
        height = bottom
    shade = BOX_SHADE * float(SIDE_SHADES @ np.square(outward))
    return _Quad(middle, np.cross(outward, up), up, (-width, width, bottom, height), _NO_HOLE, (shade, NOT_DRAWN))


def _stack(quads: list[_Quad], per_gate: int, gates: int) -> Quads:
    origin, along, up, bounds, hole, shade = (
        np.array([quad[i] for quad in quads], float).reshape(len(quads), width)
        for i, width in enumerate((3, 3, 3, 4, 4, 2))
    )
    boards = np.zeros((len(quads), 2), np.int64)
    boards[:gates, 0] = per_gate * np.arange(gates)
    boards[:gates, 1] = boards[:gates, 0] + per_gate
    return Quads(origin, along, up, bounds, hole, shade, boards)


def _make_boards(track: Track, dictionary: cv2.aruco.Dictionary, rng: np.random.Generator) -> Boards:
    shape, count = track.gate, track.gate.marker_count
    k = dictionary.markerSize + 2
    ids = [marker for gate in track.gates for marker in gate.markers]
    m = len(ids)
    black = np.zeros((m, k + 1, k + 1))
    for i, marker in enumerate(ids):
        cells = marker_cells(dictionary, marker)[::-1, ::-1]
        black[i, 1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    local = shape.marker_corners()
    corners = np.empty((len(track.gates), count, 4, 3))
    for i, gate in enumerate(track.gates):
        left = np.array([-np.sin(gate.yaw), np.cos(gate.yaw), 0.0])
        corners[i] = np.array(gate.position) + local[..., 1:2] * left + local[..., 2:] * _UP
    look = np.column_stack(
        [
            np.tile(local.mean(axis=1)[:, 1:], (len(track.gates), 1)),
            np.full(m, shape.marker_size),
            np.full(m, board_side(shape, k)),
            rng.uniform(*MARKER_BLACK, m),
            rng.uniform(*MARKER_WHITE, m),
        ]
    )
    return Boards(
        np.repeat(np.arange(len(track.gates)), count),
        np.array(ids, np.int64),
        look,
        black,
        corners.reshape(m, 4, 3),
    )
