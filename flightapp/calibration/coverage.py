"""How well views of a board cover what a calibration needs: the image, tilts to all sides, near and far.

Views are chosen by how new they are, so that standing still adds nothing; what is still missing is told in words.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.calibration.board import Board, View
from flightapp.calibration.intrinsics import Calibration
from flightapp.calibration.lens_guess import in_camera, pose_of
from flightapp.frames import Vector
from flightapp.perception.camera import CameraModel, Lens

Mask = NDArray[np.bool_]
Counts = NDArray[np.int64]

COLUMNS, ROWS = 5, 4
CELL_CORNERS = 6
"""Of the board, that a part of the image must have seen."""
CELLS_SHARE = 0.9
"""Of the parts, that must have been seen."""
VIEWS_MIN, VIEWS_MAX = 15, 80
TILT = math.radians(15.0)
"""From facing the camera, that counts as tilted."""
TILTED = 2
"""Views that must be tilted to each side."""
NEAR_TO_FAR = 1.5
"""By which the board's distance must vary."""
NEW = 0.12
"""Distance from all views before, in the space of `_Look`, from which a view is new."""
FOCAL_ERROR, CENTRE_ERROR = 0.0025, 0.003
"""Greatest standard deviations: share of the focal length, and the principal point's, share of the image's width."""
ERROR_MAX = 1.0
"""px, RMS reprojection beyond which something is wrong with the board, its measures or the images."""
_ACROSS, _DOWN = ("left edge", "left", "middle", "right", "right edge"), ("top edge", "above", "below", "bottom edge")
_SIDES = ("to the left", "to the right", "up", "down")


@dataclass(frozen=True, slots=True)
class _Look:
    """From where the board was seen."""

    place: Vector
    """(2,) its middle, as shares of the image."""
    distance: float
    """m, to its middle."""
    tilt: Vector
    """(2,) sines of its turn to the right and down, away from facing the camera."""

    def apart(self, other: "_Look") -> float:
        """How much of another view it is: 1 is the image's width, a factor of e in distance, or 60° of tilt."""
        place = self.place - other.place
        return math.sqrt(
            float(place @ place)
            + math.log(self.distance / other.distance) ** 2
            + float(np.sum((self.tilt - other.tilt) ** 2))
        )


