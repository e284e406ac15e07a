"""The commands `flightapp metrics` and `flightapp export`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import results
from flightapp.evaluation.alignment import Align
from flightapp.evaluation.paths import MAX_DIFFERENCE
from flightapp.evaluation.tables import rich_table
from flightapp.interchange.compare import Options, compare, comparison_tables, parse_step
from flightapp.interchange.export import Format
from flightapp.interchange.export import export as write
from flightapp.interchange.sources import read_path

Source = "a run, flight.mcap, .ulg, .csv, .tum or a ROS 2 bag; FILE:TOPIC where it holds several paths"


def metrics(
    reference: Annotated[str, typer.Argument(help=f"what is true: {Source}")],
    estimate: Annotated[str, typer.Argument(help="what is to be judged, likewise")],
    align: Annotated[Align | None, typer.Option(help="the motion that is forgiven; all, where not said")] = None,
    rpe: Annotated[str | None, typer.Option(help="relative errors too, over 1s, 5m or 10f (frames)")] = None,
    offset: Annotated[float, typer.Option(help="s to add to the estimate's stamps")] = 0.0,
    max_difference: Annotated[
        float, typer.Option(min=0.0, help="s between stamps that belong together")
    ] = MAX_DIFFERENCE,
    interpolate: Annotated[
        bool, typer.Option("--interpolate", help="read the estimate at the reference's stamps")
    ] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="also write the result here")] = None,
) -> None:
    """Compare two recorded paths: absolute and relative pose errors, as the field tells them."""
    step = None if rpe is None else parse_step(rpe)
    options = Options(align, step, offset, max_difference, interpolate)
    result = compare(read_path(reference), read_path(estimate), options)
    Console().print(*(rich_table(table) for table in comparison_tables(result)), sep="\n")
    results.write_json(json_file, result)


def export(
    run: Annotated[Path, typer.Argument(help="a run directory, flight.mcap or .ulg")],
    to: Annotated[Format, typer.Option("--to", help="csv: a file for each stream; tum: the paths; rosbag2: ROS 2")],
    out: Annotated[Path | None, typer.Option(help="a new directory; default: csv, tum or rosbag2 in the run's")] = None,
) -> None:
    """Write a flight in the formats of other programs."""
    directory = write(run, to, out)
    Console().print(f"written: {directory}", soft_wrap=True, highlight=False)
