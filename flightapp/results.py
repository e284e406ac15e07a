"""What happens to a flight after its end: summary, report, and many flights together."""

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import joblib
from rich.table import Table

from flightapp import app
from flightapp.evaluation.report import write_report
from flightapp.evaluation.summary import summarise, to_json, why_failed
from flightapp.evaluation.sweep import sweep_summary
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
    count = 1
    while (directory := Path("runs") / f"{mission.stem}-{seed}-{count}").exists():
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


def fly_one(plan: app.FlightPlan, seed: int) -> dict[str, Any]:
    """Fly ``plan`` with another ``seed`` and keep only the summary, or {"seed", "why"} where it broke."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as scratch:
        try:
            return finish(app.fly(replace(plan, seed=seed, out=Path(scratch))), page=False)
        except BadInputError:
            raise
        except Exception as error:  # one broken flight must not lose the others
            return {"seed": seed, "why": f"{type(error).__name__}: {error}"}


def sweep(plan: app.FlightPlan, runs: int, workers: int, advance: Callable[[bool], None]) -> dict[str, Any]:
    """Fly ``plan`` with ``runs`` seeds from its own on, in ``workers`` processes; success rate and times."""
    seeds = range(plan.seed, plan.seed + runs)
    jobs = (joblib.delayed(fly_one)(plan, seed) for seed in seeds)
    summaries = []
    for summary in joblib.Parallel(n_jobs=workers, return_as="generator")(jobs):
        summaries.append(summary)
        advance("why" not in summary and not why_failed(summary))
    return sweep_summary(summaries)


def sweep_table(summary: dict[str, Any]) -> Table:
    """The success rate of a sweep, and what failed."""
    low, high = summary["ci95"]
    table = Table("runs", "successes", "rate", "95 % interval", "elapsed p50", "elapsed p95")
    times = [f"{value:.2f} s" if value is not None else "-" for value in summary["elapsed"].values()]
    rate = f"{100.0 * summary['rate']:.1f} %"
    interval = f"{100.0 * low:.1f} to {100.0 * high:.1f} %"
    table.add_row(str(summary["runs"]), str(summary["successes"]), rate, interval, *times)
    if (estimation := summary["estimation"]) is not None:
        ours, raw, nees = estimation["rmse"]["p50"], estimation["tracker_rmse"]["p50"], estimation["nees"]["mean"]
        table.add_row("estimate", f"{ours:.3f} m", f"tracker {raw:.3f} m", f"NEES {nees:.2f} (3)")
    offset = summary["offset"]
    if offset["max"] is not None:
        table.add_row("gates", f"{offset['p50']:.2f} m", f"at most {offset['max']:.2f} m", "from the centre")
    for failed in summary["failures"]:
        table.add_row(f"seed {failed['seed']}", failed["why"])
    return table


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