class Coverage:
    """What views of ``board`` have covered so far, as a camera that is about ``model`` sees them."""

    def __init__(self, board: Board, model: CameraModel) -> None:
        self._board, self._model = board, model
        self._looks: list[_Look] = []
        self._cells = np.zeros((ROWS, COLUMNS), np.int64)

    @property
    def count(self) -> int:
        """Views that were taken."""
        return len(self._looks)

    def take(self, view: View) -> bool:
        """Whether ``view`` is new, and so worth using; then it counts."""
        corners = self._board.corners[view.ids]
        pose = pose_of(self._model, corners, view.pixels)
        if pose is None or len(self._looks) >= VIEWS_MAX:
            return False
        look = self._look(pose, view)
        cells = self._cells_of(view)
        fresh = bool(((self._cells < CELL_CORNERS) & (cells >= CELL_CORNERS // 2)).any())
        if not fresh and any(look.apart(other) < NEW for other in self._looks):
            return False
        self._add(look, cells)
        return True

    @classmethod
    def of(cls, board: Board, found: Calibration) -> "Coverage":
        """What the views of a finished calibration cover, by its own lens and poses."""
        coverage = cls(board, found.model)
        for view, pose in zip(found.views, found.poses, strict=True):
            coverage._add(coverage._look(pose, view), coverage._cells_of(view))
        return coverage

    def _add(self, look: _Look, cells: Counts) -> None:
        self._looks.append(look)
        self._cells += cells

    def explains(self, view: View) -> bool:
        """Whether the lens leaves a pose from which ``view`` may have been taken."""
        return pose_of(self._model, self._board.corners[view.ids], view.pixels) is not None

    def missing(self) -> tuple[str, ...]:
        """What is still to be shown to the camera; empty where nothing is."""
        wanted = []
        unseen = self._needed() & (self._cells < CELL_CORNERS)
        if unseen.sum() > (1.0 - CELLS_SHARE) * self._needed().sum():
            wanted.append("the board in the image's " + ", ".join(_cell_names(unseen)))
        tilts = np.array([look.tilt for look in self._looks]).reshape(-1, 2)
        least = math.sin(TILT)
        counts = [int(np.sum(tilts[:, axis] * sign > least)) for axis in (0, 1) for sign in (-1.0, 1.0)]
        lacking = [side for side, count in zip(_SIDES, counts, strict=True) if count < TILTED]
        if lacking:
            wanted.append(f"the board turned {', '.join(lacking)} by 20° to 45°")
        distances = [look.distance for look in self._looks]
        if not distances or max(distances) < NEAR_TO_FAR * min(distances):
            wanted.append("the board nearer, so that it nearly fills the image, and at twice that distance")
        if self.count < VIEWS_MIN:
            wanted.append(f"{VIEWS_MIN - self.count} more views that differ")
        return tuple(wanted)

    def told(self) -> str:
        """How far it is, in one line."""
        missing = self.missing()
        seen = int(np.sum(self._needed() & (self._cells >= CELL_CORNERS)))
        done = f"{self.count} views, {seen} of {int(self._needed().sum())} parts of the image"
        return f"{done}; still wanted: {'; '.join(missing)}" if missing else f"{done}; nothing is missing"

    def _needed(self) -> Mask:
        """(ROWS, COLUMNS) parts that must be seen: a fisheye's corners may lie outside its image circle."""
        needed = np.ones((ROWS, COLUMNS), bool)
        if self._model.lens is Lens.FISHEYE:
            needed[:: ROWS - 1, :: COLUMNS - 1] = False
        return needed

    def _cells_of(self, view: View) -> Counts:
        """(ROWS, COLUMNS) how many of the view's corners each part of the image shows."""
        across = np.clip((view.pixels[:, 0] * COLUMNS / self._model.width).astype(int), 0, COLUMNS - 1)
        down = np.clip((view.pixels[:, 1] * ROWS / self._model.height).astype(int), 0, ROWS - 1)
        cells = np.zeros((ROWS, COLUMNS), np.int64)
        np.add.at(cells, (down, across), 1)
        return cells

    def _look(self, pose: Vector, view: View) -> _Look:
        board = self._board.corners
        low, high = board.min(axis=0), board.max(axis=0)
        marks = np.array((0.5 * (low + high), (high[0], low[1], 0.0), (low[0], high[1], 0.0), low))
        middle, right, down, first = in_camera(pose, marks)
        right, down = (v / np.linalg.norm(v) for v in (right - first, down - first))
        distance = float(np.linalg.norm(middle))
        ray = middle / distance
        place = view.pixels.mean(axis=0) / (self._model.width, self._model.height)
        return _Look(place, distance, np.array((float(right @ ray), float(down @ ray))))


def shortfalls(board: Board, found: Calibration) -> tuple[str, ...]:
    """Why ``found`` is not to be relied on; empty where it is."""
    wanted = [f"still wanted: {text}" for text in Coverage.of(board, found).missing()]
    focal, centre = found.deviation[:2] / found.model.focal[:2], found.deviation[2:4] / found.model.width
    if not focal.max() < FOCAL_ERROR:
        wanted.append(
            f"the focal length is known to {100.0 * focal.max():.2f} % only (standard deviation; at most"
            f" {100.0 * FOCAL_ERROR:g} %): more tilted views, nearer"
        )
    if not centre.max() < CENTRE_ERROR:
        wanted.append(
            f"the principal point is known to {found.deviation[2:4].max():.1f} px only (standard deviation; at most"
            f" {CENTRE_ERROR * found.model.width:.1f}): views tilted to all sides, and the board turned on its side"
        )
    if found.rms > ERROR_MAX:
        wanted.append(
            f"corners lie {found.rms:.2f} px (RMS) off; the board may be bent, printed to another size than was"
            " said, or the images blurred, or the lens of the other kind (--lens)"
        )
    if len(found.rejected) > len(found.views):
        wanted.append(f"{len(found.rejected)} views did not fit the other {len(found.views)}")
    return tuple(wanted)


def _cell_names(unseen: Mask) -> Sequence[str]:
    names = []
    for row, column in zip(*np.nonzero(unseen), strict=True):
        names.append(f"{_DOWN[row]} / {_ACROSS[column]}")
    return names
