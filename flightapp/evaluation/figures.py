"""What the figures of a flight have in common, their subject and their look; its path from above and the side."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go

from flightapp.evaluation.flight import Flight, Motions, Setpoints
from flightapp.evaluation.gates import gate_outline
from flightapp.evaluation.metrics import Window
from flightapp.evaluation.solids import outline
from flightapp.frames import Vector
from flightapp.messages import GateEstimate
from flightapp.track import Track

POINTS = 3000
"""Most points that one line is drawn with."""
HEIGHT, MARGIN = 420, {"l": 54, "r": 14, "t": 44, "b": 78}
"""px."""

TRUTH, ESTIMATE, REFERENCE = "#34b38a", "#1d4ed8", "#6b7280"
AXIS_COLOURS = ("#d1495b", "#5a9e4b", "#a878c8")
NOMINAL_GATE, ESTIMATED_GATE, TRUE_GATE, OBSTACLE = "#7b8794", "#e8871e", "#1f2933", "#94a3b8"
SOURCE_STYLES: Mapping[str, Any] = {
    "truth": {"width": 4.0},
    "estimate": {"width": 1.6},
    "reference": {"width": 1.6, "dash": "dash"},
}
"""Truth is the widest and drawn first, so that all three are seen where they agree."""
EVENT_COLOURS = {"phase": "#94a3b8", "passage": "#0e7490", "fault": "#dc2626", "collision": "#dc2626"}


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

    @property
    def motion(self) -> Motions:
        """How the vehicle moved: the truth, else the estimate."""
        return self.flight.truth if self.flight.has_truth else self.flight.states

    @property
    def span(self) -> tuple[float, float]:
        """s since the window's start, of the first and the last thing that the log holds."""
        flight = self.flight
        streams = (flight.states.stamp, flight.truth.stamp, flight.commands.stamp)
        stamps = [float(stream[i]) for stream in streams if stream.size for i in (0, -1)]
        stamps += [event.stamp for event in flight.events] or [self.window.start]
        return min(stamps) - self.window.start, max(stamps) - self.window.start


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


def sources(subject: Subject) -> Sequence[tuple[str, Motions | Setpoints, str]]:
    """What tells where the vehicle was or should have been, as far as it was recorded: name, motion, colour."""
    flight = subject.flight
    named: Iterable[tuple[str, Motions | Setpoints, str]] = (
        ("truth", flight.truth, TRUTH),
        ("estimate", flight.states, ESTIMATE),
        ("reference", flight.setpoints, REFERENCE),
    )
    return [source for source in named if source[1].stamp.size]


def gate_sets(subject: Subject) -> Mapping[str, Sequence[GateEstimate]]:
    """The gates as "surveyed", "true" and "estimated" at the end, as far as there are any."""
    flight, track = subject.flight, subject.track
    surveyed: Sequence[GateEstimate] = flight.maps[0].gates if flight.maps else ()
    if not flight.maps and track:
        surveyed = [GateEstimate(g.id, np.array(g.position), g.yaw, np.zeros((4, 4)), 0, 0.0) for g in track.gates]
    named = {
        "surveyed": surveyed,
        "true": flight.true_gates[-1] if flight.true_gates else (),
        "estimated": flight.maps[-1].gates if flight.maps else (),
    }
    return {name: gates for name, gates in named.items() if gates}


def _draw_paths(figure: go.Figure, subject: Subject, axes: tuple[int, int]) -> None:
    i, j = axes
    for obstacle in subject.track.obstacles if subject.track else ():
        edge, pen = outline(obstacle, axes), {"color": OBSTACLE, "width": 1}
        look = {"fill": "toself", "mode": "lines", "line": pen, "name": obstacle.name, "showlegend": False}
        figure.add_trace(go.Scatter(x=short(edge[:, 0]), y=short(edge[:, 1]), **look))
    for name, motion, colour in sources(subject):
        path = motion.position[subject.window.holds(motion.stamp)]
        line(figure, path[:, i], path[:, j], name, colour, **SOURCE_STYLES[name])
    looks = {"surveyed": (NOMINAL_GATE, 3.0), "true": (TRUE_GATE, 5.0), "estimated": (ESTIMATED_GATE, 2.5)}
    shown = gate_sets(subject)
    for name, gates in shown.items():
        colour, width = looks[name]
        points = with_gaps([gate_outline(gate.position, gate.yaw, subject.opening) for gate in gates])
        dash = "dot" if name == "surveyed" else "solid"
        line(figure, points[:, i], points[:, j], f"gates, {name}", colour, dash=dash, width=width)
    for gate in next(reversed(list(shown.values())), ()):
        x, y = float(gate.position[i]), float(gate.position[j])
        font = {"size": 12, "color": TRUE_GATE}
        figure.add_annotation(x=x, y=y, text=f"<b>{gate.gate_id}</b>", showarrow=False, xshift=14, yshift=14, font=font)


def with_gaps(strokes: Iterable[Vector]) -> Vector:
    """Strokes (k, d) as one line (n, d) that is interrupted after each."""
    gapped = [np.vstack([stroke, np.full((1, stroke.shape[1]), np.nan)]) for stroke in strokes]
    return np.concatenate(gapped)


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
    gap: float = math.inf,
) -> None:
    """Draw ``y`` over ``x``, both (n,), with at most `POINTS` points, interrupted where ``x`` leaps by ``gap``."""
    step = max(1, -(-x.size // POINTS))
    x, y = x[::step], np.array(y[::step], float)
    y[1:][np.diff(x) > gap] = np.nan
    pen = {"color": colour, "dash": dash, "width": width}
    told = "%{fullData.name}: %{y:.3f}<br>at %{x:.2f}<extra></extra>"
    trace = go.Scatter(x=short(x), y=short(y), name=name, mode="lines", line=pen, hovertemplate=told)
    figure.add_trace(trace, row=row, col=None if row is None else 1)


def short(values: Vector) -> Vector:
    """``values`` in the precision that a screen needs."""
    return values.astype(np.float32)


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
