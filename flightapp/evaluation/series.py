"""The figures of a flight over time: on the same axis all, with the moments that matter as lines."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flightapp.evaluation.figures import (
    AXIS_COLOURS,
    ESTIMATE,
    EVENT_COLOURS,
    REFERENCE,
    SOURCE_STYLES,
    TRUE_GATE,
    TRUTH,
    Subject,
    blank,
    line,
    sources,
    style,
)
from flightapp.evaluation.metrics import position_error
from flightapp.frames import Vector

HEIGHT, TALL = 236, 330
"""px."""
MARGIN = {"l": 66, "r": 14, "t": 42, "b": 64}
"""px, the same for all, so that one moment has one place."""
GAP = 1.0
"""s without data from where on a line is interrupted."""
APART = 1.0 / 26.0
"""Of the time axis: labels keep so far apart, which is their width on a telephone."""


def series_figures(subject: Subject) -> Mapping[str, go.Figure]:
    """Every figure over time that the flight has data for, by name, in the order of the report."""
    made: Mapping[str, go.Figure | None] = {
        "speed": speed_figure(subject),
        "tracking": tracking_figure(subject),
        "estimation": estimation_figure(subject),
        "commands": command_figure(subject),
    }
    return {name: figure for name, figure in made.items() if figure is not None}


def speed_figure(subject: Subject) -> go.Figure | None:
    """Speed over time: true, estimated, reference."""
    shown = sources(subject)
    if not shown:
        return None
    figure = blank("Speed, m/s", "time, s", "")
    for name, motion, colour in shown:
        speed = np.linalg.norm(motion.velocity, axis=1)
        line(figure, motion.stamp - subject.window.start, speed, name, colour, gap=GAP, **SOURCE_STYLES[name])
    lay_out_over_time(figure, subject)
    return figure


def tracking_figure(subject: Subject) -> go.Figure | None:
    """Reference − estimate per axis, and its length by the estimate and by truth."""
    flight = subject.flight
    stamps, error = position_error(flight.setpoints, flight.states, subject.window)
    if not stamps.size:
        return None
    figure = blank("Position error, m: reference − estimate", "time, s", "")
    _draw_error(figure, stamps - subject.window.start, error, "‖e‖", ESTIMATE)
    stamps, error = position_error(flight.setpoints, flight.truth, subject.window)
    if stamps.size:
        length = np.linalg.norm(error, axis=1)
        line(figure, stamps - subject.window.start, length, "‖e‖ by truth", TRUTH, width=2.0)
    lay_out_over_time(figure, subject)
    return figure


def estimation_figure(subject: Subject) -> go.Figure | None:
    """Estimate − truth per axis, its length, and the estimator's own 3 σ."""
    flight = subject.flight
    stamps, error = position_error(flight.states, flight.truth, subject.window)
    if not stamps.size:
        return None
    figure = blank("Estimation error, m: estimate − truth", "time, s", "")
    _draw_error(figure, stamps - subject.window.start, error, "‖e‖", TRUTH)
    inside = np.isin(flight.states.stamp, stamps)
    sigma = np.sqrt(np.maximum(np.sum(flight.states.variance[inside, :3], axis=1), 0.0))
    time = flight.states.stamp[inside] - subject.window.start
    line(figure, time, 3.0 * sigma, "its 3 σ", REFERENCE, dash="dot")
    lay_out_over_time(figure, subject)
    return figure


def command_figure(subject: Subject) -> go.Figure | None:
    """Body rates and thrust over time."""
    commands = subject.flight.commands
    if not commands.stamp.size:
        return None
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.07, row_heights=[0.6, 0.4])
    style(figure, "Commands: body rates, rad/s, and thrust, m/s²")
    time = commands.stamp - subject.window.start
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        line(figure, time, commands.rates[:, axis], f"{name} rate", AXIS_COLOURS[axis], row=1)
    line(figure, time, commands.thrust, "thrust", TRUE_GATE, row=2)
    figure.update_xaxes(title_text="time, s", row=2, col=1)
    lay_out_over_time(figure, subject, TALL)
    return figure


def lay_out_over_time(figure: go.Figure, subject: Subject, height: int = HEIGHT) -> None:
    """The time axis of the whole flight, and on it gates, faults and phases as lines, the first two with labels."""
    marks = moments(subject)
    lines = []
    for x, kind, _ in marks:
        ends = {"x0": x, "x1": x, "y0": 0.0, "y1": 1.0, "xref": "x", "yref": "paper"}
        look = {"color": EVENT_COLOURS[kind], "width": 1, "dash": "dot"}
        lines.append({"type": "line", "line": look, "layer": "below", **ends})
    first, last = subject.span
    labels = [
        {
            **{"x": x, "y": 1.0, "xref": "x", "yref": "paper", "xanchor": "center", "yanchor": "bottom"},
            **{"text": text, "showarrow": False, "font": {"size": 10, "color": EVENT_COLOURS[kind]}},
        }
        for x, kind, text in spaced([mark for mark in marks if mark[2]], APART * (last - first))
    ]
    figure.update_xaxes(range=[first, last], title_standoff=2)
    figure.update_yaxes(automargin=False, nticks=6)
    figure.update_layout(
        shapes=lines,
        annotations=[*figure.layout.annotations, *labels],
        margin=MARGIN,
        height=height,
        legend={"font": {"size": 11}, "y": -40.0 / (height - MARGIN["t"] - MARGIN["b"])},
    )


Moment = tuple[float, str, str]


def moments(subject: Subject) -> Sequence[Moment]:
    """What to mark: s since the window's start, kind as in `EVENT_COLOURS`, and a short label, in order of time."""
    flight, start = subject.flight, subject.window.start
    marks = [(event.stamp - start, "phase", "") for event in flight.events if event.kind == "phase"]
    faults = [event for event in flight.events if event.kind == "fault" and not event.text.endswith("is over")]
    marks += [(event.stamp - start, "fault", "!") for event in faults]
    marks += [(passage.stamp - start, "passage", str(passage.gate_id)) for passage in flight.passages]
    marks += [(touch.stamp - start, "collision", "✕") for touch in flight.collisions]
    return sorted(marks)


def spaced(marks: Sequence[Moment], apart: float) -> Sequence[Moment]:
    """Those of ``marks`` that keep ``apart`` from each other: the gravest are chosen first, then the earliest."""
    kept: list[Moment] = []
    for mark in sorted(marks, key=lambda mark: (mark[1] not in ("fault", "collision"), mark[0])):
        if all(abs(mark[0] - other[0]) >= apart for other in kept):
            kept.append(mark)
    return sorted(kept)


def _draw_error(figure: go.Figure, time: Vector, error: Vector, name: str, colour: str) -> None:
    for axis, letter in enumerate("xyz"):
        line(figure, time, error[:, axis], letter, AXIS_COLOURS[axis], width=1.0)
    line(figure, time, np.linalg.norm(error, axis=1), name, colour, width=2.0)
