"""Counterparts of the paper's figures 3 to 9, from the first seed of each experiment."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flightapp.evaluation.figures import HEIGHT, blank, line, style
from flightapp.evaluation.gates import gate_outline
from flightapp.frames import Vector

FLOWN, REFERENCE, GATE = "#e8871e", "#1d4ed8", "#1f2933"
"""The paper's colours: flown orange, reference blue."""
SPEEDS = ("#1d4ed8", "#e8871e", "#5a9e4b", "#d1495b", "#a878c8")
"""Of one v_max each, where several share a plot."""
OPENING = 1.4
"""m, side of a gate's opening."""
TALL = 620
"""px, of a figure in three dimensions."""
ROW = 190
"""px, height of a row of small plots."""

Trace = Mapping[str, Any]
Traces = Mapping[float, Trace]
"""By v_max."""


def paper_figures(traces: Mapping[tuple[str, float], Trace]) -> dict[str, go.Figure]:
    """Every figure for which there are ``traces`` (by experiment and v_max), in the paper's order, by name."""
    by_name: dict[str, dict[float, Trace]] = {}
    for (name, v_max), trace in sorted(traces.items()):
        by_name.setdefault(name, {})[v_max] = trace
    made: dict[str, go.Figure] = {}
    for number, name in ((3, "lemniscate_sim"), (4, "lemniscate_real")):
        if name in by_name:
            made |= _control_figures(number, by_name[name])
    if (five := by_name.get("five_gates_sim")) is not None:
        fastest = five[max(five)]
        made["fig5"] = _world(fastest, "Fig. 5: the track of five gates")
        made["fig6"] = _race(fastest, f"Fig. 6: five gates, v_max {max(five):g} m/s: flown and reference")
    if (one := by_name.get("one_gate_real")) is not None:
        made["fig7"] = _together(one, "Fig. 7: through one gate at different speeds, by ground truth")
    four = by_name.get("four_gates_real", {})
    for number, v_max in ((8, 0.5), (9, 1.0)):
        if v_max in four:
            title = f"Fig. {number}: four gates, v_max {v_max:g} m/s: flown and reference"
            made[f"fig{number}"] = _race(four[v_max], title)
    return made


def _control_figures(number: int, traces: Traces) -> dict[str, go.Figure]:
    """The four parts of figures 3 and 4."""
    world = "in simulation" if number == 3 else "as the real flight"
    return {
        f"fig{number}a": _paths(traces, f"Fig. {number} (a): lemniscate {world}, flown (orange) and reference (blue)"),
        f"fig{number}b": _axes(traces, "position", f"Fig. {number} (b): position, flown and reference", "m"),
        f"fig{number}c": _axes(traces, "velocity", f"Fig. {number} (c): velocity, flown and reference", "m/s"),
        f"fig{number}d": _speeds(traces, f"Fig. {number} (d): speed flown"),
    }


def _rows(trace: Trace, source: str, quantity: str = "position") -> Vector:
    """(n, 3); of the truth where there is one, else of the estimate."""
    at = trace.get(source) or trace.get("estimate") or trace["reference"]
    return np.array(at[quantity], float).reshape(-1, 3)


def _times(trace: Trace) -> Vector:
    return np.array(trace["time"], float)


def _paths(traces: Traces, title: str) -> go.Figure:
    """A path from above for each v_max, side by side and to one scale."""
    names = [f"v_max {v_max:g} m/s" for v_max in traces]
    figure = make_subplots(rows=1, cols=len(traces), subplot_titles=names, shared_yaxes=True, horizontal_spacing=0.03)
    style(figure, title)
    for n, trace in enumerate(traces.values(), start=1):
        for source, name, colour in (("reference", "reference", REFERENCE), ("truth", "flown", FLOWN)):
            path = _rows(trace, source)
            _add(figure, path[:, 0], path[:, 1], name, colour, 1, n, n == 1)
        figure.update_xaxes(title_text="x, m", row=1, col=n)
        anchor = "x" if n == 1 else f"x{n}"
        figure.update_yaxes(scaleanchor=anchor, scaleratio=1, row=1, col=n)
    figure.update_yaxes(title_text="y, m", row=1, col=1)
    figure.update_layout(height=HEIGHT, margin={"t": 70})
    return figure


