"""The figures of a flight, for the report."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flightapp.evaluation.flight import Flight, Motions, Setpoints
from flightapp.evaluation.gates import gate_outline
from flightapp.evaluation.metrics import Window, position_error
from flightapp.evaluation.solids import outline
from flightapp.frames import Vector
from flightapp.messages import GateEstimate
from flightapp.track import Track

POINTS = 3000
"""Most points that one line is drawn with."""
HEIGHT, MARGIN, LABELLED_TOP = 420, {"l": 54, "r": 14, "t": 44, "b": 78}, 124
"""px; with labels of events above the plot, the top margin is `LABELLED_TOP`."""
LABELS = 40
"""Most events that are labelled."""

TRUTH, ESTIMATE, REFERENCE = "#34b38a", "#1d4ed8", "#6b7280"
AXIS_COLOURS = ("#d1495b", "#5a9e4b", "#a878c8")
NOMINAL_GATE, ESTIMATED_GATE, TRUE_GATE, OBSTACLE = "#9aa3af", "#e8871e", "#1f2933", "#94a3b8"
SOURCE_STYLES: Mapping[str, Any] = {
    "truth": {"width": 4.0},
    "estimate": {"width": 1.6},
    "reference": {"width": 1.6, "dash": "dash"},
}
"""Truth is the widest and drawn first, so that all three are seen where they agree."""
EVENT_COLOURS = {"phase": "#64748b", "passage": "#0e7490", "fault": "#dc2626", "collision": "#dc2626"}


@dataclass(frozen=True, slots=True)
class Subject:
    """What is drawn: a flight, the window that is judged (its start is time 0) and the track, if known."""

    flight: Flight
    window: Window
    track: Track | None

    @property
    def opening(self) -> float:
        """m, side of the gates' openings."""
        return self.track.gate.opening if self.track else 1.0


def figures(subject: Subject) -> dict[str, go.Figure]:
    """Every figure that the flight has data for, by name, in the order of the report."""
    made: dict[str, go.Figure | None] = {
        "above": path_above(subject),
        "side": path_side(subject),
        "speed": speed_figure(subject),
        "tracking": tracking_figure(subject),
        "estimation": estimation_figure(subject),
        "commands": command_figure(subject),
        "intervals": interval_figure(subject),
    }
    return {name: figure for name, figure in made.items() if figure is not None}


def path_above(subject: Subject) -> go.Figure:
    """The path from above, to scale."""
    figure = blank("Path from above", "x, m", "y, m")
    _draw_paths(figure, subject, (0, 1))
    figure.update_yaxes(scaleanchor="x", scaleratio=1)
    return figure


def path_side(subject: Subject) -> go.Figure:
    """The path from the side on which it is longer; height is not to scale."""
    position = np.concatenate([subject.flight.states.position, subject.flight.truth.position])
    spread = np.ptp(position, axis=0) if position.size else np.ones(3)
    along = 0 if spread[0] >= spread[1] else 1
    figure = blank("Path from the side (height magnified)", f"{'xy'[along]}, m", "z, m")
    _draw_paths(figure, subject, (along, 2))
    return figure


def speed_figure(subject: Subject) -> go.Figure:
    """Speed over time: true, estimated, reference."""
    figure = blank("Speed", "time, s", "m/s")
    for name, motion, colour in _sources(subject):
        speed = np.linalg.norm(motion.velocity, axis=1)
        line(figure, motion.stamp - subject.window.start, speed, name, colour, **SOURCE_STYLES[name])
    _mark_events(figure, subject)
    return figure


def tracking_figure(subject: Subject) -> go.Figure | None:
    """Reference − estimate per axis, and its length by the estimate and by truth."""
    flight = subject.flight
    stamps, error = position_error(flight.setpoints, flight.states, subject.window)
    if not stamps.size:
        return None
    figure = blank("Position error: reference − estimate", "time, s", "m")
    _draw_error(figure, stamps - subject.window.start, error, "‖e‖ by the estimate", ESTIMATE)
    stamps, error = position_error(flight.setpoints, flight.truth, subject.window)
    if stamps.size:
        length = np.linalg.norm(error, axis=1)
        line(figure, stamps - subject.window.start, length, "‖e‖ by truth", TRUTH, width=2.0)
    _mark_events(figure, subject)
    return figure


