"""A sweep as tables, and as one page with a plot of success against the settings."""

from collections.abc import Mapping, Sequence
from typing import Any

import plotly.graph_objects as go

from flightapp.evaluation.figures import blank
from flightapp.evaluation.page import Heading, page_html
from flightapp.evaluation.tables import TextTable, number

COLOURS = ("#1d4ed8", "#d1495b", "#5a9e4b", "#a878c8", "#e8871e", "#0e7490", "#6b7280")
SUCCESS, FAILURES = "Success", "Failures"
ASIDE = 0.008
"""Of the axis, between series."""
SHOWN = 30
"""Failures that a table lists, at most."""

Sweep = Mapping[str, Any]
"""What `sweep_json` makes."""


def sweep_tables(sweep: Sweep) -> list[TextTable]:
    """Success by combination of settings, what was measured besides, and what failed."""
    return [table for table in (success_table(sweep), _error_table(sweep), failure_table(sweep)) if table.rows]


def success_table(sweep: Sweep) -> TextTable:
    """Success and time of each combination, and of all."""
    keys = list(sweep["points"][0]["parameters"]) if sweep["points"] else []
    rows = [[*point["parameters"].values(), *_counted(point)] for point in sweep["points"]]
    if len(rows) != 1:
        rows.append([*(["all"] + [""] * len(keys))[: len(keys)], *_counted(sweep)])
    columns = (*keys, "runs", "good", "rate", "95 % interval", "elapsed p50 s", "p95 s", "offset p50 m", "worst m")
    return TextTable(SUCCESS, columns, rows)


def _counted(point: Mapping[str, Any]) -> list[str]:
    elapsed, offset = point["elapsed"], point["offset"]
    return [
        str(point["runs"]),
        str(point["successes"]),
        f"{100.0 * point['rate']:.1f} %",
        interval(point["ci95"]),
        number(elapsed["p50"], 2),
        number(elapsed["p95"], 2),
        number(offset["p50"], 2),
        number(offset["max"], 2),
    ]


def interval(ci95: Sequence[float]) -> str:
    """An interval of rates in per cent."""
    low, high = ci95
    return f"{100.0 * low:.1f} to {100.0 * high:.1f} %"


def _error_table(sweep: Sweep) -> TextTable:
    """How well the state was known."""
    rows = []
    for point in sweep["points"]:
        if (errors := point["estimation"]) is not None:
            ours, theirs, nees = errors["rmse"]["p50"], errors["tracker_rmse"]["p50"], errors["nees"]["mean"]
            rows.append([_words(point["parameters"]), number(ours, 3), number(theirs, 3), number(nees, 2)])
    return TextTable("Position by truth, median of RMSEs", ("", "estimate m", "tracker m", "NEES (3)"), rows)


def failure_lines(sweep: Sweep) -> list[str]:
    """What failed, for a terminal, from which the commands can be copied."""
    failed = [flight for flight in sweep["flights"] if flight["why"]]
    lines = [line for f in failed[:SHOWN] for line in (f"seed {f['seed']}: {f['why']}", f"    {f['command']}")]
    return lines + [f"and {len(failed) - SHOWN} more"] * (len(failed) > SHOWN)


def failure_table(sweep: Sweep) -> TextTable:
    """What failed, and what flies it alone."""
    failed = [flight for flight in sweep["flights"] if flight["why"]]
    rows = [[f"seed {f['seed']}: {f['why']}", f["command"]] for f in failed[:SHOWN]]
    more = f", the first {SHOWN} of them" if len(failed) > SHOWN else ""
    return TextTable(f"{FAILURES}: {len(failed)}{more}", ("what", "flown alone by"), rows)