def _axes(traces: Traces, quantity: str, title: str, unit: str) -> go.Figure:
    """The three axes over time, a column for each v_max."""
    names = [f"v_max {v_max:g} m/s" for v_max in traces]
    figure = make_subplots(
        rows=3,
        cols=len(traces),
        subplot_titles=names,
        shared_xaxes=True,
        vertical_spacing=0.04,
        horizontal_spacing=0.05,
    )
    style(figure, title)
    for n, trace in enumerate(traces.values(), start=1):
        time = _times(trace)
        for axis in range(3):
            for source, name, colour in (("reference", "reference", REFERENCE), ("truth", "flown", FLOWN)):
                values = _rows(trace, source, quantity)[:, axis]
                _add(figure, time, values, name, colour, axis + 1, n, n == 1 and axis == 0)
            if n == 1:
                figure.update_yaxes(title_text=f"{'xyz'[axis]}, {unit}", row=axis + 1, col=1)
        figure.update_xaxes(title_text="time, s", row=3, col=n)
    figure.update_layout(height=3 * ROW + 130, margin={"t": 70}, legend={"y": -0.12})
    return figure


def _add(figure: go.Figure, x: Vector, y: Vector, name: str, colour: str, row: int, column: int, legend: bool) -> None:
    dash = "dash" if name == "reference" else "solid"
    pen = {"color": colour, "width": 1.6, "dash": dash}
    trace = go.Scatter(x=x, y=y, name=name, mode="lines", line=pen, showlegend=legend, legendgroup=name)
    figure.add_trace(trace, row=row, col=column)


def _speeds(traces: Traces, title: str) -> go.Figure:
    figure = blank(title, "time, s", "m/s")
    for n, (v_max, trace) in enumerate(traces.items()):
        speed = np.linalg.norm(_rows(trace, "truth", "velocity"), axis=1)
        line(figure, _times(trace), speed, f"v_max {v_max:g} m/s", SPEEDS[n % len(SPEEDS)])
    return figure


def _world(trace: Trace, title: str) -> go.Figure:
    """The track in three dimensions, with the path that was flown."""
    figure = go.Figure()
    style(figure, title)
    for outline in _outlines(trace):
        pen = {"color": GATE, "width": 7}
        x, y, z = outline.T
        figure.add_trace(go.Scatter3d(x=x, y=y, z=z, mode="lines", line=pen, showlegend=False))
    x, y, z = _rows(trace, "truth").T
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, mode="lines", line={"color": FLOWN, "width": 3}, name="flown"))
    axes = {f"{axis}axis": {"title": f"{axis}, m"} for axis in "xyz"}
    figure.update_layout(
        height=TALL, scene={**axes, "aspectmode": "data", "camera": {"eye": {"x": -1.2, "y": -1.6, "z": 1.1}}}
    )
    return figure


def _race(trace: Trace, title: str) -> go.Figure:
    """From above, flown and reference, with the gates."""
    figure = blank(title, "x, m", "y, m")
    _draw_gates(figure, trace)
    for source, name, colour in (("reference", "reference", REFERENCE), ("truth", "flown", FLOWN)):
        path = _rows(trace, source)
        dash = "dash" if source == "reference" else "solid"
        line(figure, path[:, 0], path[:, 1], name, colour, dash=dash)
    figure.update_yaxes(scaleanchor="x", scaleratio=1)
    return figure


def _together(traces: Traces, title: str) -> go.Figure:
    """From the side, one path for each v_max."""
    figure = make_subplots(rows=1, cols=2, subplot_titles=("from above", "from the side"), horizontal_spacing=0.08)
    style(figure, title)
    for n, (v_max, trace) in enumerate(traces.items()):
        path, colour, name = _rows(trace, "truth"), SPEEDS[n % len(SPEEDS)], f"v_max {v_max:g} m/s"
        for column, axis in ((1, 1), (2, 2)):
            pen = {"color": colour, "width": 1.6}
            look = {"mode": "lines", "line": pen, "legendgroup": name, "showlegend": column == 1}
            figure.add_trace(go.Scatter(x=path[:, 0], y=path[:, axis], name=name, **look), row=1, col=column)
    for outline in _outlines(next(iter(traces.values()))):
        for column, axis in ((1, 1), (2, 2)):
            pen = {"color": GATE, "width": 4}
            gate = go.Scatter(x=outline[:, 0], y=outline[:, axis], mode="lines", line=pen, showlegend=False)
            figure.add_trace(gate, row=1, col=column)
    for column, name in ((1, "y, m"), (2, "z, m")):
        figure.update_xaxes(title_text="x, m", row=1, col=column)
        figure.update_yaxes(title_text=name, row=1, col=column)
    figure.update_layout(margin={"t": 70})
    return figure


def _draw_gates(figure: go.Figure, trace: Trace) -> None:
    for number, outline in enumerate(_outlines(trace), start=1):
        line(figure, outline[:, 0], outline[:, 1], f"gate {number}", GATE, width=5.0)
    figure.for_each_trace(lambda drawn: drawn.update(showlegend=not str(drawn.name).startswith("gate")))


def _outlines(trace: Trace) -> Sequence[Vector]:
    """The gates' true outlines, (m, 3) each."""
    return [gate_outline(np.array(place[:3]), float(place[3]), OPENING) for place in trace["gates"]]