def estimation_figure(subject: Subject) -> go.Figure | None:
    """Estimate − truth per axis, its length, and the estimator's own 3 σ."""
    flight = subject.flight
    stamps, error = position_error(flight.states, flight.truth, subject.window)
    if not stamps.size:
        return None
    figure = blank("Estimation error: estimate − truth", "time, s", "m")
    _draw_error(figure, stamps - subject.window.start, error, "‖e‖", TRUTH)
    inside = np.isin(flight.states.stamp, stamps)
    sigma = np.sqrt(np.maximum(np.sum(flight.states.variance[inside, :3], axis=1), 0.0))
    time = flight.states.stamp[inside] - subject.window.start
    line(figure, time, 3.0 * sigma, "3 σ of the estimator", REFERENCE, dash="dot")
    _mark_events(figure, subject)
    return figure


def command_figure(subject: Subject) -> go.Figure | None:
    """Body rates and thrust over time."""
    commands = subject.flight.commands
    if not commands.stamp.size:
        return None
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.07, row_heights=[0.6, 0.4])
    style(figure, "Commands")
    time = commands.stamp - subject.window.start
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        line(figure, time, commands.rates[:, axis], f"{name} rate", AXIS_COLOURS[axis], row=1)
    line(figure, time, commands.thrust, "thrust", TRUE_GATE, row=2)
    figure.update_yaxes(title_text="rad/s", row=1, col=1)
    figure.update_yaxes(title_text="m/s²", row=2, col=1)
    figure.update_xaxes(title_text="time, s", row=2, col=1)
    _mark_events(figure, subject)
    return figure


def interval_figure(subject: Subject) -> go.Figure | None:
    """How often the time between two commands was how long."""
    stamps = subject.flight.commands.stamp
    between = np.diff(stamps[subject.window.holds(stamps)]) * 1e3
    if not between.size:
        return None
    figure = blank("Time between commands", "ms", "how often")
    counts, edges = np.histogram(between, bins=60)
    if edges[-1] - edges[0] < 1.0:
        centre = float(np.median(between))
        counts, edges = np.histogram(between, bins=60, range=(centre - 0.5, centre + 0.5))
    middle = 0.5 * (edges[:-1] + edges[1:])
    figure.add_trace(go.Bar(x=middle, y=counts, width=np.diff(edges), marker_color=ESTIMATE, showlegend=False))
    figure.update_yaxes(type="log", dtick=1)
    return figure


def _sources(subject: Subject) -> Iterable[tuple[str, Motions | Setpoints, str]]:
    flight = subject.flight
    named: Sequence[tuple[str, Motions | Setpoints, str]] = (
        ("truth", flight.truth, TRUTH),
        ("estimate", flight.states, ESTIMATE),
        ("reference", flight.setpoints, REFERENCE),
    )
    return [source for source in named if source[1].stamp.size]


def _draw_paths(figure: go.Figure, subject: Subject, axes: tuple[int, int]) -> None:
    i, j = axes
    for obstacle in subject.track.obstacles if subject.track else ():
        edge, pen = outline(obstacle, axes), {"color": OBSTACLE, "width": 1}
        look = {"fill": "toself", "mode": "lines", "line": pen, "name": obstacle.name, "showlegend": False}
        figure.add_trace(go.Scatter(x=short(edge[:, 0]), y=short(edge[:, 1]), **look))
    for name, motion, colour in _sources(subject):
        path = motion.position[subject.window.holds(motion.stamp)]
        line(figure, path[:, i], path[:, j], name, colour, **SOURCE_STYLES[name])
    for name, gates, colour, width in _gates(subject):
        outlines = [gate_outline(gate.position, gate.yaw, subject.opening) for gate in gates]
        points = np.concatenate([np.vstack([outline, np.full((1, 3), np.nan)]) for outline in outlines])
        dash = "dot" if colour == NOMINAL_GATE else "solid"
        line(figure, points[:, i], points[:, j], name, colour, dash=dash, width=width)
    labelled = next((gates for _, gates, _, _ in reversed(_gates(subject))), ())
    for gate in labelled:
        x, y = float(gate.position[i]), float(gate.position[j])
        font = {"size": 12, "color": TRUE_GATE}
        figure.add_annotation(x=x, y=y, text=f"<b>{gate.gate_id}</b>", showarrow=False, xshift=14, yshift=14, font=font)


