"""The command `flightapp plan`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import plan_command, results
from flightapp.commands.options import JsonFile, Overrides, Vehicle
from flightapp.evaluation.plan_table import plan_rows, rows_json, rows_table
from flightapp.evaluation.planned import plan_json, plan_tables
from flightapp.evaluation.tables import rich_table
from flightapp.inputs import BadInputError
from flightapp.interfaces import PlanningError

console = Console()


def plan(
    track: Annotated[Path | None, typer.Argument(help="a track, such as missions/tracks/five_gates.toml")] = None,
    planner: Annotated[
        str | None, typer.Option(help="instead of planning.planner; with --table several, as race,polynomial")
    ] = None,
    v_max: Annotated[float | None, typer.Option("--v-max", help="m/s, or inf, instead of race.v_max")] = None,
    a_max: Annotated[float | None, typer.Option("--a-max", help="m/s², or inf, instead of race.a_max")] = None,
    laps: Annotated[int | None, typer.Option(min=1, help="instead of mission.laps")] = None,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    out: Annotated[
        list[Path] | None, typer.Option(help="FILE.csv, FILE.mcap or FILE.html; may be given several times")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Hz, of samples in FILE.csv; default: its polynomials")] = None,
    table: Annotated[bool, typer.Option("--table", help="all yardstick courses beside the least times")] = False,
    json_file: JsonFile = None,
) -> None:
    """Plan without flying, and draw the line; exit status 1 if there is no plan that could be flown."""
    if table:
        _plan_table(planner or "race,polynomial", json_file)
        return
    if track is None:
        raise BadInputError("plan: name a track, such as missions/tracks/five_gates.toml, or give --table")
    plan_command.check_outputs(out or (), rate)
    options = plan_command.PlanOptions(track, planner, v_max, a_max, laps, vehicle, tuple(overrides or ()))
    try:
        planned = plan_command.plan_track(options)
    except PlanningError as error:
        Console(stderr=True).print(f"no plan: {error}", style="red", highlight=False, markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    console.print(*map(rich_table, plan_tables(planned)), sep="\n")
    page = Path("runs") / f"plan-{track.stem}.html"
    for path in plan_command.write_plan(planned, out or (), rate, page):
        console.print(f"written: {path}", highlight=False, soft_wrap=True)
    results.write_json(json_file, plan_json(planned))
    if touch := plan_command.touch_of(planned):
        console.print(f"not to be flown: {touch}", style="red", highlight=False, markup=False)
        raise typer.Exit(1)


def _plan_table(planners: str, json_file: Path | None) -> None:
    with console.status("planning"):
        rows = list(plan_rows(planners.split(",")))
    console.print(rich_table(rows_table(rows)))
    for row in rows:
        if row.why:
            console.print(f"{row.course}, {row.v_max:g} m/s, {row.planner}: {row.why}", markup=False)
    results.write_json(json_file, rows_json(rows))
