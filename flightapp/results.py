"""What happens to a flight after its end: summary and report."""

import json
from pathlib import Path
from typing import Any

from flightapp import app
from flightapp.evaluation.report import write_report
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


def new_directory(name: str) -> Path:
    """A directory in runs/ that does not exist yet."""
    count = 1
    while (directory := Path("runs") / f"{name}-{count}").exists():
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


def report(run: Path) -> tuple[dict[str, Any], Path]:
    """Summary and report.html of the flight in ``run``, a directory, a log or PX4's own log."""
    flight = read_any_flight(run)
    summary = summarise(flight)
    page = run / "report.html" if run.is_dir() else run.with_name("report.html")
    write_report(flight, page, summary)
    return summary, page


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
