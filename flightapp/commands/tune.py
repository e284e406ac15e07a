"""The commands `flightapp tune`: gains in flight, and how good they are."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from flightapp.commands.options import JsonFile, Overrides
from flightapp.commands.service import said
from flightapp.inputs import BadInputError, validate
from flightapp.service.protocol import Reload, Tunables, Tune

console = Console()
tune = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Change gains in flight, and score or search them in simulation.",
)


@tune.command("set", context_settings={"ignore_unknown_options": True})  # such as -1, which is a value
def set_live(
    key: Annotated[str, typer.Argument(help="section.key, as `tune show` lists them; or KEY=VALUE, several at once")],
    rest: Annotated[list[str] | None, typer.Argument(metavar="VALUE", help="the value, or more of KEY=VALUE")] = None,
) -> None:
    """Have the flight of the service go on with other values, between two commands: all of them, or none.

    They stand over the vehicle file until the flight ends, also after a reload, as --set does.
    """
    given = rest or []
    pairs = [(key, given[0])] if "=" not in key and len(given) == 1 else [_pair(text) for text in (key, *given)]
    if repeated := {one for one, _ in pairs if [other for other, _ in pairs].count(one) > 1}:
        raise BadInputError(f"given more than once: {', '.join(sorted(repeated))}")
    _tell(validate(Tune, {"settings": dict(pairs)}, "tune set"))


def _tell(request: Tune | Reload) -> None:
    console.print(said(request)["text"], highlight=False, markup=False, soft_wrap=True)


def _pair(text: str) -> tuple[str, str]:
    key, separator, value = text.partition("=")
    if not separator or not key.strip() or not value.strip():
        raise BadInputError(f"'{text}': expected KEY VALUE, or KEY=VALUE KEY=VALUE …")
    return key.strip(), value.strip()


@tune.command("reload")
def reload() -> None:
    """Have the flight of the service go on with what its vehicle file says now, as a SIGHUP does."""
    _tell(Reload())


@tune.command("show")
def show() -> None:
    """What may be changed in the flight of the service: values, bounds and meaning."""
    table = Table("key", "value", "at the start", "bounds", "meaning")
    for field in said(Tunables())["fields"]:
        start = "" if field["start"] == field["value"] else str(field["start"])
        table.add_row(field["key"], str(field["value"]), start, field["bounds"], field["description"])
    console.print(table)


@tune.command("score")
def score(
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
    from flightapp import results, tune_command  # noqa: PLC0415  `tune set` is not to wait for them

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
