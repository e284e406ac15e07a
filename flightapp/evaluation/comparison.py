"""Modules side by side: one row for each combination, over the same seeds."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from flightapp.evaluation.figures import blank
from flightapp.evaluation.page import Heading, page_html
from flightapp.evaluation.sweep import sweep_json
from flightapp.evaluation.sweep_page import COLOURS, failure_table, interval
from flightapp.evaluation.tables import TextTable, number

ERRORS = ("tracking_rmse", "tracking_rmse_truth", "estimation_rmse")
"""Totals of a summary of which a row has the median."""


def comparison_json(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The machine-readable comparison of `Result`s; "parameters" of each are its modules by kind.

    As `sweep_json`, and each point with medians over its flights of the errors (m), and the mean number of commands
    for which another controller stood in; null where that is not known. Errors are of all flights with a summary,
    those that failed too.
    """
    sweep = sweep_json(results)
    flown: dict[str, list[Mapping[str, Any]]] = {}
    for result in results:
        flown.setdefault(result["label"], []).append(result)
    for point, of_it in zip(sweep["points"], flown.values(), strict=True):
        summaries = [result["summary"] for result in of_it if "summary" in result]
        for name in ERRORS:
            totals = [summary[name]["total"] for summary in summaries if summary.get(name)]
            point[name] = float(np.median(totals)) if totals else None
        stood_in = [result["fallbacks"] for result in of_it if result.get("fallbacks") is not None]
        point["fallbacks"] = float(np.mean(stood_in)) if stood_in else None
    return sweep


MEANING = (
    "Medians over the seeds. By estimate, by truth: RMSE of reference − estimate and of reference − truth; estimate: of"
    " estimate − truth; gate: distance from its centre; stood in: commands a flight for which another controller did"
)


def comparison_tables(comparison: Mapping[str, Any]) -> list[TextTable]:
    """The one table, and what failed; `MEANING` says what the columns are."""
    points = comparison["points"]
    rows = [
        [
            *point["parameters"].values(),
            f"{point['successes']} of {point['runs']}",
            interval(point["ci95"]),
            number(point["elapsed"]["p50"], 2),
            *(number(point[name], 3) for name in ERRORS),
            number(point["offset"]["p50"], 3),
            number(point["offset"]["max"], 2),
            number(point["fallbacks"], 1),
        ]
        for point in points
    ]
    kinds = points[0]["parameters"] if points else {}
    measured = ("elapsed s", "by estimate m", "by truth m", "estimate m", "gate m", "worst m", "stood in")
    table = TextTable("Modules compared", (*kinds, "good", "95 % interval", *measured), rows)
    return [part for part in (table, failure_table(comparison)) if part.rows]


def comparison_page(comparison: Mapping[str, Any], title: str, command: str) -> str:
    """The page; ``command`` made the comparison."""
    good = comparison["successes"] == comparison["runs"]
    failed = comparison["runs"] - comparison["successes"]
    heading = Heading(title, "all good" if good else f"{failed} failed", good, f"{MEANING} · {command}")
    facts = (
        ("combinations", str(len(comparison["points"]))),
        ("flights", str(comparison["runs"])),
        ("successes", str(comparison["successes"])),
    )
    tables = comparison_tables(comparison)
    figures = {"success": _success(comparison), "errors": _errors(comparison)}
    return page_html(heading, facts, figures, tables, [table.title for table in tables])


def _success(comparison: Mapping[str, Any]) -> go.Figure:
    points = comparison["points"]
    figure = blank("Success, with 95 % intervals", "", "%")
    rates = [100.0 * point["rate"] for point in points]
    low = [rate - 100.0 * point["ci95"][0] for rate, point in zip(rates, points, strict=True)]
    high = [100.0 * point["ci95"][1] - rate for rate, point in zip(rates, points, strict=True)]
    spread = {"type": "data", "array": high, "arrayminus": low, "width": 6}
    marker = {"color": COLOURS[0], "size": 10}
    trace = go.Scatter(x=_names(comparison), y=rates, mode="markers", marker=marker, error_y=spread, showlegend=False)
    figure.add_trace(trace)
    figure.update_yaxes(range=[-4.0, 104.0])
    return figure


def _errors(comparison: Mapping[str, Any]) -> go.Figure:
    figure = blank("Errors, median of RMSEs", "", "m")
    names = ("reference − estimate", "reference − truth", "estimate − truth")
    for n, (key, name) in enumerate(zip(ERRORS, names, strict=True)):
        values = [point[key] for point in comparison["points"]]
        figure.add_trace(go.Bar(x=_names(comparison), y=values, name=name, marker_color=COLOURS[n]))
    figure.update_layout(barmode="group")
    return figure


def _names(comparison: Mapping[str, Any]) -> list[str]:
    return ["<br>".join(point["parameters"].values()) for point in comparison["points"]]
