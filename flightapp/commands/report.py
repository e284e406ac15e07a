"""The command `flightapp report`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import results
from flightapp.evaluation.tables import terminal_tables

console = Console()


def report(
    runs: Annotated[list[Path], typer.Argument(help="run directories or flight.mcap files")],
) -> None:
    """Print each flight's tables and write report.html beside its log."""
    for run in runs:
        summary, page = results.report(run)
        console.print(*terminal_tables(summary), sep="\n")
        console.print(f"report: {page}", soft_wrap=True)
