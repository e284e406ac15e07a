"""The figures of a plan: its line in space with the speed as colour, and what it asks of the vehicle over time."""

import math
from collections.abc import Iterable, Mapping

import numpy as np
import plotly.graph_objects as go
from plotly.colors import sample_colorscale
from plotly.subplots import make_subplots

from flightapp.evaluation.figures import (
    ESTIMATE,
    EVENT_COLOURS,
    MARGIN,
    OBSTACLE,
    TRUE_GATE,
    blank,
    line,
    short,
    style,
)
from flightapp.evaluation.gates import gate_outline
from flightapp.evaluation.planned import Planned, bounds, heading_ticks
from flightapp.evaluation.solids import outline
from flightapp.frames import GRAVITY, Vector
from flightapp.messages import GateEstimate
from flightapp.track import Box, Cylinder
from flightapp.trajectory import Samples

SAMPLES = 1200
"""Points that a line is drawn with."""
SPEEDS = sample_colorscale("Turbo", np.linspace(0.06, 0.9, 15).tolist())
"""The colours of the speed, without the ends of their scale, which are all but black."""
FRAME, LIMIT = "#e8871e", "#dc2626"
TICK_INTERVAL, TICK_LENGTH = 0.25, 1.0
"""s between the marks of the heading, and m of their length."""
BOUNDED_BY = {
    "speed": ("speed",),
    "specific force": ("specific force", "least specific force"),
    "body rate": ("body rate",),
    "yaw rate": ("yaw rate", "yaw rate, to the right"),
}
"""The limits that are drawn beside each quantity."""
HEIGHT_3D, HEIGHT_VEHICLE = 720, 560
"""px."""
EYE = {"x": -0.46, "y": -1.8, "z": 1.0}
"""Where the scene is seen from, as plotly counts it: the whole track at once."""


def plan_figures(planned: Planned) -> Mapping[str, go.Figure]:
    """Every figure, by name, in the order of the page; "line" is meant to be wide."""
    return {
        "line": line_in_space(planned),
        "above": line_above(planned),
        "vehicle": vehicle_figure(planned),
    }


def line_in_space(planned: Planned) -> go.Figure:
    """The line in three dimensions, with gates and obstacles."""
    figure = go.Figure()
    style(figure, "Line, coloured by speed")
    for obstacle in planned.track.obstacles:
        figure.add_trace(_solid(obstacle))
    shape = planned.track.gate
    for gate in _gates(planned):
        figure.add_trace(_frame(gate, shape.opening, shape.opening + 2.0 * shape.border))
    path, speed = _path(planned)
    pen = {"color": short(speed), "width": 7, **_colours(speed)}
    hover = "%{x:.2f}, %{y:.2f}, %{z:.2f} m<br>%{text}<extra></extra>"
    x, y, z = (short(path[:, axis]) for axis in range(3))
    text = [f"{value:.2f} m/s" for value in speed]
    figure.add_trace(
        go.Scatter3d(x=x, y=y, z=z, mode="lines", line=pen, text=text, hovertemplate=hover, showlegend=False)
    )
    _mark_in_space(figure, planned, path)
    flat = {"showbackground": False, "gridcolor": "#e2e8f0", "zeroline": False}
    axes = {f"{axis}axis": {"title": f"{axis}, m", **flat} for axis in "xyz"}
    axes["zaxis"] |= {"rangemode": "tozero", "nticks": 4}
    scene = {"aspectmode": "data", "camera": {"eye": EYE, "center": {"x": 0.0, "y": 0.0, "z": -0.15}}, **axes}
    figure.update_layout(height=HEIGHT_3D, margin={"l": 0, "r": 0, "t": 36, "b": 0}, scene=scene)
    return figure


