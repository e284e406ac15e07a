"""The command `flightapp doctor`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import results
from flightapp.autopilot.diagnosis import Light, diagnosis_json, diagnosis_tables
from flightapp.autopilot.doctor import Change, Confirm
from flightapp.autopilot.link import Px4Link
from flightapp.autopilot.params_file import write_params
from flightapp.autopilot.wanted_parameters import Profile, wanted_parameters
from flightapp.commands.options import JsonFile, Overrides, Vehicle
from flightapp.config import load_config
from flightapp.doctor_command import Part, examine
from flightapp.inputs import BadInputError

console = Console()


def doctor(
    connect: Annotated[
        str | None, typer.Option("--connect", help="udpin://HOST:PORT or serial:///dev/NAME:BAUD")
    ] = None,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    only: Annotated[
        list[Part] | None, typer.Option("--only", help="examine only this; may be given several times")
    ] = None,
    profile: Annotated[
        Profile, typer.Option(help="cage: no remote control, no ground station; pilot: a safety pilot's is on")
    ] = Profile.CAGE,
    fix: Annotated[bool, typer.Option("--fix", help="set the parameters that differ, after listing them")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="with --fix: don't ask")] = False,
    params: Annotated[
        Path | None, typer.Option("--params", help="only write the wanted parameters here, for QGroundControl")
    ] = None,
    runs: Annotated[Path, typer.Option(help="where flights are recorded")] = Path("runs"),
    json_file: JsonFile = None,
) -> None:
    """Examine vehicle, sensors and computer before a flight; exit status 0 only if nothing is red."""
    settings = [*(overrides or ()), *([f"link.connection={connect}"] if connect is not None else [])]
    config = load_config(vehicle, None, settings)
    if params is not None:
        write_params(params, wanted_parameters(config, profile), profile)
        return
    if yes and not fix:
        raise BadInputError("--yes answers what --fix asks; give both, or neither to examine only")
    parts = set(only or Part)
    if fix and Part.VEHICLE not in parts:
        raise BadInputError("--fix mends the vehicle's parameters; examine it with --only vehicle, or everything")
    confirm = _confirm(yes) if fix else None
    diagnosis = examine(config, parts, Px4Link, profile, confirm, runs)
    console.print(*diagnosis_tables(diagnosis), sep="\n")
    results.write_json(json_file, diagnosis_json(diagnosis))
    raise typer.Exit(1 if diagnosis.light is Light.RED else 0)


def _confirm(yes: bool) -> Confirm:
    def confirm(todo: Sequence[Change]) -> bool:
        console.print(f"{len(todo)} parameters to be written:", *(f"  {change.text}" for change in todo), sep="\n")
        return yes or typer.confirm("write them?")

    return confirm
