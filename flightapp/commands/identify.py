"""The command `flightapp identify`."""

from datetime import date
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import identify_command, results
from flightapp.commands.options import JsonFile

console = Console()


def identify(
    runs: Annotated[list[Path], typer.Argument(help="run directories or flight.mcap files of missions/identify.py")],
    vehicle: Annotated[
        Path | None, typer.Option("--vehicle", help="file to begin from; default: what the first flight flew with")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="vehicle file to write")] = None,
    json_file: JsonFile = None,
) -> None:
    """Find the vehicle's parameters in flight logs: thrust, lags, delay, drag."""
    found = identify_command.identify_runs(runs, vehicle)
    console.print(identify_command.findings_table(found))
    results.write_json(json_file, identify_command.findings_json(found))
    if out is not None:
        names = ", ".join(run.name for run in runs)
        identify_command.write_vehicle(out, identify_command.vehicle_text(found, vehicle, names, date.today()))
