"""The figures of a plan: its line in space with the speed as colour, and what it asks of the vehicle over time."""

import math
from collections.abc import Iterable, Mapping

import numpy as np
import plotly.graph_objects as go
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
    with_gaps,
)
from flightapp.evaluation.gates import gate_outline
from flightapp.evaluation.planned import Planned, bounds, heading_ticks
from flightapp.evaluation.scene import draw_names, frames, lay_out, solid, speed_colours
from flightapp.evaluation.solids import outline
from flightapp.frames import GRAVITY, Vector
from flightapp.messages import GateEstimate
from flightapp.trajectory import Samples

SAMPLES = 1200
"""Points that a line is drawn with."""
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
        figure.add_trace(solid(obstacle))
    for gate in _gates(planned):
        figure.add_trace(frames([gate], planned.track.gate, FRAME, f"gate {gate.gate_id}", 0.85))
    path, speed = _path(planned)
    pen = {"color": short(speed), "width": 7, **speed_colours(speed)}
    hover = "%{x:.2f}, %{y:.2f}, %{z:.2f} m<br>%{text}<extra></extra>"
    x, y, z = (short(path[:, axis]) for axis in range(3))
    text = [f"{value:.2f} m/s" for value in speed]
    figure.add_trace(
        go.Scatter3d(x=x, y=y, z=z, mode="lines", line=pen, text=text, hovertemplate=hover, showlegend=False)
    )
    _mark_in_space(figure, planned, path)
    lay_out(figure, HEIGHT_3D)
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
    dots = {"color": short(speed), "size": 5, **speed_colours(speed)}
    x, y = short(path[:, 0]), short(path[:, 1])
    hover = "%{x:.2f}, %{y:.2f} m<br>%{marker.color:.2f} m/s<extra></extra>"
    figure.add_trace(go.Scatter(x=x, y=y, mode="markers", marker=dots, hovertemplate=hover, showlegend=False))
    ticks = with_gaps(heading_ticks(planned.trajectory, TICK_INTERVAL, TICK_LENGTH).transpose(1, 0, 2))
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


def _gates(planned: Planned) -> Iterable[GateEstimate]:
    return {gate.gate_id: gate for gate in planned.request.gates}.values()


def _mark_in_space(figure: go.Figure, planned: Planned, path: Vector) -> None:
    """Names at the start, the end and the gates."""
    gates = list(_gates(planned))
    up = np.array([0.0, 0.0, 0.5 * planned.track.gate.opening + planned.track.gate.border + 0.25])
    points = np.array([path[0], path[-1], *(gate.position + up for gate in gates)])
    names = ["start", "end", *(f"gate {gate.gate_id}" for gate in gates)]
    if np.linalg.norm(path[0] - path[-1]) < 1.0:
        points, names = points[1:], ["start, end", *names[2:]]
    ends = len(names) - len(gates)
    draw_names(figure, points, names, [4.0] * ends + [0.1] * len(gates))
