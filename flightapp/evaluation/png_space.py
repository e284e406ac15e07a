"""Figures in three dimensions as matplotlib draws them."""

import math
from typing import Any

import numpy as np
import plotly.graph_objects as go

from flightapp.evaluation.scene import SPEEDS
from flightapp.frames import Vector

DASHES = {"dash": "--", "dot": ":", "solid": "-"}
THIN = 0.5
"""points per pixel."""
MARKS = {"x": "x"}


def draw_in_space(drawn: Any, figure: go.Figure) -> None:
    """Draw what ``figure`` shows at once into ``drawn``, a figure of matplotlib."""
    ax = drawn.add_subplot(projection="3d", computed_zorder=True)
    _lay_out(ax, figure)
    for trace in figure.data:
        if trace.visible == "legendonly" or not np.isfinite(np.asarray(trace.x, float)).any():
            continue
        if trace.type == "mesh3d":
            _draw_mesh(ax, trace)
        elif "markers" in trace.mode:
            _draw_marks(ax, trace)
        elif np.ndim(trace.line.color) or not isinstance(trace.line.color, str):
            _draw_coloured(drawn, ax, trace)
        else:
            pen = trace.line
            label = trace.name if trace.showlegend is not False else None
            look = {"lw": THIN * pen.width, "ls": DASHES[pen.dash or "solid"], "label": label}
            ax.plot(*_points(trace).T, color=pen.color, **look)
    ax.set_title(figure.layout.title.text, loc="left", fontsize=10)
    if ax.get_legend_handles_labels()[0]:
        drawn.legend(loc="outside lower center", ncols=4)


def _lay_out(ax: Any, figure: go.Figure) -> None:
    scene = figure.layout.scene
    spans = []
    for letter in "xyz":
        low, high = getattr(scene, f"{letter}axis").range or _range(figure, letter)
        getattr(ax, f"set_{letter}lim")(low, high)
        getattr(ax, f"set_{letter}label")(f"{letter}, m")
        getattr(ax, f"{letter}axis").set_pane_color((1.0, 1.0, 1.0, 0.0))
        spans.append(high - low)
    eye = scene.camera.eye
    ax.set_box_aspect(spans, zoom=1.15)
    ax.view_init(math.degrees(math.atan2(eye.z, math.hypot(eye.x, eye.y))), math.degrees(math.atan2(eye.y, eye.x)))
    ax.locator_params(axis="z", nbins=4)


def _range(figure: go.Figure, letter: str) -> tuple[float, float]:
    every = np.concatenate([np.asarray(getattr(trace, letter), float) for trace in figure.data])
    return float(np.nanmin(every)), float(np.nanmax(every))


def _points(trace: Any) -> Vector:
    return np.column_stack([np.asarray(values, float) for values in (trace.x, trace.y, trace.z)])


def _draw_mesh(ax: Any, trace: Any) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]  # noqa: PLC0415 (an optional part)

    corners = _points(trace)[np.column_stack((trace.i, trace.j, trace.k))]
    label = trace.name if trace.showlegend else None
    ax.add_collection3d(Poly3DCollection(corners, facecolor=trace.color, alpha=trace.opacity, lw=0.0, label=label))


def _draw_marks(ax: Any, trace: Any) -> None:
    points, up = _points(trace), 0.02 * np.ptp(ax.get_zlim())
    if (symbol := trace.marker.symbol) in MARKS:
        ax.plot(*points.T, MARKS[symbol], color=trace.marker.color, ms=5, label=trace.name)
    for (x, y, z), text in zip(points, trace.text or (), strict=False):
        ax.text(x, y, z + up, text, fontsize=8, ha="center")


def _draw_coloured(drawn: Any, ax: Any, trace: Any) -> None:
    from matplotlib.colors import LinearSegmentedColormap, Normalize  # noqa: PLC0415
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # noqa: PLC0415

    points, pen = _points(trace), trace.line
    colours = [tuple(int(part) / 255.0 for part in colour[4:-1].split(",")) for colour in SPEEDS]
    scale = {"cmap": LinearSegmentedColormap.from_list("speed", colours), "norm": Normalize(pen.cmin, pen.cmax)}
    lines = Line3DCollection(np.stack((points[:-1], points[1:]), axis=1), lw=1.8, **scale)
    lines.set_array(np.asarray(pen.color, float)[:-1])
    ax.add_collection3d(lines)
    drawn.colorbar(lines, ax=ax, shrink=0.5, pad=0.08, label="m/s")
