"""ChArUco boards: a chessboard with markers in its white squares, so that a part of it tells which part that is.

Described in OpenCV's documentation of its aruco module; corners are refined between the squares' sides.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.track import GateShape

LEAST_CORNERS = 8
"""Of a view of the board that is worth anything."""
FINEST = 1e-9


@dataclass(frozen=True)
class Board:
    """What is printed: ``columns`` by ``rows`` squares; raises `BadInputError` for what cannot be."""

    dictionary: str = "5X5_100"
    columns: int = 11
    rows: int = 7
    square: float = 0.024
    """m, side of a square."""
    marker: float = 0.018
    """m, side of a marker's black square."""

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise BadInputError(f"a board needs at least 3 × 3 squares, not {self.columns} × {self.rows}")
        if not 0.0 < self.marker < self.square - FINEST:
            raise BadInputError(
                f"a board's markers ({1e3 * self.marker:g} mm) must be smaller than its squares"
                f" ({1e3 * self.square:g} mm)"
            )
        needed, there = self.columns * self.rows // 2, dictionary_size(self.dictionary)
        if needed > there:
            raise BadInputError(
                f"a board of {self.columns} × {self.rows} needs {needed} markers, and dictionary {self.dictionary} has"
                f" {there}; take a larger dictionary or fewer squares"
            )

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in m."""
        return self.columns * self.square, self.rows * self.square

    @cached_property
    def pattern(self) -> Any:
        """OpenCV's board."""
        dictionary = predefined(self.dictionary)
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, dictionary)

    @cached_property
    def corners(self) -> Vector:
        """(n, 3) m: the chessboard's inner corners by their ids; x to the right, y down, z away from the viewer."""
        return np.asarray(self.pattern.getChessboardCorners(), float)

    def __str__(self) -> str:
        return (
            f"ChArUco {self.dictionary}, {self.columns} x {self.rows} squares of {1e3 * self.square:g} mm,"
            f" markers of {1e3 * self.marker:g} mm"
        )


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A board in one image."""

    name: str
    """Of the image."""
    stamp: float
    ids: NDArray[np.int64]
    """(n,) of the corners that were seen."""
    pixels: Vector
    """(n, 2)."""


class BoardFinder:
    """Finds ``board`` in images."""

    def __init__(self, board: Board) -> None:
        self.board = board
        parameters = cv2.aruco.CharucoParameters()
        self._detector = cv2.aruco.CharucoDetector(board.pattern, parameters)

    def find(self, image: NDArray[np.uint8], name: str = "", stamp: float = 0.0) -> View | None:
        """The board in a grey ``image`` (h, w); None where not enough of it is seen."""
        corners, ids, _, _ = self._detector.detectBoard(image)
        if ids is None or len(ids) < LEAST_CORNERS:
            return None
        numbers = np.asarray(ids, np.int64).ravel()
        grid = np.stack((numbers % (self.board.columns - 1), numbers // (self.board.columns - 1)))
        if min(len(set(row.tolist())) for row in grid) < 2:
            return None  # all on one line, which tells no pose
        return View(name, stamp, numbers, np.asarray(corners, float).reshape(-1, 2))


def predefined(name: str) -> Any:
    """OpenCV's dictionary ``name``; raises `BadInputError`."""
    dictionary_size(name)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


def dictionary_size(name: str) -> int:
    """How many markers the dictionary ``name`` has; raises `BadInputError`."""
    try:
        return GateShape(dictionary=name).dictionary_size
    except ValueError:
        raise BadInputError(
            f"there is no marker dictionary '{name}'; known are 4X4_50 to 7X7_1000 (bits: 4 to 7, markers: 50, 100, 250"
            " or 1000), ARUCO_ORIGINAL, ARUCO_MIP_36h12 and APRILTAG_16h5, 25h9, 36h10 and 36h11"
        ) from None
