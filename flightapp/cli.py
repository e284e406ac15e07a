"""The command line: parse, call one function, print."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import cv2
import typer
from rich.console import Console

from flightapp import app, display, results
from flightapp.bench import bench_table, run_bench
from flightapp.config import dump_config, load_config
from flightapp.evaluation.summary import why_failed
from flightapp.evaluation.tables import terminal_tables
from flightapp.inputs import BadInputError
from flightapp.mission.loader import load_mission
from flightapp.track import load_track

cli = typer.Typer(
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help="Autonomous drone racing on board."
)
console = Console()

Mission = Annotated[Path, typer.Argument(help="a mission, such as missions/five_gates.py")]
Vehicle = Annotated[Path | None, typer.Option("--vehicle", help="vehicle file, such as config/sim_racer.toml")]
Overrides = Annotated[list[str] | None, typer.Option("--set", help="section.key=value, over all files")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="also write the result here")]
Sim = Annotated[bool, typer.Option("--sim", help="fly the in-process simulation")]


@cli.command()
def fly(
    mission: Mission,
    sim: Sim = False,
    vehicle: Vehicle = None,
    seed: Annotated[int, typer.Option(min=0, help="of everything random in the simulation")] = 0,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="run directory; default: a new one in runs/")] = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="simulate on the wall clock")] = False,
) -> None:
    """Fly a mission; exit status 0 only if it reached its goal."""
    plan = _plan(mission, sim, vehicle, seed, overrides, results.run_directory(mission, seed, out), realtime)
    with display.progress(console) as watch:
        flown = app.fly(plan, watch)
    summary = results.finish(flown)
    console.print(*terminal_tables(summary), sep="\n")
    speed = flown.duration / flown.wall
    console.print(f"{flown.duration:.1f} s flown in {flown.wall:.1f} s ({speed:.1f} × real time)", highlight=False)
    console.print(f"{flown.ending.outcome}: {flown.ending.reason}", highlight=False)
    console.print(f"report: {plan.out / 'report.html'}", soft_wrap=True)
    raise typer.Exit(1 if why_failed(summary) else 0)


@cli.command()
def sweep(
    mission: Mission,
    runs: Annotated[int, typer.Option(min=1, help="how many flights")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")] = 0,
    sim: Sim = True,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 2,
    json_file: JsonFile = None,
) -> None:
    """Fly a mission with many seeds in simulation; success rate with its 95 % interval."""
    plan = _plan(mission, sim, vehicle, first_seed, overrides, Path(), realtime=False)
    app.prepare(plan)
    with display.bar(console, runs) as advance:
        summary = results.sweep(plan, runs, workers, advance)
    console.print(results.sweep_table(summary))
    _write_json(json_file, summary)


@cli.command()
def report(
    runs: Annotated[list[Path], typer.Argument(help="run directories or flight.mcap files")],
) -> None:
    """Print each flight's tables and write report.html beside its log."""
    for run in runs:
        summary, page = results.report(run)
        console.print(*terminal_tables(summary), sep="\n")
        console.print(f"report: {page}", soft_wrap=True)


@cli.command()
def check(
    files: Annotated[list[Path] | None, typer.Argument(help="missions (.py), tracks and vehicle files (.toml)")] = None,
    overrides: Overrides = None,
) -> None:
    """Validate files without flying; print the effective configuration."""
    for file in files or []:
        if file.suffix == ".py":
            mission = load_mission(file)
            load_config(None, mission.settings, overrides or ())
            console.print(f"# {file}: a mission on track '{mission.track.name}'", highlight=False)
        elif results.looks_like_track(file):
            console.print(f"# {file}: track '{load_track(file).name}'", highlight=False)
        else:
            print(dump_config(load_config(file, None, overrides or ())))
    if not files:
        print(dump_config(load_config(None, None, overrides or ())))


@cli.command()
def bench(json_file: JsonFile = None) -> None:
    """Computation times on this computer, beside the paper's."""
    result = run_bench()
    console.print(bench_table(result))
    _write_json(json_file, result)


def _plan(
    mission: Path, sim: bool, vehicle: Path | None, seed: int, overrides: list[str] | None, out: Path, realtime: bool
) -> app.FlightPlan:
    if not sim:
        raise BadInputError("say what to fly: --sim for the in-process simulation")
    return app.FlightPlan(mission, out, "sim", vehicle, tuple(overrides or ()), seed, realtime)


def _write_json(path: Path | None, result: dict[str, Any]) -> None:
    if path is not None:
        path.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def main() -> None:
    """Run a command; what the user can mend is one paragraph on stderr and exit status 2."""
    cv2.setNumThreads(1)  # its threads would compete with the tasks for the cores
    try:
        cli()
    except BadInputError as error:
        Console(stderr=True).print(f"flightapp: {error}", style="red", highlight=False, markup=False, soft_wrap=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
