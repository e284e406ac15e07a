"""The command `flightapp fly`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import app, display, results
from flightapp.commands.options import Connect, Mission, Overrides, Vehicle
from flightapp.evaluation.summary import why_failed
from flightapp.evaluation.tables import terminal_tables
from flightapp.inputs import BadInputError
from flightapp.recording.live import LOOPBACK

console = Console()


def fly(
    mission: Mission,
    sim: Annotated[bool, typer.Option("--sim", help="fly the in-process simulation")] = False,
    mavlink: Annotated[
        bool, typer.Option("--mavlink", help="with --sim: the simulation in its own process, flown over real MAVLink")
    ] = False,
    connect: Connect = None,
    vehicle: Vehicle = None,
    seed: Annotated[int, typer.Option(min=0, help="of everything random in the simulation")] = 0,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="run directory; default: a new one in runs/")] = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="simulate on the wall clock")] = False,
    live: Annotated[
        bool, typer.Option("--live", help=f"serve the flight to Foxglove while it lasts, at ws://{LOOPBACK}")
    ] = False,
    live_at: Annotated[
        str | None, typer.Option("--live-at", metavar="HOST:PORT", help="the same at another address")
    ] = None,
    dashboard: Annotated[
        bool, typer.Option("--dashboard", help="the flight at a glance instead of a line and events")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="list what the mission would do if all went well, without flying")
    ] = False,
) -> None:
    """Fly a mission; exit status 0 only if it reached its goal."""
    if dry_run:
        steps, result = app.dry_run(app.FlightPlan(mission, Path(), vehicle=vehicle, overrides=tuple(overrides or ())))
        console.print(display.rehearsal_table(steps))
        console.print(f"{result.outcome}: {result.reason}; nothing was flown", highlight=False)
        raise typer.Exit(0 if result.achieved else 1)
    if sim == (connect is not None) or (mavlink and not sim):
        raise BadInputError(
            "say what to fly: --sim for the simulation in this process, --sim --mavlink for one behind MAVLink,"
            " --connect URL for a real vehicle"
        )
    rig = "px4" if connect is not None else "mavlink" if mavlink else "sim"
    settings = [*(overrides or ()), *([f"link.connection={connect}"] if connect is not None else [])]
    directory = results.run_directory(mission, seed, out)
    shown = live_at or (LOOPBACK if live else "")
    plan = app.FlightPlan(mission, directory, rig, vehicle, tuple(settings), seed, realtime or rig != "sim", shown)
    if shown:
        console.print(f"live view: ws://{shown}, layout config/foxglove_layout.json", highlight=False, soft_wrap=True)
    with (display.dashboard if dashboard else display.progress)(console) as watch:
        flown = app.fly(plan, watch)
    summary = results.finish(flown)
    console.print(*terminal_tables(summary), sep="\n")
    speed = flown.duration / flown.wall
    console.print(f"{flown.duration:.1f} s flown in {flown.wall:.1f} s ({speed:.1f} × real time)", highlight=False)
    console.print(f"{flown.ending.outcome}: {flown.ending.reason}", highlight=False)
    if flown.log_error:
        console.print(f"the log is not complete: {flown.log_error}", style="red", highlight=False)
    console.print(f"report: {plan.out / 'report.html'}", soft_wrap=True)
    raise typer.Exit(1 if why_failed(summary) else 0)
