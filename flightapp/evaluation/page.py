"""A page of facts, figures and tables: one HTML file with everything in it, for any browser, without a network."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template

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


def page_html(
    heading: Heading,
    facts: Sequence[tuple[str, str]],
    figures: Mapping[str, go.Figure],
    tables: Sequence[TextTable],
    wide: Collection[str] = (),
) -> str:
    """The page as text; ``facts`` are names with their values, ``wide`` the figures over its whole width."""
    template = files("flightapp.evaluation").joinpath("data/report.html").read_text(encoding="utf-8")
    return Template(template).substitute(
        title=escape(heading.title),
        plotly=get_plotlyjs(),
        verdict="good" if heading.good else "",
        outcome=escape(heading.outcome),
        note=escape(heading.note),
        facts="".join(_fact(name, value) for name, value in facts),
        figures="".join(_figure(name, figure, name in wide) for name, figure in figures.items()),
        tables="".join(_table(table) for table in tables),
    )


def _fact(name: str, value: str) -> str:
    return f'<div class="fact"><b>{escape(value)}</b><span>{escape(name)}</span></div>'


def _figure(name: str, figure: go.Figure, wide: bool) -> str:
    config = {"responsive": True, "displayModeBar": False}
    drawn = to_html(figure, config=config, include_plotlyjs=False, full_html=False, div_id=f"figure-{name}")
    return f'<section class="figure{" wide" if wide else ""}">{drawn}</section>'


def _table(table: TextTable) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    rows = "".join("<tr>" + "".join(_cell(cell) for cell in row) + "</tr>" for row in table.rows)
    body = f'<div class="scroll"><table><tr>{head}</tr>{rows}</table></div>'
    return f"<section><h2>{escape(table.title)}</h2>{body}</section>"


def _cell(text: str) -> str:
    return f'<td class="no">{escape(text)}</td>' if text == "NO" else f"<td>{escape(text)}</td>"
