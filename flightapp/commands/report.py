"""The command `flightapp report`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import results
from flightapp.evaluation.tables import rich_table, terminal_tables
from flightapp.inputs import BadInputError
from flightapp.interchange.sources import read_any_flight
from flightapp.time_lost import loss_table, time_lost

console = Console()


def report(
    runs: Annotated[list[Path], typer.Argument(help="run directories, flight.mcap or PX4's .ulg files")],
    compare: Annotated[Path | None, typer.Option(help="FILE.html: a page with all runs overlaid")] = None,
    against: Annotated[
        str | None, typer.Option(help="a planner, such as race: the time lost on each leg against its line")
    ] = None,
    png: Annotated[Path | None, typer.Option(help="directory to write the figures to as PNG, for papers")] = None,
) -> None:
    """Print each flight's tables and write report.html beside its log; a log that cannot be read spoils no other."""
    unreadable = []
    for run in runs:
        try:
            summary, page = results.report(run, png)
        except BadInputError as error:
            unreadable.append(str(error))
            continue
        console.print(*terminal_tables(summary), sep="\n")
        if against is not None:
            lost = time_lost(read_any_flight(run), summary, against)
            console.print(rich_table(loss_table(lost, against)))
        console.print(f"report: {page}", soft_wrap=True)
    if unreadable:
        raise BadInputError("\n".join(unreadable))
    if compare is not None:
        results.compare(runs, compare, png)
        console.print(f"comparison: {compare}", soft_wrap=True)
