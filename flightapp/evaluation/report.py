"""The report of a flight: one HTML file with everything in it, for any browser, without a network."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import plotly.graph_objects as go

from flightapp.evaluation.figures import Subject, path_above, path_side
from flightapp.evaluation.flight import Flight
from flightapp.evaluation.key_frames import key_frames
from flightapp.evaluation.metrics import Window, racing_window
from flightapp.evaluation.page import Heading, Linked, page_html
from flightapp.evaluation.series import series_figures
from flightapp.evaluation.space import moving, path_in_space, scene_bounds
from flightapp.evaluation.summary import flight_track, summarise, why_failed
from flightapp.evaluation.tables import NONE, TextTable, flight_tables, number
from flightapp.evaluation.timeline import timeline_figure
from flightapp.evaluation.timing import timing_figures

IMAGES_TITLE = "What the camera saw: markers as detected (green), gates where the map had them (orange)"
EVENT_KINDS = ("phase", "behavior", "fault", "referee")


def write_report(flight: Flight, path: Path, summary: Mapping[str, Any] | None = None) -> None:
    """Write the report of ``flight`` to ``path``; ``summary`` is its summary, where it is already made.

    Raises `BadInputError` if the log's header cannot be read, OSError if the file cannot be written.
    """
    path.write_text(report_html(flight, summary or summarise(flight)), encoding="utf-8")


def report_html(flight: Flight, summary: Mapping[str, Any]) -> str:
    """The report as text."""
    window = racing_window(flight)
    subject = Subject(flight, window, flight_track(flight))
    failure = why_failed(summary)
    seed = "" if summary["seed"] is None else f", seed {summary['seed']}"
    speed = "" if summary["v_max"] is None else f", v_max {summary['v_max']:g} m/s"
    tables = (*flight_tables(summary)[1:], _events(flight, window))
    outcome = summary["outcome"] or "outcome not recorded"
    heading = Heading(
        f"{summary['mission'] or 'flight'}{seed}{speed}", outcome, not failure, _note(flight, summary, failure)
    )
    return page_html(
        heading,
        _facts(summary),
        flat_figures(subject),
        tables,
        linked=linked(subject),
        images=key_frames(subject),
        images_title=IMAGES_TITLE,
    )


def flight_figures(flight: Flight) -> Mapping[str, go.Figure]:
    """Every figure of the report of ``flight``, by name."""
    subject = Subject(flight, racing_window(flight), flight_track(flight))
    scene = path_in_space(subject)
    return {**({} if scene is None else {"space": scene}), **series(subject), **flat_figures(subject)}


def linked(subject: Subject) -> Linked | None:
    """The scene with the figures over time; None of a flight that has no motion."""
    scene = path_in_space(subject)
    if scene is None:
        return None
    return Linked(scene, series(subject), moving({"": subject}, scene_bounds([subject])))


def series(subject: Subject) -> Mapping[str, go.Figure]:
    """The figures over time, what happened first."""
    timeline = timeline_figure(subject)
    return {**({} if timeline is None else {"timeline": timeline}), **series_figures(subject)}


def flat_figures(subject: Subject) -> Mapping[str, go.Figure]:
    """The path from above and from the side, and the histograms."""
    return {"above": path_above(subject), "side": path_side(subject), **timing_figures(subject)}


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
