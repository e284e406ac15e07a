"""A page of facts, figures and tables: one HTML file with everything in it, for any browser, without a network."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template
from typing import Any, Protocol

import plotly.graph_objects as go
from plotly.io import to_html
from plotly.offline import get_plotlyjs

from flightapp.evaluation.tables import TextTable


@dataclass(frozen=True, slots=True)
class Heading:
    """The first line of a page."""

    title: str
    outcome: str
    good: bool
    """Whether the outcome is."""
    note: str


@dataclass(frozen=True, slots=True)
class Linked:
    """Figures over time beside a scene in which vehicles move with the cursor."""

    scene: go.Figure
    series: Mapping[str, go.Figure]
    moving: Mapping[str, Any]
    """What moves: see `flightapp.evaluation.space.moving`."""


class Shown(Protocol):
    """An image with a caption."""

    @property
    def caption(self) -> str:
        """What it shows."""
        ...

    @property
    def uri(self) -> str:
        """The image as a data URI."""
        ...


def page_html(
    heading: Heading,
    facts: Sequence[tuple[str, str]],
    figures: Mapping[str, go.Figure],
    tables: Sequence[TextTable],
    wide: Collection[str] = (),
    *,
    linked: Linked | None = None,
    images: Sequence[Shown] = (),
    images_title: str = "",
) -> str:
    """The page as text; ``facts`` are names with their values, ``wide`` the figures (by name) and tables (by title)
    over its whole width."""
    data = files("flightapp.evaluation").joinpath("data")
    return Template(data.joinpath("report.html").read_text(encoding="utf-8")).substitute(
        title=escape(heading.title),
        plotly=get_plotlyjs(),
        verdict="good" if heading.good else "",
        outcome=escape(heading.outcome),
        note=escape(heading.note),
        facts="".join(_fact(name, value) for name, value in facts),
        linked=_linked(linked, data.joinpath("linked.js").read_text(encoding="utf-8")) if linked else "",
        images=_images(images_title, images) if images else "",
        figures="".join(_figure(name, figure, name in wide) for name, figure in figures.items()),
        tables="".join(_table(table, table.title in wide) for table in tables),
    )


def _fact(name: str, value: str) -> str:
    return f'<div class="fact"><b>{escape(value)}</b><span>{escape(name)}</span></div>'


def _linked(linked: Linked, script: str) -> str:
    series = "".join(f'<section class="figure">{_drawn(name, fig)}</section>' for name, fig in linked.series.items())
    controls = (
        '<div class="controls"><button id="play" type="button" aria-label="play">▶</button>'
        '<input id="time" type="range" step="any" aria-label="time"><output id="now"></output></div>'
    )
    scene = f'<section class="figure scene"><div class="view">{_drawn("scene", linked.scene)}</div>{controls}</section>'
    moving = json.dumps(linked.moving, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    data = f'<script type="application/json" id="moving">{moving}</script>'
    return f'<div class="linked">{scene}<div class="series">{series}</div></div>{data}<script>{script}</script>'


def _images(title: str, images: Sequence[Shown]) -> str:
    shown = "".join(
        f'<figure><img src="{image.uri}" alt="{escape(image.caption)}" loading="lazy">'
        f"<figcaption>{escape(image.caption)}</figcaption></figure>"
        for image in images
    )
    return f'<section class="images"><h2>{escape(title)}</h2><div class="gallery">{shown}</div></section>'


def _figure(name: str, figure: go.Figure, wide: bool) -> str:
    return f'<section class="figure{" wide" if wide else ""}">{_drawn(name, figure)}</section>'


def _drawn(name: str, figure: go.Figure) -> str:
    config = {"responsive": True, "displayModeBar": False}
    drawn: str = to_html(figure, config=config, include_plotlyjs=False, full_html=False, div_id=f"figure-{name}")
    return drawn


def _table(table: TextTable, wide: bool) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    rows = "".join("<tr>" + "".join(_cell(cell) for cell in row) + "</tr>" for row in table.rows)
    body = f'<div class="scroll"><table><tr>{head}</tr>{rows}</table></div>'
    kind = "wide" if wide else ""
    return f'<section class="{kind}"><h2>{escape(table.title)}</h2>{body}</section>'


def _cell(text: str) -> str:
    return f'<td class="no">{escape(text)}</td>' if text == "NO" else f"<td>{escape(text)}</td>"
