"""The command `flightapp paper`."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from flightapp import display, results
from flightapp.bench import profile
from flightapp.commands.flights import Scheduler, Workers, called, where
from flightapp.commands.options import JsonFile, Overrides
from flightapp.evaluation.experiments import PROFILING, read_only
from flightapp.evaluation.tables import rich_table
from flightapp.paper_command import PaperOptions, fly_paper, paper_runs, paper_text, write_paper


class Compute(StrEnum):
    """Whose computing times are charged in simulation."""

    HERE = "here"
    JETSON = "jetson"


def paper(
    seeds: Annotated[int, typer.Option(min=1, help="flights of each row of a table")] = 3,
    first_seed: Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")] = 0,
    compute: Annotated[
        Compute, typer.Option(help="jetson: detection and planning take what the paper's took on its Jetson")
    ] = Compute.HERE,
    only: Annotated[str | None, typer.Option(help="tables of the paper, as table7,table8")] = None,
    overrides: Overrides = None,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    out: Annotated[
        Path | None,
        typer.Option(help="directory; what is flown there already is not flown again; default: a new one in runs/"),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Fly every experiment of the paper in simulation; its tables beside ours, as text, JSON, CSV, LaTeX and a page."""
    console = Console()
    options = PaperOptions(read_only(only), seeds, first_seed, compute.value, tuple(overrides or ()))
    directory = out or results.new_directory("paper")
    with display.bar(console, len(paper_runs(options))) as advance:
        flown = fly_paper(options, where(workers, scheduler, directory), advance)
    times: Sequence[Mapping[str, Any]] = profile() if PROFILING in options.tables else ()
    text = paper_text(flown, times)
    console.print(*map(rich_table, text.tables.values()), sep="\n")
    for line in text.lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for path in write_paper(flown, text, directory, called()):
        console.print(f"written: {path}", highlight=False, soft_wrap=True)
    results.write_json(json_file, text.json)
