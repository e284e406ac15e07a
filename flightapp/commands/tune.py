"""The command `flightapp tune`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import results, tune_command
from flightapp.commands.options import JsonFile, Overrides
from flightapp.inputs import BadInputError

console = Console()


def tune(
    vehicle: Annotated[Path, typer.Argument(help="vehicle file, such as config/sim_racer.toml")],
    mission: Annotated[Path, typer.Option(help="whose track is flown")] = Path("missions/lemniscate.py"),
    runs: Annotated[int, typer.Option(min=1, help="how many vehicles are drawn")] = 50,
    first_seed: Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")] = 0,
    search: Annotated[int, typer.Option(min=0, help="seek better gains, trying about so many sets")] = 0,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="vehicle file to write, with the gains that were found")] = None,
    json_file: JsonFile = None,
) -> None:
    """Score a vehicle file over simulated vehicles that are not quite what it says; exit status 1 if one is lost."""
    if out is not None and search == 0:
        raise BadInputError("--out takes the gains that --search N finds; give both")
    options = tune_command.TuneOptions(vehicle, mission, runs, first_seed, tuple(overrides or ()), search)
    with console.status("flying"):
        tuned = tune_command.tune(options)
    console.print(*tune_command.tuned_tables(tuned), sep="\n")
    results.write_json(json_file, tune_command.tuned_json(tuned))
    if search and not tuned.improved:
        console.print("nothing better was found", highlight=False)
    elif out is not None:
        tune_command.write_gains(tuned, out)
        console.print(f"written: {out}", highlight=False, soft_wrap=True)
    raise typer.Exit(1 if tuned.score.crashes else 0)
