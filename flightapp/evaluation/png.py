"""Figures as PNG for papers: drawn anew by matplotlib, from the same figures that the report shows.

It knows what this package's figures are made of: lines, marks, bars, shapes and annotations; for three dimensions see
`flightapp.evaluation.png_space`.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import plotly.graph_objects as go

from flightapp.evaluation.png_space import draw_in_space
from flightapp.frames import Vector
from flightapp.inputs import BadInputError

DPI = 200
SIZE, SIZE_IN_SPACE = (6.0, 3.4), (6.4, 4.6)
"""inches."""
DASHES = {"dash": (0, (5, 3)), "dot": (0, (1.2, 2)), "solid": "solid"}
MARKS = {"square": "s", "line-ns": "|", "x-thin": "x", "diamond": "D", "circle": "o"}
THIN = 0.75
"""points per pixel: lines are as wide as on the page."""
WORD = 0.012
"""Of the time axis, the width of a letter."""
LOOK = {
    **{"font.size": 9, "legend.frameon": False, "legend.fontsize": 8, "axes.edgecolor": "#94a3b8"},
    **{"axes.grid": True, "axes.axisbelow": True, "grid.color": "#e2e8f0", "grid.linewidth": 0.6},
}


def write_pngs(figures: Mapping[str, go.Figure], directory: Path, prefix: str) -> list[Path]:
    """Write each of ``figures`` as PREFIX-NAME.png; the files.

    Raises `BadInputError` where matplotlib is missing or the directory cannot be written to.
    """
    plt = pyplot()
    written = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            path = directory / f"{prefix}-{name}.png"
            with plt.rc_context(LOOK):
                drawn = _draw(plt, figure)
                drawn.savefig(path, dpi=DPI)
            plt.close(drawn)
            written.append(path)
    except OSError as error:
        raise BadInputError(f"--png {directory}: cannot be written: {error.strerror or error}") from None
    return written


def pyplot() -> ModuleType:
    """Matplotlib, drawing into files only; raises `BadInputError` where it is missing."""
    try:
        import matplotlib as mpl  # noqa: PLC0415 (an optional part)
    except ImportError:
        raise BadInputError("--png needs matplotlib, which is not installed: pip install 'flightapp[png]'") from None
    mpl.use("agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    return plt


def _draw(plt: ModuleType, figure: go.Figure) -> Any:
    """What ``figure`` shows, as a figure of matplotlib."""
    if any(trace.type in ("scatter3d", "mesh3d") for trace in figure.data):
        drawn = plt.figure(figsize=SIZE_IN_SPACE, layout="constrained")
        draw_in_space(drawn, figure)
        return drawn
    rows = 1 + any(getattr(trace, "yaxis", None) == "y2" for trace in figure.data)
    look = {"figsize": SIZE, "layout": "constrained", "squeeze": False, "sharex": True}
    drawn, axes = plt.subplots(rows, 1, height_ratios=[1.5, 1.0][:rows], **look)
    for row, ax in enumerate(axes[:, 0]):
        suffix = "" if row == 0 else str(row + 1)
        _lay_out(ax, figure, suffix)
        for trace in figure.data:
            if (trace.yaxis or "y") == f"y{suffix}":
                _draw_trace(ax, trace, getattr(figure.layout, f"yaxis{suffix}").categoryarray)
        _draw_lines(ax, figure)
    axes[0, 0].set_title(_plain(figure.layout.title.text), loc="left", fontsize=10, pad=14)
    _draw_texts(axes[0, 0], figure)
    shown = [pair for ax in axes[:, 0] for pair in zip(*ax.get_legend_handles_labels(), strict=True)]
    if shown and figure.layout.showlegend is not False:
        columns = len(shown) if len(shown) <= 5 else 3
        drawn.legend(*zip(*shown, strict=True), loc="outside lower center", ncols=columns)
    return drawn


def _lay_out(ax: Any, figure: go.Figure, suffix: str) -> None:
    x, y = (getattr(figure.layout, f"{axis}axis{suffix}") for axis in "xy")
    ax.set_xlabel(_plain(x.title.text))
    ax.set_ylabel(_plain(y.title.text))
    if x.range is not None:
        ax.set_xlim(*x.range)
    if y.type == "log":
        ax.set_yscale("log")
        ax.set_ylim(*(10.0 ** np.array(y.range, float)))
    elif y.range is not None:
        ax.set_ylim(*y.range)
    if y.categoryarray is not None:
        ax.set_yticks(range(len(y.categoryarray)), y.categoryarray)
        ax.grid(False, axis="y")
    if y.scaleanchor:
        ax.set_aspect("equal", adjustable="datalim")


def _draw_trace(ax: Any, trace: Any, rows: Sequence[str] | None) -> None:
    x, y = _numbers(trace.x), _numbers(trace.y if rows is None else [rows.index(row) for row in trace.y])
    label = trace.name if trace.name and trace.showlegend is not False else None
    if trace.type == "bar" and trace.orientation == "h":
        _draw_bars(ax, trace, x, y)
    elif trace.type == "bar":
        ax.bar(x, y, _numbers(trace.width), color=trace.marker.color)
    elif "markers" in trace.mode:
        look = {"color": trace.marker.color, "ms": THIN * trace.marker.size, "clip_on": False, "zorder": 3}
        ax.plot(x, y, MARKS[trace.marker.symbol], **look)
        for place in zip(x, y, trace.text or (), strict=False):
            ax.annotate(place[2], place[:2], (0, -12), textcoords="offset points", ha="center", fontsize=7)
    else:
        pen = trace.line
        if trace.fill == "toself":
            ax.fill(x, y, color=pen.color, alpha=0.5)
        ax.plot(x, y, color=pen.color, lw=THIN * pen.width, ls=DASHES[pen.dash or "solid"], label=label)


def _draw_bars(ax: Any, trace: Any, widths: Vector, rows: Vector) -> None:
    low, high = ax.get_xlim()
    for left, width, row, colour, text in zip(trace.base, widths, rows, trace.marker.color, trace.text, strict=True):
        ax.barh(row, width, 0.75, left=left, color=colour, ec="white", lw=0.6, zorder=2)
        if width > WORD * (len(text) + 1) * (high - low):
            ax.text(left + 0.5 * width, row, text, ha="center", va="center", fontsize=7, zorder=4)


def _draw_lines(ax: Any, figure: go.Figure) -> None:
    for shape in figure.layout.shapes:
        if shape.x0 == shape.x1:
            pen = shape.line
            ax.axvline(shape.x0, color=pen.color, lw=THIN * pen.width, ls=DASHES[pen.dash or "solid"], zorder=1)


def _draw_texts(ax: Any, figure: go.Figure) -> None:
    for note in figure.layout.annotations:
        font = {"fontsize": THIN * (note.font.size or 12), "color": note.font.color, "ha": "center", "va": "bottom"}
        above = note.yref == "paper"
        place = ax.get_xaxis_transform() if above else "data"
        shift = (0, 1) if above else (THIN * (note.xshift or 0), THIN * (note.yshift or 0))
        ax.annotate(_plain(note.text), (note.x, note.y), shift, xycoords=place, textcoords="offset points", **font)


def _numbers(values: Any) -> Vector:
    """``values`` as numbers, with NaN for None."""
    return np.array([] if values is None else list(values), float)


def _plain(text: str | None) -> str:
    return re.sub(r"<[^>]*>", "", text or "")
