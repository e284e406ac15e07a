"""The commands `flightapp markers …`: parse, call one function, print."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import markers_command
from flightapp.calibration.board import Board
from flightapp.commands.options import Columns, Dictionary, MarkerSize, Rows, Square
from flightapp.printing.page import Page
from flightapp.track import load_track

markers = typer.Typer(no_args_is_help=True, help="Print gate markers and calibration boards at their exact size.")
console = Console()

Paper = Annotated[str, typer.Option("--page", help="A4, A3, A2, A1, A0, Letter, Tabloid, or WIDTHxHEIGHT in mm")]
Tile = Annotated[bool, typer.Option("--tile", help="what is larger than the paper in parts, to be glued together")]
Quiet = Annotated[float | None, typer.Option(help="mm of white around a marker; default: one of its modules")]


@markers.callback()
def group() -> None:
    """Print gate markers and calibration boards at their exact size."""


@markers.command()
def track(
    file: Annotated[Path, typer.Argument(help="a track, such as missions/tracks/five_gates.toml")],
    page: Paper = "A4",
    tile: Tile = False,
    quiet: Quiet = None,
    out: Annotated[Path, typer.Option(help="file to write: .pdf, or .svg for one file a page")] = Path("markers.pdf"),
) -> None:
    """The markers of a track's gates, and a drawing of how to mount them on each."""
    _write(markers_command.track_pages(load_track(file), page, tile, quiet), out)


@markers.command()
def ids(
    numbers: Annotated[str, typer.Argument(metavar="IDS", help="numbers and ranges, such as 0-3,7")],
    size: Annotated[float, typer.Option(help="mm, side of the black square")] = 150.0,
    dictionary: Annotated[str, typer.Option(help="OpenCV's, without DICT_")] = "4X4_50",
    page: Paper = "A4",
    tile: Tile = False,
    quiet: Quiet = None,
    out: Annotated[Path, typer.Option(help="file to write: .pdf, or .svg for one file a page")] = Path("markers.pdf"),
) -> None:
    """Markers by their ids."""
    _write(
        markers_command.id_pages(markers_command.parse_ids(numbers), dictionary, size, page, tile, quiet),
        out,
    )


@markers.command()
def board(
    dictionary: Dictionary = "5X5_100",
    columns: Columns = 11,
    rows: Rows = 7,
    square: Square = 24.0,
    marker: MarkerSize = 18.0,
    page: Paper = "A4",
    tile: Tile = False,
    out: Annotated[Path, typer.Option(help="file to write: .pdf, or .svg for one file a page")] = Path("board.pdf"),
) -> None:
    """A ChArUco board, for `flightapp calibrate camera` and `calibrate mount`."""
    _write(markers_command.board_pages(Board(dictionary, columns, rows, 1e-3 * square, 1e-3 * marker), page, tile), out)


def _write(pages: list[Page], out: Path) -> None:
    files = markers_command.write_pages(pages, out)
    size = f"{pages[-1].width:g} × {pages[-1].height:g} mm"
    console.print(f"{len(pages)} pages ({size}): {', '.join(map(str, files))}", highlight=False, soft_wrap=True)
    console.print("print at actual size (100 %, no fitting to the page), and measure the ruler", highlight=False)
