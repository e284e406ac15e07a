"""What happens to a flight after its end: summary and report."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flightapp import app
from flightapp.evaluation.overlay import comparison_figures, comparison_html
from flightapp.evaluation.png import write_pngs
from flightapp.evaluation.report import flight_figures, write_report
from flightapp.evaluation.summary import summarise, to_json
from flightapp.inputs import BadInputError, read_toml
from flightapp.interchange.sources import LOG, read_any_flight
from flightapp.recording.reader import read_flight


def run_directory(mission: Path, seed: int, out: Path | None) -> Path:
    """Where to leave the record of a flight: ``out``, or a new directory in runs/.

    Raises `BadInputError` where ``out`` holds a flight already: a record is never overwritten.
    """
    if out is not None:
        if (out / LOG).exists():
            raise BadInputError(f"--out {out}: holds a flight already; choose another directory or move that one")
        if out.exists() and not out.is_dir():
            raise BadInputError(f"--out {out}: is a file; name a directory")
        return out
    return new_directory(f"{mission.stem}-{seed}")


def new_directory(name: str, runs: Path = Path("runs")) -> Path:
    """A directory in ``runs`` that does not exist yet."""
    count = 1
    while (directory := runs / f"{name}-{count}").exists():
        count += 1
    return directory


def finish(flown: app.Flown, page: bool = True) -> dict[str, Any]:
    """Write summary.json, and report.html if ``page``, beside a flight's log; the summary."""
    flight = read_flight(flown.out / LOG)
    summary = summarise(flight)
    (flown.out / "summary.json").write_text(to_json(summary), encoding="utf-8")
    if page:
        write_report(flight, flown.out / "report.html", summary)
    return summary


def report(run: Path, pngs: Path | None = None) -> tuple[dict[str, Any], Path]:
    """Summary and report.html of the flight in ``run``, a directory, a log or PX4's own; figures as PNG to ``pngs``."""
    flight = read_any_flight(run)
    summary = summarise(flight)
    page = run / "report.html" if run.is_dir() else run.with_name("report.html")
    write_report(flight, page, summary)
    if pngs is not None:
        write_pngs(flight_figures(flight), pngs, run_name(run))
    return summary, page


def compare(runs: Sequence[Path], page: Path, pngs: Path | None = None) -> None:
    """Write a page that compares the flights in ``runs``; its figures as PNG into ``pngs``."""
    if len(runs) < 2:
        raise BadInputError("--compare: name at least two runs to compare")
    flights = {name: read_any_flight(run) for name, run in zip(run_names(runs), runs, strict=True)}
    write_text(page, comparison_html(flights), "--compare")
    if pngs is not None:
        write_pngs(comparison_figures(flights), pngs, "comparison")


def log_of(run: Path) -> Path:
    """The log of ``run``, a directory or the log itself."""
    return run / LOG if run.is_dir() else run


def run_name(run: Path) -> str:
    """What to call ``run``: its directory, or the log's own name if it was given another."""
    log = log_of(run)
    return log.resolve().parent.name if log.name == LOG else log.stem


def run_names(runs: Sequence[Path]) -> Sequence[str]:
    """Names of ``runs``, each another, in their order."""
    names: list[str] = []
    for run in runs:
        name = run_name(run)
        names.append(name if name not in names else f"{name} ({len(names) + 1})")
    return names


def looks_like_track(file: Path) -> bool:
    """Whether a TOML file describes a track rather than a vehicle."""
    return bool({"gates", "waypoints", "start"} & read_toml(file, "file").keys())


def looks_like_mission(file: Path) -> bool:
    """Whether a TOML file describes a mission."""
    return "steps" in read_toml(file, "file")


def write_json(path: Path | None, result: dict[str, Any]) -> None:
    """Write ``result`` to ``path``, if there is one; raises `BadInputError` where that cannot be."""
    if path is not None:
        write_text(path, json.dumps(result, indent=2) + "\n", "--json")


def write_text(path: Path, text: str, option: str) -> None:
    """Write ``text`` to ``path``, which ``option`` named; raises `BadInputError` where that cannot be."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{option} {path}: cannot be written: {error.strerror or error}") from None
