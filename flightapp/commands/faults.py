"""The command `flightapp faults`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import display, fault_command, results
from flightapp.evaluation.fault_matrix import matrix_json
from flightapp.safety.document import document
from flightapp.safety.faults import FaultKind


def faults(
    runs: Annotated[int, typer.Option(min=1, help="flights for each fault in each phase")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")] = 0,
    only: Annotated[list[FaultKind] | None, typer.Option(help="a fault of the table, such as 'pose lost'")] = None,
    mission: Annotated[Path, typer.Option(help="what is flown")] = Path("missions/faults.py"),
    vehicle: Annotated[Path | None, typer.Option(help="vehicle file, such as config/sim_racer.toml")] = None,
    overrides: Annotated[list[str] | None, typer.Option("--set", help="section.key=value, over all files")] = None,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 2,
    json_file: Annotated[Path | None, typer.Option("--json", help="also write the result here")] = None,
    table: Annotated[bool, typer.Option("--table", help="only print the table, as docs/faults.md has it")] = False,
) -> None:
    """Provoke every fault of the table in every phase it names; exit status 0 only if all is as stated."""
    if table:
        print(document(), end="")
        return
    console = Console()
    options = fault_command.FaultOptions(mission, runs, first_seed, tuple(only or ()), vehicle, tuple(overrides or ()))
    flights = runs * len(fault_command.cells_of(options.only))
    with display.bar(console, flights) as advance:
        cells = fault_command.run_faults(options, workers, advance)
    console.print(fault_command.fault_table(cells))
    good = all(cell.good for cell in cells)
    if not good:
        console.print(fault_command.departures_table(cells))
    results.write_json(json_file, matrix_json(cells))
    raise typer.Exit(0 if good else 1)
