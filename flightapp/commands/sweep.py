"""The command `flightapp sweep`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import app, display, results
from flightapp.commands.options import JsonFile, Mission, Overrides, Vehicle

console = Console()


def sweep(
    mission: Mission,
    runs: Annotated[int, typer.Option(min=1, help="how many flights")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")] = 0,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 2,
    json_file: JsonFile = None,
) -> None:
    """Fly a mission with many seeds in simulation; success rate with its 95 % interval."""
    plan = app.FlightPlan(mission, Path(), "sim", vehicle, tuple(overrides or ()), first_seed)
    app.prepare(plan)
    with display.bar(console, runs) as advance:
        summary = results.sweep(plan, runs, workers, advance)
    console.print(results.sweep_table(summary))
    results.write_json(json_file, summary)
