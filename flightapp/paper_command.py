"""Every experiment of the paper: what is flown, and what is made of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flightapp import app
from flightapp.campaign.fly import Advance, Where, fly_all
from flightapp.campaign.run import Result, Run
from flightapp.evaluation.experiments import PROFILING, Experiment, needed
from flightapp.evaluation.limit import LIMIT, LimitCase, limit_table
from flightapp.evaluation.paper import Table, paper_tables
from flightapp.evaluation.paper_documents import csv_text, latex_text
from flightapp.evaluation.paper_page import all_tables, paper_markdown, paper_page
from flightapp.evaluation.paper_rows import Row, row_json, row_of
from flightapp.evaluation.paper_tables import profile_remarks, remark_lines
from flightapp.evaluation.summary import why_failed
from flightapp.evaluation.tables import TextTable
from flightapp.results import write_json, write_text

JETSON = ("compute.detection=0.094", "compute.plan=0.321")
"""What the paper's detector, and its generator for 14 points, take on its Jetson (table 14)."""
PRESETS: Mapping[str, tuple[str, ...]] = {"here": (), "jetson": JETSON}
CLOSER = " closer"
TAKEOFF_AND_LANDING = 8.0
"""s, about, of each flight."""


@dataclass(frozen=True, slots=True)
class PaperOptions:
    """What the command line asks for."""

    tables: tuple[int, ...]
    seeds: int = 3
    first_seed: int = 0
    compute: str = "here"
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PaperFlown:
    """All that was flown."""

    options: PaperOptions
    rows: Mapping[int, Sequence[Row]]
    """By the number of the table."""
    traces: Mapping[tuple[str, float], Mapping[str, Any]]
    """The first seed's motion, by experiment and v_max, where that succeeded or at least ended."""
    experiments: Sequence[Experiment]
    limit: Sequence[tuple[LimitCase, Sequence[Result]]]
    """Of the paper's limit, where that was asked for."""


@dataclass(frozen=True, slots=True)
class PaperText:
    """What there is to say of what was flown."""

    tables: Mapping[str, TextTable]
    """By label."""
    remarks: Sequence[tuple[str, str]]
    """Where something is not better, or failed, and why."""
    lines: Sequence[str]
    """Why what is not better isn't, and what is not the same."""
    json: dict[str, Any]


def fly_paper(options: PaperOptions, where: Where, advance: Advance) -> PaperFlown:
    """Fly everything that the tables of ``options`` need; raises `BadInputError`."""
    experiments = needed(options.tables)
    runs = paper_runs(options)
    results: dict[str, list[Result]] = {}
    for run, result in zip(runs, fly_all(runs, where, advance), strict=True):
        results.setdefault(run.label, []).append(result)
    for flown in results.values():
        flown.sort(key=lambda result: int(result["seed"]))
    by_number = {table.number: table for table in paper_tables()}
    rows = {
        number: [
            _row(by_number[number], experiment, v_max, results)
            for experiment in experiments
            if number in experiment.tables
            for v_max in (*experiment.v_max, *experiment.beyond)
        ]
        for number in options.tables
        if number != PROFILING
    }
    traces = {
        (experiment.name, v_max): flown[0]["trace"]
        for experiment in experiments
        for v_max in (*experiment.v_max, *experiment.beyond)
        if "trace" in (flown := results[_label(experiment, v_max)])[0]
    }
    limit = [(case, results[case.label]) for case in LIMIT if case.label in results]
    return PaperFlown(options, rows, traces, experiments, limit)


def paper_runs(options: PaperOptions) -> list[Run]:
    """What is flown, what takes longest first; the first seed of each keeps its motion."""
    settings = (*PRESETS[options.compute], *options.overrides)
    runs: list[tuple[float, Run]] = []
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    for e in needed(options.tables):
        for v_max in (*e.v_max, *e.beyond):
            cost = TAKEOFF_AND_LANDING + e.length / min(v_max, 4.0)
            speed = f"race.v_max={v_max:g}"
            for seed in seeds:
                plan = app.FlightPlan(e.mission, Path(), "sim", e.vehicle, (*e.settings, *settings, speed), seed)
                runs.append((cost, Run(plan, _label(e, v_max), traced=seed == options.first_seed)))
                if (closer := e.closer.get(v_max)) is not None:
                    nearer = replace(plan, overrides=(*plan.overrides, *closer))
                    runs.append((cost, Run(nearer, _label(e, v_max, CLOSER))))
    if options.compute == "jetson" and {12, 13} & set(options.tables):
        for case in LIMIT:
            for seed in seeds:
                plan = app.FlightPlan(case.mission, Path(), "sim", case.vehicle, case.settings, seed)
                runs.append((TAKEOFF_AND_LANDING + case.length / case.v_max, Run(plan, case.label)))
    runs.sort(key=lambda entry: -entry[0])
    return [run for _, run in runs]


def paper_text(flown: PaperFlown, profile: Sequence[Mapping[str, Any]]) -> PaperText:
    """Everything in words and numbers; ``profile`` has rows of `flightapp bench`."""
    tables = all_tables(flown.rows, profile, limit_table(flown.limit) if flown.limit else None)
    remarks = [*remark_lines(flown.rows), *profile_remarks(profile)]
    lines = [f"* {where}: {why}" for where, why in remarks]
    lines += [f"{experiment.title}: {experiment.differs}" for experiment in flown.experiments]
    rows: dict[str, Any] = {str(number): [row_json(row) for row in of_it] for number, of_it in flown.rows.items()}
    if profile:
        rows[str(PROFILING)] = list(profile)
    told = {
        "tables": rows,
        "compute": flown.options.compute,
        "seeds": [flown.options.first_seed + n for n in range(flown.options.seeds)],
        "differs": {experiment.name: experiment.differs for experiment in flown.experiments},
    }
    if flown.limit:
        told["limit"] = [_limit_json(case, results) for case, results in flown.limit]
    return PaperText(tables, remarks, lines, told)


def _limit_json(case: LimitCase, results: Sequence[Result]) -> dict[str, Any]:
    flights = [
        {
            "seed": result["seed"],
            "why": result.get("why") or why_failed(result["summary"]),
            "elapsed": result.get("summary", {}).get("elapsed"),
            "command": result["command"],
        }
        for result in results
    ]
    return {"planner": case.planner, "v_max": case.v_max, "settings": case.settings, "flights": flights}


def write_paper(flown: PaperFlown, text: PaperText, directory: Path, command: str) -> list[Path]:
    """Write paper.json, .csv, .tex, .md and .html into ``directory``; their paths."""
    rows = [row for of_it in flown.rows.values() for row in of_it]
    files = {
        "paper.csv": csv_text(rows),
        "paper.tex": latex_text(text.tables),
        "paper.md": paper_markdown(flown.rows, text.tables, flown.experiments, text.remarks, command),
        "paper.html": paper_page(flown.rows, flown.traces, text.tables, flown.experiments, text.remarks, command),
    }
    write_json(directory / "paper.json", text.json)
    for name, contents in files.items():
        write_text(directory / name, contents, "--out")
    return [directory / name for name in ("paper.json", *files)]


def _row(table: Table, experiment: Experiment, v_max: float, results: Mapping[str, Sequence[Result]]) -> Row:
    closer = results.get(_label(experiment, v_max, CLOSER), ())
    return row_of(table, experiment, v_max, results[_label(experiment, v_max)], closer)


def _label(experiment: Experiment, v_max: float, kind: str = "") -> str:
    return f"{experiment.name} v_max={v_max:g}{kind}"
