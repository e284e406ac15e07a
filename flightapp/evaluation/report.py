"""The report of a flight: one HTML file with everything in it, for any browser, without a network."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flightapp.evaluation.figures import Subject, figures
from flightapp.evaluation.flight import Flight
from flightapp.evaluation.metrics import Window, racing_window
from flightapp.evaluation.page import Heading, page_html
from flightapp.evaluation.summary import flight_track, summarise, why_failed
from flightapp.evaluation.tables import NONE, TextTable, flight_tables, number

EVENT_KINDS = ("phase", "behavior", "fault", "referee")


def write_report(flight: Flight, path: Path, summary: Mapping[str, Any] | None = None) -> None:
    """Write the report of ``flight`` to ``path``; ``summary`` is its summary, where it is already made.

    Raises `BadInputError` if the log's header cannot be read, OSError if the file cannot be written.
    """
    path.write_text(report_html(flight, summary or summarise(flight)), encoding="utf-8")


def report_html(flight: Flight, summary: Mapping[str, Any]) -> str:
    """The report as text."""
    window = racing_window(flight)
    drawn = figures(Subject(flight, window, flight_track(flight)))
    failure = why_failed(summary)
    seed = "" if summary["seed"] is None else f", seed {summary['seed']}"
    speed = "" if summary["v_max"] is None else f", v_max {summary['v_max']:g} m/s"
    tables = (*flight_tables(summary)[1:], _events(flight, window))
    outcome = summary["outcome"] or "outcome not recorded"
    heading = Heading(
        f"{summary['mission'] or 'flight'}{seed}{speed}", outcome, not failure, _note(flight, summary, failure)
    )
    return page_html(heading, _facts(summary), drawn, tables)


def _note(flight: Flight, summary: Mapping[str, Any], failure: str) -> str:
    notes = [f"judged by {'ground truth' if flight.has_truth else 'the estimate'}"]
    if failure and failure != summary["outcome"]:
        notes.insert(0, failure)
    if not flight.complete:
        notes.append("the log was cut off")
    lost = [key for key in ("dropped", "refused") if key in flight.header]
    notes += [f"{flight.header[key]} messages {key} by the recorder" for key in lost]
    return " · ".join(notes)


def _facts(summary: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    gates = summary["gates"]
    tracking = summary["tracking_rmse_truth"] or summary["tracking_rmse"]
    sender = summary["sender"] or {}
    return (
        ("elapsed, s", number(summary["elapsed"], 2)),
        ("peak speed, m/s", number(summary["v_peak"], 2)),
        ("mean speed, m/s", number(summary["v_avg"], 2)),
        ("gates passed", f"{sum(gate['passed'] for gate in gates)} / {len(gates)}" if gates else NONE),
        ("collisions", str(len(summary["collisions"]))),
        ("off the reference, m RMS", number(tracking and tracking["total"], 3)),
        ("plans flown", str(summary["replans"]["count"])),
        ("commands p99, ms", number(sender.get("p99"), 2, 1e3)),
    )


def _events(flight: Flight, window: Window) -> TextTable:
    rows = [
        [f"{event.kind}: {event.text}", number(event.stamp - window.start, 2)]
        for event in flight.events
        if event.kind in EVENT_KINDS
    ]
    return TextTable("Events", ("what", "time s"), rows)
