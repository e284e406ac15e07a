"""The paper's tables with ours, as text: for the terminal, the page and the documents."""

from collections.abc import Mapping, Sequence
from typing import Any

from flightapp.evaluation.paper import profiling_times
from flightapp.evaluation.paper_rows import Numbers, Row
from flightapp.evaluation.tables import NONE, TextTable, number

DECIMALS = {"elapsed": 2}
"""Of a column; others have four."""
_UNITS = {"tracking_rmse": "m", "speed_rmse": "m/s", "estimation_rmse": "m"}
_SPEEDS = {"v_peak": "v peak m/s", "v_avg": "v mean m/s", "elapsed": "elapsed s"}
PROFILE: Mapping[str, tuple[str, str]] = {
    "controller": ("controller", "controller, one command"),
    "plan_6": ("trajectory_6_points", "trajectory, 6 points"),
    "plan_14": ("trajectory_14_points", "trajectory, 14 points"),
    "plan_26": ("trajectory_26_points", "trajectory, 26 points"),
    "aruco_full": ("aruco", "markers in a whole image, and their poses"),
}
"""Rows of `flightapp bench` with the paper's."""


def paper_table_text(rows: Sequence[Row]) -> TextTable:
    """One of the paper's tables: for each v_max ours (mean ± deviation), by truth, the paper's, and the ratio."""
    table = rows[0].table
    unit = _UNITS.get(table.metric)
    columns = ("", *(_SPEEDS.get(column, column) for column in table.columns), "good")
    lines: list[list[str]] = []
    for row in rows:
        lines += _lines(row)
    title = f"Table {table.number}: {table.title}" + (f", {unit}" if unit else "")
    return TextTable(title, columns, lines)


def _lines(row: Row) -> list[list[str]]:
    columns = row.table.columns
    vehicle = f", {row.vehicle}" if row.paper is None else ""
    ours = [_spread(row.ours[column], row.deviation[column], column) for column in columns]
    lines = [[f"v_max {row.v_max:g}{vehicle}: ours", *ours, f"{row.good} of {row.flights}"]]
    if row.other is not None:
        name = "tracker alone" if row.table.metric == "estimation_rmse" else "by truth"
        lines.append([name, *_numbers(row.other, columns), ""])
    if row.closer is not None:
        lines.append([row.closer_name, *_numbers(row.closer, columns), ""])
    if row.paper is not None:
        lines.append(["paper", *_numbers(row.paper, columns), ""])
        lines.append(["ours / paper", *(_marked(row, column) for column in columns), ""])
    return lines


def _marked(row: Row, column: str) -> str:
    """The ratio, with a star where less is better and it isn't less."""
    ratio = row.ratio[column]
    return _starred(ratio, 2) if column in row.table.judged else number(ratio, 2)


def _starred(ratio: float | None, decimals: int) -> str:
    return number(ratio, decimals) + "*" * (ratio is not None and ratio >= 1.0)


def _numbers(values: Numbers | Mapping[str, float], columns: Sequence[str]) -> list[str]:
    return [number(values.get(column), DECIMALS.get(column, 4)) for column in columns]


def _spread(mean: float | None, deviation: float | None, column: str) -> str:
    decimals = DECIMALS.get(column, 4)
    return number(mean, decimals) + ("" if deviation is None else f" ± {deviation:.{decimals}f}")


def remark_lines(rows: Mapping[int, Sequence[Row]]) -> list[tuple[str, str]]:
    """Which row of which table is not better than the paper's, or had failures, and why."""
    return [
        (f"table {n}, v_max {row.v_max:g}{'' if row.paper else f' ({row.vehicle})'}", why)
        for n, of_it in rows.items()
        for row in of_it
        for why in row.why
    ]


def profile_remarks(profile: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Which computation takes longer here than on the paper's faster computer."""
    paper = {name: profiling_times()[key]["i7_10870H"] for name, (key, _) in PROFILE.items()}
    slower = {row["name"]: row["p50"] / paper[row["name"]] for row in profile if row["name"] in paper}
    why = "another computer, and a law with drag, snap and inverted lags, which the paper's has not"
    return [
        (f"table 14, {PROFILE[name][1]}", f"{ratio:.2f} × the i7's: {why if name == 'controller' else 'not explained'}")
        for name, ratio in slower.items()
        if ratio >= 1.0
    ]


def profile_table(profile: Sequence[Mapping[str, Any]]) -> TextTable:
    """Table 14: computation times on this computer beside the paper's."""
    measured = {row["name"]: row for row in profile}
    paper = profiling_times()
    rows = []
    for name, (key, title) in PROFILE.items():
        if name in measured:
            ours, i7, jetson = measured[name]["p50"], paper[key]["i7_10870H"], paper[key]["jetson_xavier_nx"]
            rows.append([title, duration(ours), duration(i7), duration(jetson), _starred(ours / i7, 4)])
    columns = ("", "ours, here", "paper, i7-10870H", "paper, Jetson Xavier NX", "ours / i7")
    return TextTable("Table 14: computation times, median", columns, rows)


def duration(seconds: float | None) -> str:
    """Seconds with the unit that fits."""
    if seconds is None:
        return NONE
    for unit, scale in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)):
        if seconds * scale >= 1.0:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"
