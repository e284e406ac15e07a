"""Blocks, such as markers, on sheets of paper: several on one, or one on several; with a ruler to check the print."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from flightapp.inputs import BadInputError
from flightapp.printing.markers import CUT, cut_marks
from flightapp.printing.page import PAPER, Box, Line, Page, Shape, Text, clipped, shifted

MARGIN = 8.0
"""mm, which printers leave white."""
FOOT = 16.0
"""mm, for the ruler and what is written."""
GAP = 2.0 * CUT + 1.0
"""mm between blocks, for the cut marks of both."""
OVERLAP = 10.0
"""mm that neighbouring parts of a block in several parts have in common, to be glued."""
RULER = 100.0
CHECK = "print at actual size (100 %); this ruler must measure 100 mm"
_CUSTOM = re.compile(r"(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)")


@dataclass(frozen=True, slots=True)
class Block:
    """What belongs together, with its top left corner at 0, 0; mm."""

    width: float
    height: float
    shapes: tuple[Shape, ...]
    name: str


def paper_size(text: str) -> tuple[float, float]:
    """Width and height in mm of the paper ``text``, upright; raises `BadInputError`."""
    for name, size in PAPER.items():
        if name.lower() == text.lower():
            return size
    if (form := _CUSTOM.fullmatch(text)) is not None:
        width, height = float(form[1]), float(form[2])
        if min(width, height) >= RULER + 2.0 * MARGIN and max(width, height) <= 5000.0:
            return min(width, height), max(width, height)
        raise BadInputError(f"--page {text}: between {RULER + 2.0 * MARGIN:g} and 5000 mm, so that the ruler fits")
    raise BadInputError(f"--page {text}: is none of {', '.join(PAPER)}; or give WIDTHxHEIGHT in mm, such as 420x594")


def sheets(blocks: Sequence[Block], paper: tuple[float, float], tile: bool = False) -> list[Page]:
    """``blocks`` on as few pages as they fit on in a grid, or each on several with ``tile``.

    Raises `BadInputError` where one does not fit on the paper, upright or across.
    """
    if not blocks:
        raise BadInputError("there is nothing to print: no marker was named")
    width, height = max(b.width for b in blocks), max(b.height for b in blocks)
    upright, across = paper, paper[::-1]
    page = max((upright, across), key=lambda size: math.prod(_grid(size, width, height)))
    columns, rows = _grid(page, width, height)
    if columns * rows:
        each = columns * rows
        return [_page(page, blocks[i : i + each], columns, width, height) for i in range(0, len(blocks), each)]
    if tile:
        return [part for block in blocks for part in _parts(block, paper)]
    fits = [name for name, size in PAPER.items() if math.prod(_grid(size, width, height))]
    other = f"--page {fits[0]}, " if fits else ""
    raise BadInputError(
        f"{blocks[0].name} is {width:g} × {height:g} mm with what belongs to it, which does not fit on"
        f" {paper[0]:g} × {paper[1]:g} mm; take {other}--page WIDTHxHEIGHT for a plotter, or --tile for parts"
    )


def _grid(page: tuple[float, float], width: float, height: float) -> tuple[int, int]:
    """Columns and rows of blocks of ``width`` by ``height``."""
    room = page[0] - 2.0 * MARGIN, page[1] - 2.0 * MARGIN - FOOT
    return max(int((room[0] + GAP) // (width + GAP)), 0), max(int((room[1] + GAP) // (height + GAP)), 0)


def _page(size: tuple[float, float], blocks: Sequence[Block], columns: int, width: float, height: float) -> Page:
    used = min(columns, len(blocks))
    left = 0.5 * (size[0] - used * width - (used - 1) * GAP)
    shapes: list[Shape] = []
    for i, block in enumerate(blocks):
        x = left + (i % columns) * (width + GAP)
        y = MARGIN + (i // columns) * (height + GAP)
        shapes += shifted(block.shapes, x, y)
    names = "; ".join(dict.fromkeys(block.name for block in blocks)) if len(blocks) == 1 else f"{len(blocks)} pieces"
    return Page(*size, (*shapes, *foot(size, names)))


def foot(size: tuple[float, float], words: str) -> tuple[Shape, ...]:
    """The ruler and ``words`` at the foot of a page of ``size``."""
    x, y = MARGIN, size[1] - MARGIN - 6.0
    ticks = [Line(x + mm, y, x + mm, y - (4.0 if mm % 50 == 0 else 2.5 if mm % 10 == 0 else 1.2)) for mm in range(101)]
    numbers = [Text(x + mm, y + 3.2, 2.6, f"{mm}", middle=True) for mm in range(0, 101, 10)]
    return (
        Line(x, y, x + RULER, y),
        *ticks,
        *numbers,
        Text(x, y + 6.6, 2.6, CHECK),
        Text(x, y - 5.6, 3.0, words),
    )


def _parts(block: Block, paper: tuple[float, float]) -> list[Page]:
    """``block`` in parts that overlap; each shows which it is and where it goes on."""
    pages: dict[tuple[float, float], list[Box]] = {size: _windows(block, size) for size in (paper, paper[::-1])}
    size = min(pages, key=lambda page: len(pages[page]))
    made, windows = [], pages[size]
    columns = len({window[0] for window in windows})
    for i, (x, y, w, h) in enumerate(windows):
        inner = shifted(clipped(block.shapes, (x, y, w, h)), MARGIN + CUT - x, MARGIN + CUT - y)
        marks = shifted(cut_marks(w, h), MARGIN + CUT, MARGIN + CUT)
        place = f"row {i // columns + 1} of {len(windows) // columns}, column {i % columns + 1} of {columns}"
        words = f"{block.name}: {place}; parts overlap by {OVERLAP:g} mm: cut at the marks, lay one over the other"
        made.append(Page(*size, (*inner, *marks, *foot(size, words))))
    return made


def _windows(block: Block, size: tuple[float, float]) -> list[Box]:
    """Parts of equal size, row by row, that fit on a page of ``size``."""
    room = size[0] - 2.0 * (MARGIN + CUT), size[1] - 2.0 * (MARGIN + CUT) - FOOT
    columns, width = _split(block.width, room[0])
    rows, height = _split(block.height, room[1])
    across, down = width - OVERLAP, height - OVERLAP
    return [(i * across, j * down, width, height) for j in range(rows) for i in range(columns)]


def _split(length: float, room: float) -> tuple[int, float]:
    """In how many parts, and how long each is, so that they overlap and none is longer than ``room``."""
    count = 1 if length <= room else math.ceil((length - OVERLAP) / (room - OVERLAP))
    return count, (length + (count - 1) * OVERLAP) / count
