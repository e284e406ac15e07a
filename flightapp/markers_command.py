"""What `flightapp markers` prints: the markers of a track's gates, markers by their ids, and calibration boards."""

import re
from collections.abc import Sequence
from pathlib import Path

from flightapp.calibration.board import Board
from flightapp.inputs import BadInputError
from flightapp.printing.markers import Marker, board_shapes, cut_marks, marker_shapes, modules
from flightapp.printing.mounting import PLACES, mounting_page
from flightapp.printing.page import PAPER, Page, shifted
from flightapp.printing.pdf import pdf
from flightapp.printing.sheets import Block, paper_size, sheets
from flightapp.printing.svg import svg
from flightapp.track import Track

_RANGE = re.compile(r"(\d+)(?:-(\d+))?")


def track_pages(track: Track, page: str, tile: bool, quiet: float | None = None) -> list[Page]:
    """How each gate of ``track`` carries its markers, then these; ``quiet`` is the white zone's width in mm.

    Raises `BadInputError`.
    """
    if not track.passage:
        raise BadInputError(f"track '{track.name}' has no gates, so no markers; name a track with gates")
    shape = track.gate
    size, paper = 1e3 * shape.marker_size, paper_size(page)
    room = 0.5 * (1e3 * shape.border - size)
    least = size / len(modules(shape.dictionary, 0))
    if quiet is None and room < 0.5 * least:
        raise BadInputError(
            f"track '{track.name}': a frame of {1e3 * shape.border:g} mm leaves {room:g} mm of white around markers,"
            f" which need {least:g} mm; make marker_size smaller or border wider, or give --quiet"
        )
    zone = min(room, least) if quiet is None else quiet
    pages = [mounting_page(track, gate, min(paper, PAPER["A3"])) for gate in track.passage]
    markers = [
        Marker(shape.dictionary, marker, size, zone, f"gate {gate.id} {place}")
        for gate in track.passage
        for marker, place in zip(gate.markers, PLACES[shape.marker_count], strict=True)
    ]
    return pages + sheets([_block(marker) for marker in markers], paper, tile)


def id_pages(
    ids: Sequence[int], dictionary: str, size: float, page: str, tile: bool, quiet: float | None = None
) -> list[Page]:
    """Markers by their ``ids``, of ``size`` mm with a white zone of ``quiet`` mm; raises `BadInputError`."""
    if not 2.0 <= size <= 2000.0:
        raise BadInputError(f"--size {size:g}: a marker's black square has 2 to 2000 mm")
    paper = paper_size(page)
    zone = size / len(modules(dictionary, 0)) if quiet is None else quiet
    return sheets([_block(Marker(dictionary, marker, size, zone)) for marker in ids], paper, tile)


def board_pages(board: Board, page: str, tile: bool) -> list[Page]:
    """A calibration board, with the white around it that its outer markers need; raises `BadInputError`."""
    rim = 1e3 * 0.5 * (board.square - board.marker)
    width, height = (1e3 * side + 2.0 * rim for side in board.size)
    shapes = (*shifted(board_shapes(board), rim, rim), *cut_marks(width, height))
    return sheets([Block(width, height, shapes, str(board))], paper_size(page), tile)


def _block(marker: Marker) -> Block:
    if marker.quiet < 0.0:
        raise BadInputError(f"--quiet {marker.quiet:g}: the white zone's width is 0 mm or more")
    name = f"{marker.dictionary} id {marker.marker_id}, black square {marker.size:g} mm"
    return Block(marker.side, marker.side + marker.strip, marker_shapes(marker), name)


def parse_ids(text: str) -> tuple[int, ...]:
    """The ids in "0-3,7"; raises `BadInputError`."""
    ids: list[int] = []
    for part in text.split(","):
        form = _RANGE.fullmatch(part.strip())
        if form is None or int(form[2] or form[1]) < int(form[1]) or int(form[2] or form[1]) - int(form[1]) > 3000:
            raise BadInputError(f"ids '{text}': give numbers and ranges, such as 0-3,7")
        ids += range(int(form[1]), int(form[2] or form[1]) + 1)
    return tuple(dict.fromkeys(ids))


def write_pages(pages: Sequence[Page], out: Path) -> list[Path]:
    """Write ``pages`` as their suffix says: one .pdf, or a numbered .svg each; the files. Raises `BadInputError`."""
    if out.suffix not in (".pdf", ".svg"):
        raise BadInputError(f"--out {out}: pages are written as .pdf or .svg")
    if out.suffix == ".pdf":
        files = {out: pdf(pages)}
    elif len(pages) == 1:
        files = {out: svg(pages[0]).encode()}
    else:
        files = {out.with_name(f"{out.stem}-{i}.svg"): svg(page).encode() for i, page in enumerate(pages, start=1)}
    for path, data in files.items():
        try:
            path.write_bytes(data)
        except OSError as error:
            raise BadInputError(f"--out {path}: cannot be written: {error.strerror or error}") from None
    return list(files)
