"""Pages of black on white, in millimetres from the top left corner, x to the right and y down."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

Box = tuple[float, float, float, float]
"""x, y, width, height in mm."""


@dataclass(frozen=True, slots=True)
class Fill:
    """Rectangles that are filled together, so that no seam shows where they touch."""

    boxes: tuple[Box, ...]
    grey: float = 0.0
    """0: black, 1: white."""


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line."""

    x1: float
    y1: float
    x2: float
    y2: float
    width: float = 0.2
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Text:
    """A line of text: the left end, or the middle, of its base line is at x, y."""

    x: float
    y: float
    size: float
    """mm, of the font: capitals are 0.72 of it."""
    text: str
    middle: bool = False
    grey: float = 0.0


Shape = Fill | Line | Text


@dataclass(frozen=True, slots=True)
class Page:
    """A sheet of paper; what comes later lies above."""

    width: float
    height: float
    shapes: tuple[Shape, ...]


def shifted(shapes: Iterable[Shape], dx: float, dy: float) -> tuple[Shape, ...]:
    """``shapes``, moved."""
    return tuple(_shifted(shape, dx, dy) for shape in shapes)


def _shifted(shape: Shape, dx: float, dy: float) -> Shape:
    match shape:
        case Fill():
            return replace(shape, boxes=tuple((x + dx, y + dy, w, h) for x, y, w, h in shape.boxes))
        case Line():
            return replace(shape, x1=shape.x1 + dx, y1=shape.y1 + dy, x2=shape.x2 + dx, y2=shape.y2 + dy)
        case Text():
            return replace(shape, x=shape.x + dx, y=shape.y + dy)


def clipped(shapes: Iterable[Shape], window: Box) -> tuple[Shape, ...]:
    """What of ``shapes`` lies in ``window``: rectangles exactly, lines and texts that begin in it whole."""
    left, top, width, height = window
    right, bottom = left + width, top + height
    kept: list[Shape] = []
    for shape in shapes:
        if isinstance(shape, Fill):
            cut = [
                (max(x, left), max(y, top), min(x + w, right) - max(x, left), min(y + h, bottom) - max(y, top))
                for x, y, w, h in shape.boxes
            ]
            if inside := tuple(box for box in cut if box[2] > 0.0 and box[3] > 0.0):
                kept.append(replace(shape, boxes=inside))
        else:
            x, y = (shape.x1, shape.y1) if isinstance(shape, Line) else (shape.x, shape.y)
            if left <= x <= right and top <= y <= bottom:
                kept.append(shape)
    return tuple(kept)


PAPER = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "Letter": (215.9, 279.4),
    "Tabloid": (279.4, 431.8),
}
"""mm, upright."""