def sweep_page(sweep: Sweep, title: str, command: str) -> str:
    """The page; ``command`` made the sweep."""
    low, high = sweep["ci95"]
    facts = (
        ("flights", str(sweep["runs"])),
        ("successes", str(sweep["successes"])),
        ("rate", f"{100.0 * sweep['rate']:.1f} %"),
        ("95 % interval (Wilson)", f"{100.0 * low:.1f} to {100.0 * high:.1f} %"),
        ("elapsed p50, s", number(sweep["elapsed"]["p50"], 2)),
        ("elapsed p95, s", number(sweep["elapsed"]["p95"], 2)),
    )
    good = sweep["successes"] == sweep["runs"]
    verdict = "all good" if good else f"{sweep['runs'] - sweep['successes']} failed"
    figures = {"success": success_figure(sweep), "elapsed": elapsed_figure(sweep)}
    tables = sweep_tables(sweep)
    wide = [table.title for table in tables if table.title.startswith((SUCCESS, FAILURES))]
    return page_html(Heading(title, verdict, good, command), facts, figures, tables, wide)


def success_figure(sweep: Sweep) -> go.Figure:
    """The success rate over the first setting, a line for each combination of the others, with Wilson's intervals."""
    figure = blank("Success, with 95 % intervals", _first(sweep), "%")
    for n, (name, xs, points) in enumerate(_series(sweep)):
        rates = [100.0 * point["rate"] for point in points]
        below = [rate - 100.0 * point["ci95"][0] for rate, point in zip(rates, points, strict=True)]
        above = [100.0 * point["ci95"][1] - rate for rate, point in zip(rates, points, strict=True)]
        _draw(figure, n, name, xs, rates, {"type": "data", "array": above, "arrayminus": below, "width": 6})
    figure.update_yaxes(range=[-4.0, 104.0])
    return _marked(figure, sweep)


def elapsed_figure(sweep: Sweep) -> go.Figure:
    """The successes' median times, up to their 95th percentile."""
    figure = blank("Elapsed time of successes, p50 to p95", _first(sweep), "s")
    for n, (name, xs, points) in enumerate(_series(sweep)):
        times = [point["elapsed"]["p50"] for point in points]
        above = [0.0 if t is None else point["elapsed"]["p95"] - t for t, point in zip(times, points, strict=True)]
        flat = [0.0] * len(above)
        _draw(figure, n, name, xs, times, {"type": "data", "array": above, "arrayminus": flat, "width": 6})
    figure.update_yaxes(rangemode="tozero")
    return _marked(figure, sweep)


def _draw(figure: go.Figure, n: int, name: str, x: list[Any], y: list[Any], spread: Mapping[str, Any]) -> None:
    """One series; those of numbers stand a little beside each other, so that all error bars are seen."""
    if len(x) > 1 and all(isinstance(value, float) for value in x):
        x = [value + ASIDE * n * (max(x) - min(x)) for value in x]
    colour = COLOURS[n % len(COLOURS)]
    marker, pen = {"color": colour, "size": 9}, {"color": colour, "width": 1.5}
    look = {"mode": "lines+markers", "marker": marker, "line": pen, "showlegend": bool(name)}
    figure.add_trace(go.Scatter(x=x, y=y, name=name, error_y=dict(spread), **look))


def _first(sweep: Sweep) -> str:
    parameters = sweep["points"][0]["parameters"] if sweep["points"] else {}
    return next(iter(parameters), "")


def _series(sweep: Sweep) -> list[tuple[str, list[Any], list[Mapping[str, Any]]]]:
    """For each combination of all settings but the first: its name, the first's values, and the points."""
    series: dict[str, list[Mapping[str, Any]]] = {}
    for point in sweep["points"]:
        others = dict(list(point["parameters"].items())[1:])
        series.setdefault(_words(others), []).append(point)
    first = _first(sweep)
    return [
        (name, [_value(point["parameters"].get(first, "all")) for point in points], points)
        for name, points in series.items()
    ]


def _marked(figure: go.Figure, sweep: Sweep) -> go.Figure:
    """With an axis of names where the first setting's values are no numbers."""
    values = {point["parameters"].get(_first(sweep), "all") for point in sweep["points"]}
    if any(isinstance(_value(value), str) for value in values):
        figure.update_xaxes(type="category")
    return figure


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _words(parameters: Mapping[str, str]) -> str:
    return ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in parameters.items())