def line_above(planned: Planned) -> go.Figure:
    """The line from above, to scale, with the heading."""
    figure = blank("From above; the short lines point where the camera looks", "x, m", "y, m")
    for obstacle in planned.track.obstacles:
        edge = outline(obstacle)
        figure.add_trace(
            go.Scatter(
                x=short(edge[:, 0]),
                y=short(edge[:, 1]),
                fill="toself",
                mode="lines",
                line={"color": OBSTACLE, "width": 1},
                name=obstacle.name,
                showlegend=False,
            )
        )
    path, speed = _path(planned)
    dots = {"color": short(speed), "size": 5, **_colours(speed)}
    x, y = short(path[:, 0]), short(path[:, 1])
    hover = "%{x:.2f}, %{y:.2f} m<br>%{marker.color:.2f} m/s<extra></extra>"
    figure.add_trace(go.Scatter(x=x, y=y, mode="markers", marker=dots, hovertemplate=hover, showlegend=False))
    ticks = _with_gaps(heading_ticks(planned.trajectory, TICK_INTERVAL, TICK_LENGTH).transpose(1, 0, 2))
    line(figure, ticks[:, 0], ticks[:, 1], "heading", TRUE_GATE, width=1.0)
    for gate in _gates(planned):
        across = gate_outline(gate.position, gate.yaw, planned.track.gate.opening)
        font = {"size": 12, "color": TRUE_GATE}
        line(figure, across[:, 0], across[:, 1], f"gate {gate.gate_id}", FRAME, width=4.0)
        at = {"x": float(gate.position[0]), "y": float(gate.position[1])}
        figure.add_annotation(text=f"<b>{gate.gate_id}</b>", showarrow=False, xshift=14, yshift=14, font=font, **at)
    figure.update_yaxes(scaleanchor="x", scaleratio=1)
    figure.update_layout(height=HEIGHT_VEHICLE, showlegend=False, margin={**MARGIN, "b": 48})
    return figure


def vehicle_figure(planned: Planned) -> go.Figure:
    """Speed, specific force, body rate and yaw rate over time, beside their limits; gates as marks."""
    times = np.linspace(0.0, planned.trajectory.duration, SAMPLES)
    rows = _demands(planned.trajectory.sample(times))
    limits = {bound.name: bound.limit for bound in bounds(planned)}
    limits["yaw rate, to the right"] = -limits["yaw rate"]
    figure = make_subplots(rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.05)
    style(figure, "What it asks of the vehicle (dashed: limits; dotted: gates)")
    for row, (name, (unit, values)) in enumerate(rows.items(), start=1):
        line(figure, times, values, name, ESTIMATE, width=2.0, row=row)
        figure.update_yaxes(title_text=f"{name}<br>{unit}", row=row, col=1)
        for limited in BOUNDED_BY[name]:
            if math.isfinite(limits[limited]):
                figure.add_hline(limits[limited], line={"color": LIMIT, "width": 1, "dash": "dash"}, row=row, col=1)
    for time in planned.trajectory.gate_times:
        figure.add_vline(time, line={"color": EVENT_COLOURS["passage"], "width": 1, "dash": "dot"}, opacity=0.7)
    figure.update_xaxes(title_text="time, s", row=len(rows), col=1)
    figure.update_layout(height=HEIGHT_VEHICLE, showlegend=False, margin={"l": 70, "r": 14, "t": 44, "b": 48})
    return figure


def _demands(samples: Samples) -> Mapping[str, tuple[str, Vector]]:
    """Unit and values (n,) of what is drawn over time, by name."""
    force = samples.acceleration + np.array([0.0, 0.0, GRAVITY])
    length = np.maximum(np.linalg.norm(force, axis=1), 1e-9)
    across = np.linalg.norm(np.cross(force, samples.jerk), axis=1) / length
    return {
        "speed": ("m/s", np.linalg.norm(samples.velocity, axis=1)),
        "specific force": ("m/s²", length),
        "body rate": ("rad/s", across / length),
        "yaw rate": ("rad/s", samples.yaw_rate),
    }


