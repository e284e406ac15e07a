"""Markers as they are printed: the black modules, the quiet zone around them, cut marks and what is written beside."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.calibration.board import Board, dictionary_size, predefined
from flightapp.inputs import BadInputError
from flightapp.printing.page import Box, Fill, Line, Shape, Text

LABEL = 0.16
"""Size of the label, of the quiet zone's width: it stays in the outermost quarter, so that the rest is white."""
LABEL_LEAST, LABEL_MOST = 2.0, 4.0
"""mm; a quiet zone that is too narrow for the least has its label below the cut."""
CUT = 2.5
"""mm, length of a cut mark, outside the part that is kept."""
LABEL_GREY = 0.45


@dataclass(frozen=True, slots=True)
class Marker:
    """A marker on paper; mm."""

    dictionary: str
    marker_id: int
    size: float
    """Side of the black square."""
    quiet: float
    """Width of the white zone around it."""
    where: str = ""
    """What it is for."""

    @property
    def side(self) -> float:
        """Of what is cut out: the marker with its quiet zone."""
        return self.size + 2.0 * self.quiet

    @property
    def strip(self) -> float:
        """Height of what is written below the cut."""
        return 2.0 * LABEL_LEAST if LABEL * self.quiet < LABEL_LEAST else 0.0


def modules(dictionary: str, marker_id: int) -> NDArray[np.bool_]:
    """Where a marker is black, (n, n) with the border, the top row first; raises `BadInputError`."""
    count = dictionary_size(dictionary)
    if not 0 <= marker_id < count:
        raise BadInputError(f"there is no marker {marker_id} in dictionary {dictionary}, which has 0 to {count - 1}")
    chosen = predefined(dictionary)
    return np.asarray(cv2.aruco.generateImageMarker(chosen, marker_id, int(chosen.markerSize) + 2) < 128, np.bool_)


def module_boxes(dictionary: str, marker_id: int, x: float, y: float, size: float) -> tuple[Box, ...]:
    """The black parts of a marker whose black square has its top left corner at ``x``, ``y``: runs of its rows."""
    black = modules(dictionary, marker_id)
    n = len(black)
    boxes = []
    for row in range(n):
        edges = np.flatnonzero(np.diff(np.concatenate(([False], black[row], [False])).astype(np.int8)))
        for begin, end in edges.reshape(-1, 2).tolist():
            boxes.append((x + size * begin / n, y + size * row / n, size * (end - begin) / n, size / n))
    return tuple(boxes)


def marker_shapes(marker: Marker) -> tuple[Shape, ...]:
    """``marker`` with its quiet zone's top left corner at 0, 0."""
    side, quiet = marker.side, marker.quiet
    size = min(max(LABEL * quiet, LABEL_LEAST), LABEL_MOST)
    words = f"TOP   id {marker.marker_id}   {marker.dictionary}   {marker.size:g} mm"
    words += f"   {marker.where}" if marker.where else ""
    base = side + 0.8 * marker.strip if marker.strip else 1.3 * size
    return (
        Fill(module_boxes(marker.dictionary, marker.marker_id, quiet, quiet, marker.size)),
        Text(0.5 * side, base, size, words.replace("TOP", "UPRIGHT") if marker.strip else words, True, LABEL_GREY),
        *cut_marks(side, side),
    )


def cut_marks(width: float, height: float) -> tuple[Line, ...]:
    """At the corners of what is cut out, outside of it."""
    marks = []
    for x, outwards in ((0.0, -CUT), (width, CUT)):
        for y, down in ((0.0, -CUT), (height, CUT)):
            marks += [Line(x, y, x + outwards, y), Line(x, y, x, y + down)]
    return tuple(marks)


def board_shapes(board: Board) -> tuple[Shape, ...]:
    """A ChArUco ``board`` with its top left corner at 0, 0, as OpenCV lays it out."""
    square = 1e3 * board.square
    places = [1e3 * np.asarray(points, float)[0, :2] for points in board.pattern.getObjPoints()]
    white = {(int(x // square), int(y // square)) for x, y in places}
    squares = [(i, j) for j in range(board.rows) for i in range(board.columns) if (i, j) not in white]
    boxes = [(square * i, square * j, square, square) for i, j in squares]
    ids = np.asarray(board.pattern.getIds()).ravel().tolist()
    for marker_id, (x, y) in zip(ids, places, strict=True):
        boxes += module_boxes(board.dictionary, int(marker_id), float(x), float(y), 1e3 * board.marker)
    return (Fill(tuple(boxes)),)
