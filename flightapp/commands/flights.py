"""What the commands have in common that fly many times."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from flightapp import app
from flightapp.campaign.fly import Where
from flightapp.campaign.run import Run
from flightapp.evaluation.grid import Grid, combinations, label
from flightapp.evaluation.sweep_page import FAILURES, failure_lines
from flightapp.evaluation.tables import TextTable, rich_table
from flightapp.inputs import BadInputError

Runs = Annotated[int, typer.Option(min=1, help="flights of each combination")]
FirstSeed = Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")]
Workers = Annotated[int, typer.Option(min=1, help="processes")]
Scheduler = Annotated[
    str | None, typer.Option(help="tcp://HOST:PORT of a Dask cluster, instead of processes of this computer")
]
Out = Annotated[Path | None, typer.Option(help="directory for each flight's result; what is there is not flown again")]
HtmlFile = Annotated[Path | None, typer.Option("--html", help="also write a page with plots and tables here")]


def runs_of(plan: app.FlightPlan, grid: Grid, runs: int) -> list[Run]:
    """``runs`` flights of each combination of ``grid``, with the seeds from that of ``plan`` on."""
    flights = []
    for chosen in combinations(grid):
        settings = (*plan.overrides, *(f"{key}={value}" for key, value in chosen))
        for seed in range(plan.seed, plan.seed + runs):
            one = replace(plan, overrides=settings, seed=seed)
            flights.append(Run(one, f"{plan.mission.stem} {label(chosen)}".strip(), chosen))
    return flights


def tell(console: Console, tables: Sequence[TextTable], summary: dict[str, Any]) -> None:
    """Print ``tables`` but that of failures, and these so that their commands can be copied."""
    console.print(*(rich_table(table) for table in tables if not table.title.startswith(FAILURES)), sep="\n")
    for line in failure_lines(summary):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def where(workers: int, scheduler: str | None, out: Path | None) -> Where:
    """Where flights are flown, as the command line says; raises `BadInputError`."""
    if out is not None and out.exists() and not out.is_dir():
        raise BadInputError(f"--out {out}: is a file; name a directory")
    return Where(workers, scheduler, out)


def called() -> str:
    """The command line, as it can be given again."""
    return shlex.join(["flightapp", *sys.argv[1:]])