def _path(planned: Planned) -> tuple[Vector, Vector]:
    """Points (n, 3) m evenly spaced in time, and their speeds (n,) m/s."""
    samples = planned.trajectory.sample(np.linspace(0.0, planned.trajectory.duration, SAMPLES))
    return samples.position, np.linalg.norm(samples.velocity, axis=1)


def _colours(speed: Vector) -> dict[str, object]:
    bar = {"title": {"text": "m/s"}, "thickness": 14, "len": 0.7}
    return {"colorscale": SPEEDS, "cmin": 0.0, "cmax": max(float(speed.max()), 1e-3), "colorbar": bar}


def _gates(planned: Planned) -> Iterable[GateEstimate]:
    return {gate.gate_id: gate for gate in planned.request.gates}.values()


def _with_gaps(strokes: Vector) -> Vector:
    """(n, k, d) strokes as one line (n (k + 1), d) that is interrupted between them."""
    n, _, d = strokes.shape
    gapped = np.concatenate((strokes, np.full((n, 1, d), np.nan)), axis=1)
    joined: Vector = gapped.reshape(-1, d)
    return joined


def _mark_in_space(figure: go.Figure, planned: Planned, path: Vector) -> None:
    """Names at the start, the end and the gates."""
    gates = list(_gates(planned))
    up = np.array([0.0, 0.0, 0.5 * planned.track.gate.opening + planned.track.gate.border + 0.25])
    points = np.array([path[0], path[-1], *(gate.position + up for gate in gates)])
    names = ["start", "end", *(f"gate {gate.gate_id}" for gate in gates)]
    if np.linalg.norm(path[0] - path[-1]) < 1.0:
        points, names = points[1:], ["start, end", *names[2:]]
    ends = len(names) - len(gates)
    x, y, z = points.T
    figure.add_trace(
        go.Scatter3d(
            x=short(x),
            y=short(y),
            z=short(z),
            mode="markers+text",
            marker={"size": [4] * ends + [0.1] * len(gates), "color": TRUE_GATE},
            text=names,
            textposition="top center",
            textfont={"size": 12, "color": TRUE_GATE},
            hoverinfo="skip",
            showlegend=False,
        )
    )


def _frame(gate: GateEstimate, inner: float, outer: float) -> go.Mesh3d:
    """A gate's frame, flat, between squares of sides ``inner`` and ``outer`` m."""
    corners = np.concatenate([gate_outline(gate.position, gate.yaw, side)[:4] for side in (inner, outer)])
    triangles = [t for k in range(4) for t in ((k, (k + 1) % 4, 4 + k), ((k + 1) % 4, 4 + (k + 1) % 4, 4 + k))]
    return _mesh(corners, triangles, FRAME, f"gate {gate.gate_id}", 0.85)


def _solid(obstacle: Box | Cylinder) -> go.Mesh3d:
    """A box or a cylinder, from its outline."""
    edge = outline(obstacle)[:-1]
    if isinstance(obstacle, Box):
        low, high = (obstacle.centre[2] + side * obstacle.size[2] for side in (-0.5, 0.5))
    else:
        low, high = obstacle.base[2], obstacle.base[2] + obstacle.height
    n = len(edge)
    corners = np.concatenate([np.column_stack((edge, np.full(n, height))) for height in (low, high)])
    sides = [t for k in range(n) for t in ((k, (k + 1) % n, n + k), ((k + 1) % n, n + (k + 1) % n, n + k))]
    lids = [(base, base + k, base + k + 1) for base in (0, n) for k in range(1, n - 1)]
    return _mesh(corners, [*sides, *lids], OBSTACLE, obstacle.name, 0.5)


def _mesh(
    corners: Vector, triangles: Iterable[tuple[int, int, int]], colour: str, name: str, opacity: float
) -> go.Mesh3d:
    i, j, k = zip(*triangles, strict=True)
    x, y, z = (short(corners[:, axis]) for axis in range(3))
    return go.Mesh3d(
        x=x, y=y, z=z, i=i, j=j, k=k, color=colour, opacity=opacity, name=name, flatshading=True, hoverinfo="name"
    )
