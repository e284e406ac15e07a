"""Solids, gates and axes of figures in three dimensions; world frame, metres."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.colors import sample_colorscale

from flightapp.evaluation.figures import OBSTACLE, TRUE_GATE, short, with_gaps
from flightapp.evaluation.gates import gate_outline
from flightapp.evaluation.solids import outline
from flightapp.frames import Vector
from flightapp.messages import GateEstimate
from flightapp.track import Box, Cylinder, GateShape

SPEEDS = sample_colorscale("Turbo", np.linspace(0.06, 0.9, 15).tolist())
"""The colours of the speed, without the ends of their scale, which are all but black."""
EYE, CENTRE = {"x": -0.6, "y": -2.1, "z": 1.25}, {"x": 0.0, "y": 0.0, "z": -0.22}
"""Where a scene is seen from, and what is in its middle, as plotly counts it: the whole track at once."""
SIGMAS = 3.0
"""Size of the ellipsoids of uncertainty."""
RINGS, SECTORS = 8, 14
"""Of a drawn ball."""


def speed_colours(speed: Vector) -> dict[str, Any]:
    """Colour scale and its bar for ``speed`` (n,) in m/s."""
    bar = {"title": {"text": "m/s"}, "thickness": 12, "len": 0.6}
    return {"colorscale": SPEEDS, "cmin": 0.0, "cmax": max(float(speed.max(initial=0.0)), 1e-3), "colorbar": bar}


def draw_line(figure: go.Figure, points: Vector, name: str, colour: str, **look: Any) -> None:
    """Draw the line through ``points`` (n, 3); ``look`` has what plotly's Scatter3d takes, and "width" and "dash"."""
    pen = {"color": colour, "width": look.pop("width", 4), "dash": look.pop("dash", "solid")}
    x, y, z = short(points).T
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, mode="lines", name=name, line=pen, hoverinfo="skip", **look))


def gate_lines(gates: Iterable[GateEstimate], opening: float) -> Vector:
    """(n, 3) the outlines of openings with gaps between."""
    return with_gaps([gate_outline(gate.position, gate.yaw, opening) for gate in gates])


def frames(gates: Iterable[GateEstimate], shape: GateShape, colour: str, name: str, opacity: float) -> go.Mesh3d:
    """The frames of ``gates``, flat, as one mesh."""
    ring = [t for k in range(4) for t in ((k, (k + 1) % 4, 4 + k), ((k + 1) % 4, 4 + (k + 1) % 4, 4 + k))]
    sides = shape.opening, shape.opening + 2.0 * shape.border
    parts = [np.concatenate([gate_outline(g.position, g.yaw, side)[:4] for side in sides]) for g in gates]
    return _mesh(_joined(parts, ring), colour, name, opacity)


def ellipsoids(gates: Sequence[GateEstimate], colour: str, name: str) -> go.Mesh3d:
    """Where the centres of ``gates`` are to within `SIGMAS` standard deviations of each principal axis."""
    sphere, triangles = _ball()
    parts = []
    for gate in gates:
        variances, axes = np.linalg.eigh(gate.covariance[:3, :3])
        scale = SIGMAS * np.sqrt(np.maximum(variances, 0.0))
        parts.append(gate.position + (sphere * scale) @ axes.T)
    return _mesh(_joined(parts, triangles), colour, name, 0.25)


def solid(obstacle: Box | Cylinder) -> go.Mesh3d:
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
    return _mesh((corners, [*sides, *lids]), OBSTACLE, obstacle.name, 0.5)


def prism_edges(corners: Vector, floor: float, ceiling: float) -> Vector:
    """(n, 3) the edges, with gaps, of the prism over ``corners`` (k, 2) between two heights."""
    low, high = (np.column_stack((corners, np.full(len(corners), z))) for z in (floor, ceiling))
    strokes = [np.vstack((ring, ring[:1])) for ring in (low, high)]
    return with_gaps([*strokes, *(np.vstack(pair) for pair in zip(low, high, strict=True))])


def draw_names(figure: go.Figure, points: Vector, names: Sequence[str], sizes: Sequence[float]) -> None:
    """Write ``names`` above ``points`` (n, 3), and dots of these ``sizes`` there."""
    x, y, z = short(points).T
    figure.add_trace(
        go.Scatter3d(
            x=x,
            y=y,
            z=z,
            mode="markers+text",
            marker={"size": list(sizes), "color": TRUE_GATE},
            text=list(names),
            textposition="top center",
            textfont={"size": 12, "color": TRUE_GATE},
            hoverinfo="skip",
            showlegend=False,
        )
    )


def lay_out(figure: go.Figure, height: int | None, low: Vector | None = None, high: Vector | None = None) -> None:
    """Axes to scale, from the corner ``low`` (3,) to ``high`` (3,) if given, else around what is drawn.

    ``height`` is in px; None leaves it to the page.
    """
    flat = {"showbackground": False, "gridcolor": "#e2e8f0", "zeroline": False}
    axes: dict[str, Any] = {f"{axis}axis": {"title": f"{axis}, m", **flat} for axis in "xyz"}
    axes["zaxis"] |= {"rangemode": "tozero", "nticks": 4}
    if low is not None and high is not None:
        for i, axis in enumerate("xyz"):
            axes[f"{axis}axis"]["range"] = [float(low[i]), float(high[i])]
    scene = {"aspectmode": "data", "camera": {"eye": EYE, "center": CENTRE}, **axes}
    figure.update_layout(height=height, margin={"l": 0, "r": 0, "t": 36, "b": 0}, scene=scene)


Triangles = Sequence[tuple[int, int, int]]


def _ball() -> tuple[Vector, Triangles]:
    """Points (n, 3) of the unit sphere, and the triangles between them."""
    polar = np.linspace(0.0, math.pi, RINGS + 1)
    around = np.linspace(0.0, 2.0 * math.pi, SECTORS, endpoint=False)
    p, a = np.meshgrid(polar, around, indexing="ij")
    points = np.stack((np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)), axis=-1).reshape(-1, 3)
    triangles = []
    for ring in range(RINGS):
        for k in range(SECTORS):
            here, beside = ring * SECTORS + k, ring * SECTORS + (k + 1) % SECTORS
            triangles += [(here, beside, here + SECTORS), (beside, beside + SECTORS, here + SECTORS)]
    return points, triangles


def _joined(parts: Sequence[Vector], triangles: Triangles) -> tuple[Vector, Triangles]:
    """``parts``, each (n, 3) with the same ``triangles``, as one mesh."""
    n = len(parts[0])
    shifted = [(i + n * k, j + n * k, m + n * k) for k in range(len(parts)) for i, j, m in triangles]
    return np.concatenate(parts), shifted


def _mesh(surface: tuple[Vector, Triangles], colour: str, name: str, opacity: float) -> go.Mesh3d:
    corners, triangles = surface
    i, j, k = zip(*triangles, strict=True)
    x, y, z = short(corners).T
    return go.Mesh3d(
        x=x, y=y, z=z, i=i, j=j, k=k, color=colour, opacity=opacity, name=name, flatshading=True, hoverinfo="name"
    )
