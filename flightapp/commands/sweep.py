"""The command `flightapp sweep`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import app, display, results
from flightapp.campaign.fly import fly_all
from flightapp.commands.flights import FirstSeed, HtmlFile, Out, Runs, Scheduler, Workers, called, runs_of, tell, where
from flightapp.commands.options import JsonFile, Mission, Overrides, Vehicle
from flightapp.evaluation.grid import read_grid
from flightapp.evaluation.sweep import sweep_json
from flightapp.evaluation.sweep_page import sweep_page, sweep_tables


def sweep(
    mission: Mission,
    runs: Runs = 20,
    first_seed: FirstSeed = 0,
    grid: Annotated[
        list[str] | None, typer.Option(help="section.key=value,value…; may be repeated: every combination is flown")
    ] = None,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    out: Out = None,
    json_file: JsonFile = None,
    html: HtmlFile = None,
) -> None:
    """Fly a mission with many seeds in simulation; success rates with their 95 % intervals."""
    console = Console()
    plan = app.FlightPlan(mission, Path(), "sim", vehicle, tuple(overrides or ()), first_seed)
    flights = runs_of(plan, read_grid(grid or ()), runs)
    with display.bar(console, len(flights)) as advance:
        flown = fly_all(flights, where(workers, scheduler, out), advance)
    summary = sweep_json(flown)
    tell(console, sweep_tables(summary), summary)
    page = sweep_page(summary, f"{mission.stem}, {len(flights)} flights", called())
    if out is not None:
        results.write_text(out / "sweep.html", page, "--out")
        results.write_json(out / "sweep.json", summary)
        console.print(f"written: {out / 'sweep.html'}, {out / 'sweep.json'}", highlight=False, soft_wrap=True)
    if html is not None:
        results.write_text(html, page, "--html")
    results.write_json(json_file, summary)
