"""A drawing of how markers are mounted on a gate, with dimensions, as it is seen on approach."""

import math

from flightapp.frames import Vector
from flightapp.printing.markers import module_boxes
from flightapp.printing.page import Box, Fill, Line, Page, Shape, Text
from flightapp.printing.sheets import MARGIN, foot
from flightapp.track import GateShape, MarkedGate, Track

SPACE = 34.0
"""mm around the gate, for dimensions."""
ARROW = 1.8
HEAD = 22.0
PLACES = {1: ("top",), 4: ("top left", "top right", "bottom right", "bottom left")}


class _View:
    """From metres in the gate's plane to millimetres on paper."""

    def __init__(self, shape: GateShape, paper: tuple[float, float]) -> None:
        reach = 0.5 * shape.opening + shape.border
        width = paper[0] - 2.0 * (MARGIN + SPACE)
        self.reach, self.scale = reach, width / (2.0 * reach)
        self.middle = 0.5 * paper[0], MARGIN + HEAD + 0.5 * SPACE + 0.5 * width

    def at(self, y: float, z: float) -> tuple[float, float]:
        """Of a point ``y`` m to the left and ``z`` m above the gate's centre."""
        return self.middle[0] - self.scale * y, self.middle[1] - self.scale * z

    def square(self, half: float) -> tuple[Line, ...]:
        """A square around the centre, each side 2 ``half`` m."""
        (x0, y0), (x1, y1) = self.at(half, half), self.at(-half, -half)
        corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        return tuple(Line(*a, *b, 0.4) for a, b in zip(corners, corners[1:] + corners[:1], strict=True))


def mounting_page(track: Track, gate: MarkedGate, paper: tuple[float, float]) -> Page:
    """How ``gate`` of ``track`` carries its markers; the drawing is not to scale with the paper, its numbers count."""
    shape = track.gate
    view = _View(shape, paper)
    corners = shape.marker_corners()
    shapes: list[Shape] = [
        Text(MARGIN, MARGIN + 6.0, 5.0, f"{track.name}: gate {gate.id}, seen on approach (fly into the page)"),
        Text(MARGIN, MARGIN + 12.0, 3.2, _told(shape)),
        Text(
            MARGIN,
            MARGIN + 17.0,
            3.2,
            "The black square counts, not the edge of the paper. All markers face the approach.",
        ),
        *view.square(0.5 * shape.opening + shape.border),
        *view.square(0.5 * shape.opening),
    ]
    for marker, quad in zip(gate.markers, corners, strict=True):
        shapes += _marker(view, shape, marker, quad)
    shapes += _dimensions(view, shape, corners)
    y = view.middle[1] + view.scale * view.reach + SPACE + 4.0
    for place, marker, quad in zip(PLACES[len(corners)], gate.markers, corners, strict=True):
        centre = 1e3 * quad.mean(axis=0)
        side = "left" if centre[1] > 0.0 else "right"
        across = f"{abs(centre[1]):.0f} mm to the {side}, " if abs(centre[1]) > 0.5 else ""
        up = "up" if centre[2] > 0.0 else "down"
        words = f"{place}: id {marker}, its centre {across}{abs(centre[2]):.0f} mm {up} from the opening's centre"
        shapes.append(Text(MARGIN, y, 3.6, words))
        y += 5.2
    return Page(*paper, (*shapes, *foot(paper, "the drawing is not to scale with the paper: its numbers count")))


def _told(shape: GateShape) -> str:
    return (
        f"Opening {1e3 * shape.opening:.0f} mm square, frame {1e3 * shape.border:.0f} mm wide; markers"
        f" {shape.dictionary}, black square {1e3 * shape.marker_size:g} mm."
    )


def _marker(view: _View, shape: GateShape, marker: int, quad: Vector) -> list[Shape]:
    x, y = view.at(quad[0, 1], quad[0, 2])
    size = view.scale * shape.marker_size
    room = 0.5 * view.scale * (shape.border - shape.marker_size)
    text = min(max(0.75 * room, 1.5), 4.0)
    return [
        Fill(module_boxes(shape.dictionary, marker, x, y, size)),
        Text(x + 0.5 * size, y + size + 0.85 * text, text, f"id {marker}", middle=True),
        Text(x + 0.5 * size, y - 0.25 * text, text, "top", middle=True),
    ]


def _dimensions(view: _View, shape: GateShape, corners: Vector) -> list[Shape]:
    """The opening, the frame and where the markers are, each on a line of its own beside the gate."""
    half, reach = 0.5 * shape.opening, view.reach
    first, high = corners[0, :, 1], float(corners.mean(axis=1)[:, 2].max())
    shapes = _level(view, -half, half, -reach, 10.0, f"opening {1e3 * shape.opening:.0f}")
    shapes += _level(view, -reach, -half, reach, -10.0, f"frame {1e3 * shape.border:.0f}")
    shapes += _level(view, float(first.min()), float(first.max()), reach, -10.0, f"black {1e3 * shape.marker_size:g}")
    if len(corners) > 1:
        shapes += _level(view, -high, high, -reach, 20.0, f"marker centres {2e3 * high:.0f}")
        shapes += _upright(view, -high, high, 16.0, f"{2e3 * high:.0f}", "between", "centres")
    else:
        shapes += _upright(view, 0.0, high, 16.0, f"{1e3 * high:.0f}", "centre to", "centre")
    x, y = view.middle
    cross = 4.0
    return [
        *shapes,
        Line(x - cross, y, x + cross, y),
        Line(x, y - cross, x, y + cross),
        Text(x + 2, y - 2, 3.0, "centre"),
    ]


def _level(view: _View, y0: float, y1: float, z: float, below: float, words: str) -> list[Shape]:
    """From ``y0`` to ``y1`` m, ``below`` mm under the height ``z``; above it where that is negative."""
    (xa, base), (xb, _) = view.at(y1, z), view.at(y0, z)
    line = base + below
    down = math.copysign(1.0, below)
    ends = [Line(x, base + down, x, line + 1.5 * down, 0.15) for x in (xa, xb)]
    boxes: tuple[Box, ...] = ((xa, line - 0.4, ARROW, 0.8), (xb - ARROW, line - 0.4, ARROW, 0.8))
    return [*ends, Line(xa, line, xb, line), Fill(boxes), Text(0.5 * (xa + xb), line - 1.4, 3.4, words, middle=True)]


def _upright(view: _View, z0: float, z1: float, beside: float, *words: str) -> list[Shape]:
    """From ``z0`` to ``z1`` m, ``beside`` mm to the right of the gate."""
    (base, ya), (_, yb) = view.at(-view.reach, z1), view.at(-view.reach, z0)
    line = base + beside
    ends = [Line(base + 1.0, y, line + 1.5, y, 0.15) for y in (ya, yb)]
    boxes: tuple[Box, ...] = ((line - 0.4, ya, 0.8, ARROW), (line - 0.4, yb - ARROW, 0.8, ARROW))
    texts = [Text(line + 2.0, 0.5 * (ya + yb) + 4.2 * i, 3.4, word) for i, word in enumerate(words)]
    return [*ends, Line(line, ya, line, yb), Fill(boxes), *texts]