def _gates(subject: Subject) -> list[tuple[str, Sequence[GateEstimate], str, float]]:
    flight, track = subject.flight, subject.track
    nominal: Sequence[GateEstimate] = flight.maps[0].gates if flight.maps else ()
    if not nominal and track:
        nominal = [GateEstimate(g.id, np.array(g.position), g.yaw, np.zeros((4, 4)), 0, 0.0) for g in track.gates]
    estimated = flight.maps[-1].gates if flight.maps else ()
    true = flight.true_gates[-1] if flight.true_gates else ()
    named = (
        ("gates, surveyed", nominal, NOMINAL_GATE, 3.0),
        ("gates, true", true, TRUE_GATE, 5.0),
        ("gates, estimated", estimated, ESTIMATED_GATE, 2.5),
    )
    return [entry for entry in named if entry[1]]


def _draw_error(figure: go.Figure, time: Vector, error: Vector, name: str, colour: str) -> None:
    for axis, letter in enumerate("xyz"):
        line(figure, time, error[:, axis], letter, AXIS_COLOURS[axis], width=1.0)
    line(figure, time, np.linalg.norm(error, axis=1), name, colour, width=2.0)


def line(
    figure: go.Figure,
    x: Vector,
    y: Vector,
    name: str,
    colour: str,
    *,
    dash: str = "solid",
    width: float = 1.6,
    row: int | None = None,
) -> None:
    """Draw ``y`` over ``x``, both (n,), with at most `POINTS` points."""
    step = max(1, -(-x.size // POINTS))
    pen = {"color": colour, "dash": dash, "width": width}
    trace = go.Scatter(x=short(x[::step]), y=short(y[::step]), name=name, mode="lines", line=pen)
    figure.add_trace(trace, row=row, col=None if row is None else 1)


def short(values: Vector) -> Vector:
    """``values`` in the precision that a screen needs."""
    return values.astype(np.float32)


def _mark_events(figure: go.Figure, subject: Subject) -> None:
    flight, start = subject.flight, subject.window.start
    marks = [(event.stamp, event.kind, _brief(event.text)) for event in flight.events]
    marks += [(passage.stamp, "passage", f"gate {passage.gate_id}") for passage in flight.passages]
    marks += [(touch.stamp, "collision", f"touched {touch.obstacle}") for touch in flight.collisions]
    shown = [mark for mark in sorted(marks) if mark[1] in EVENT_COLOURS]
    lines, labels = [], []
    for stamp, kind, text in shown:
        x, colour = stamp - start, EVENT_COLOURS[kind]
        ends = {"x0": x, "x1": x, "y0": 0.0, "y1": 1.0, "xref": "x", "yref": "paper"}
        lines.append(dict(type="line", line={"color": colour, "width": 1, "dash": "dot"}, opacity=0.7, **ends))
        font = {"size": 10, "color": colour}
        place = {"x": x, "y": 1.0, "xref": "x", "yref": "paper", "xanchor": "center", "yanchor": "bottom"}
        labels.append({"text": text, "showarrow": False, "font": font, "textangle": -90, **place})
    margin = {**MARGIN, "t": LABELLED_TOP} if labels else MARGIN
    labels = [*figure.layout.annotations, *labels[:LABELS]]
    figure.update_layout(shapes=lines, annotations=labels, margin=margin, height=HEIGHT + margin["t"] - MARGIN["t"])


def _brief(text: str) -> str:
    return text.partition(":")[0][:20]


def blank(title: str, x: str, y: str) -> go.Figure:
    """An empty figure with these titles."""
    figure = go.Figure()
    style(figure, title)
    figure.update_xaxes(title_text=x)
    figure.update_yaxes(title_text=y)
    return figure


def style(figure: go.Figure, title: str) -> None:
    """Give ``figure`` its title and what all figures look like."""
    figure.update_layout(
        title={"text": title, "x": 0.01, "y": 0.98, "yanchor": "top", "font": {"size": 15}},
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 12, "color": "#1f2933"},
        margin=MARGIN,
        legend={"orientation": "h", "y": -0.2, "x": 0.0, "yanchor": "top"},
        hovermode="closest",
        height=HEIGHT,
    )
