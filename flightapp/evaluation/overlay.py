"""Several flights on one page: paths in one scene, speeds and errors over the same time, one table."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from flightapp.evaluation.figures import EVENT_COLOURS, Subject, blank, line, short, style
from flightapp.evaluation.flight import Flight, Motions, Setpoints
from flightapp.evaluation.metrics import Window, position_error, racing_window
from flightapp.evaluation.page import Heading, Linked, page_html
from flightapp.evaluation.scene import lay_out
from flightapp.evaluation.series import HEIGHT, MARGIN
from flightapp.evaluation.space import (
    draw_gates,
    draw_movers,
    draw_surroundings,
    leave_room,
    moving,
    scene_bounds,
    thinned,
)
from flightapp.evaluation.summary import flight_track, summarise, why_failed
from flightapp.evaluation.tables import TextTable, number

COLOURS = ("#1d4ed8", "#d1495b", "#34b38a", "#e8871e", "#7c3aed", "#0e7490", "#b45309", "#db2777", "#4d7c0f", "#475569")
"""Of the runs; after the last it begins anew."""


def comparison_html(flights: Mapping[str, Flight]) -> str:
    """The page as text, of flights by the names of their runs; raises `BadInputError` as `summarise` does."""
    subjects = _subjects(flights)
    summaries = {name: summarise(flight) for name, flight in flights.items()}
    good = sum(not why_failed(summary) for summary in summaries.values())
    heading = Heading(
        f"{len(flights)} flights compared",
        f"{good} of {len(flights)} succeeded",
        good == len(flights),
        _note(summaries),
    )
    series = compared_series(subjects)
    scene = compared_paths(subjects)
    linked = Linked(scene, series, moving(subjects, scene_bounds(list(subjects.values()))))
    tables = (comparison_table(summaries), rmse_table(summaries))
    return page_html(heading, (), {}, tables, wide=[table.title for table in tables], linked=linked)


def comparison_figures(flights: Mapping[str, Flight]) -> Mapping[str, go.Figure]:
    """Every figure of that page, by name."""
    subjects = _subjects(flights)
    return {"space": compared_paths(subjects), **compared_series(subjects)}


def compared_paths(subjects: Mapping[str, Subject]) -> go.Figure:
    """The paths in one scene, with the surroundings and the gates of the first flight."""
    figure = go.Figure()
    style(figure, "Paths in space")
    first = next(iter(subjects.values()))
    draw_surroundings(figure, first)
    draw_gates(figure, first)
    for (name, subject), colour in zip(subjects.items(), _colours(len(subjects)), strict=True):
        stamp, path, velocity = thinned(subject.motion)
        x, y, z = short(path).T
        speed = np.linalg.norm(velocity, axis=1)
        figure.add_trace(
            go.Scatter3d(
                **{"x": x, "y": y, "z": z, "mode": "lines", "name": name},
                line={"color": colour, "width": 5},
                customdata=short(stamp - subject.window.start),
                text=[f"{value:.2f} m/s" for value in speed],
                hovertemplate=f"{name}<br>%{{customdata:.2f}} s<br>%{{text}}<extra></extra>",
            )
        )
    draw_movers(figure, *_colours(len(subjects)))
    bounds = scene_bounds(list(subjects.values()))
    lay_out(figure, None, bounds.low, bounds.high)
    leave_room(figure)
    return figure


def compared_series(subjects: Mapping[str, Subject]) -> Mapping[str, go.Figure]:
    """Speeds and errors over the time since the race began."""
    drawn = {
        "speed": ("Speed, m/s", {name: _speed(subject) for name, subject in subjects.items()}),
        "tracking": ("Position error, m: reference − estimate", _errors(subjects, "setpoints", "states")),
        "estimation": ("Estimation error, m: estimate − truth", _errors(subjects, "states", "truth")),
    }
    return {name: _overlaid(title, lines, subjects) for name, (title, lines) in drawn.items() if lines}


def comparison_table(summaries: Mapping[str, Mapping[str, Any]]) -> TextTable:
    """One row for each run."""
    rows = []
    for name, summary in summaries.items():
        gates, sender = summary["gates"], summary["sender"] or {}
        passed = f"{sum(gate['passed'] for gate in gates)}/{len(gates)}" if gates else "–"
        rows.append(
            [
                name,
                summary["outcome"] or "not recorded",
                *(number(summary[key], 2) for key in ("elapsed", "v_peak", "v_avg")),
                passed,
                str(len(summary["collisions"])),
                number(sender.get("p99"), 2, 1e3),
            ]
        )
    columns = ("run", "outcome", "elapsed s", "v peak m/s", "v mean m/s", "gates", "collisions", "commands p99 ms")
    return TextTable("Flights", columns, rows)


def rmse_table(summaries: Mapping[str, Mapping[str, Any]]) -> TextTable:
    """The errors of each run."""
    keys = {
        "tracking_rmse": "reference − estimate",
        "tracking_rmse_truth": "reference − truth",
        "estimation_rmse": "estimate − truth",
    }
    rows = [
        [name, *(number(summary[key] and summary[key]["total"], 4) for key in keys)]
        for name, summary in summaries.items()
    ]
    return TextTable("RMSE of the position, m (total: √ mean ‖e‖²)", ("run", *keys.values()), rows)


def _subjects(flights: Mapping[str, Flight]) -> dict[str, Subject]:
    return {name: Subject(flight, racing_window(flight), flight_track(flight)) for name, flight in flights.items()}


def _note(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    missions = sorted({str(summary["mission"] or "flight") for summary in summaries.values()})
    return f"{', '.join(missions)} · time counts from the start of each race · gates are those of the first flight"


def _colours(count: int) -> Sequence[str]:
    return [COLOURS[k % len(COLOURS)] for k in range(count)]


def _speed(subject: Subject) -> tuple[Any, Any]:
    stamp, _, velocity = thinned(subject.motion)
    return stamp - subject.window.start, np.linalg.norm(velocity, axis=1)


def _errors(subjects: Mapping[str, Subject], reference: str, actual: str) -> dict[str, tuple[Any, Any]]:
    found = {}
    for name, subject in subjects.items():
        wanted: Motions | Setpoints = getattr(subject.flight, reference)
        window: Window = subject.window
        stamps, error = position_error(wanted, getattr(subject.flight, actual), window)
        if stamps.size:
            found[name] = stamps - window.start, np.linalg.norm(error, axis=1)
    return found


def _overlaid(title: str, lines: Mapping[str, tuple[Any, Any]], subjects: Mapping[str, Subject]) -> go.Figure:
    figure = blank(title, "time, s", "")
    colours = dict(zip(subjects, _colours(len(subjects)), strict=True))
    for name, (time, values) in lines.items():
        line(figure, time, values, name, colours[name])
    first = next(iter(subjects.values()))
    for passage in first.flight.passages:
        look = {"color": EVENT_COLOURS["passage"], "width": 1, "dash": "dot"}
        figure.add_vline(passage.stamp - first.window.start, line=look, opacity=0.5, layer="below")
    spans = [subject.span for subject in subjects.values()]
    figure.update_xaxes(range=[min(span[0] for span in spans), max(span[1] for span in spans)], title_standoff=2)
    figure.update_yaxes(automargin=False, nticks=6, rangemode="tozero")
    height = HEIGHT + 40
    legend = {"font": {"size": 11}, "y": -40.0 / (height - MARGIN["t"] - MARGIN["b"])}
    figure.update_layout(height=height, margin=MARGIN, legend=legend)
    return figure
