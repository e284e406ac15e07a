"""The command `flightapp compare`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import app, display, results
from flightapp.campaign.fly import fly_all
from flightapp.campaign.run import Run
from flightapp.commands.flights import FirstSeed, HtmlFile, Out, Runs, Scheduler, Workers, called, runs_of, tell, where
from flightapp.commands.options import JsonFile, Mission, Overrides, Vehicle
from flightapp.evaluation.comparison import MEANING, comparison_json, comparison_page, comparison_tables
from flightapp.evaluation.grid import combinations, label, split
from flightapp.inputs import BadInputError
from flightapp.modules import find

SETTINGS = {
    "planner": "planning.planner",
    "controller": "control.controller",
    "estimator": "estimation.estimator",
    "detector": "detection.detector",
}
"""Where each kind of module is chosen."""
Names = Annotated[str | None, typer.Option(help="names, as in the configuration, with commas between them")]


def compare(
    mission: Mission,
    planner: Names = None,
    controller: Names = None,
    estimator: Names = None,
    detector: Names = None,
    runs: Runs = 10,
    first_seed: FirstSeed = 0,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    out: Out = None,
    json_file: JsonFile = None,
    html: HtmlFile = None,
) -> None:
    """Fly a mission with every combination of modules and the same seeds in simulation; one table of them all."""
    console = Console()
    plan = app.FlightPlan(mission, Path(), "sim", vehicle, tuple(overrides or ()), first_seed)
    chosen = {"planner": planner, "controller": controller, "estimator": estimator, "detector": detector}
    flights = runs_with(plan, {kind: names for kind, names in chosen.items() if names is not None}, runs)
    with display.bar(console, len(flights)) as advance:
        flown = fly_all(flights, where(workers, scheduler, out), advance)
    compared = comparison_json(flown)
    tell(console, comparison_tables(compared), compared)
    console.print(MEANING, highlight=False)
    page = comparison_page(compared, f"{mission.stem}, modules compared", called())
    if out is not None:
        results.write_text(out / "compare.html", page, "--out")
        results.write_json(out / "compare.json", compared)
        console.print(f"written: {out / 'compare.html'}, {out / 'compare.json'}", highlight=False, soft_wrap=True)
    if html is not None:
        results.write_text(html, page, "--html")
    results.write_json(json_file, compared)


def runs_with(plan: app.FlightPlan, chosen: dict[str, str], runs: int) -> list[Run]:
    """``runs`` flights with every combination of the ``chosen`` modules, names by kind; raises `BadInputError`."""
    if not chosen:
        kinds = ", ".join(f"--{kind}" for kind in SETTINGS)
        raise BadInputError(f"compare: name modules with at least one of {kinds}, as --planner polynomial,race")
    grid = []
    for kind, text in chosen.items():
        names = tuple(dict.fromkeys(name.strip() for name in split(text)))
        for name in names:
            find(f"{kind}s", name)
        grid.append((kind, names))
    flights = []
    for combination in combinations(grid):
        modules = tuple((SETTINGS[kind], name) for kind, name in combination)
        flown = runs_of(plan, [(key, (name,)) for key, name in modules], runs)
        flights += [Run(run.plan, label(combination), combination) for run in flown]
    return flights
