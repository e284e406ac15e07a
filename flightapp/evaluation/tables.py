"""The tables of a flight: once as text, for the terminal and for the report."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.table import Table as RichTable

from flightapp.evaluation.paper import AXES, SPEEDS, Table, compared_tables

NONE = "–"

_ERRORS = {
    "tracking_rmse": ("position, reference − estimate", "m"),
    "tracking_rmse_truth": ("position, reference − truth", "m"),
    "speed_rmse": ("velocity, reference − estimate", "m/s"),
    "speed_rmse_truth": ("velocity, reference − truth", "m/s"),
    "estimation_rmse": ("position, estimate − truth", "m"),
}
_ALIGNED = {"none": "APE", "yaw": "APE, yaw aligned", "se3": "APE, SE(3) aligned"}
_SPREAD = ("rmse", "mean", "median", "std", "min", "max")
_DEGREES = math.degrees(1.0)
_LIMITS = {
    **{"rates": "roll and pitch rate", "yaw_rate": "yaw rate"},
    **{"thrust_max": "greatest thrust", "thrust_min": "least thrust"},
}
_SPEED_TITLES = {"v_peak": "v peak m/s", "v_avg": "v mean m/s", "elapsed": "elapsed s"}


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table whose cells are text; the first column holds names, the others numbers."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def flight_tables(summary: Mapping[str, Any]) -> tuple[TextTable, ...]:
    """All that there is to say of a flight in tables, the paper's beside ours where it flew the same."""
    tables = [race_table(summary), error_table(summary), pose_error_table(summary)]
    tables += [gate_table(summary), lap_table(summary), effort_table(summary)]
    tables += [timing_table(summary), latency_table(summary)]
    tables += [paper_table(table, summary) for table in compared_tables(summary["mission"], summary["v_max"])]
    tables.append(trouble_table(summary))
    return tuple(table for table in tables if table.rows)


def terminal_tables(summary: Mapping[str, Any]) -> list[RichTable]:
    """`flight_tables` for a rich console."""
    return [rich_table(table) for table in flight_tables(summary)]


def race_table(summary: Mapping[str, Any]) -> TextTable:
    """Outcome, time and speeds."""
    gates = summary["gates"]
    passed = f"{sum(gate['passed'] for gate in gates)} of {len(gates)}" if gates else NONE
    row = [
        summary["outcome"] or "not recorded",
        number(summary["elapsed"], 2),
        number(summary["v_peak"], 2),
        number(summary["v_avg"], 2),
        passed,
        str(len(summary["collisions"])),
    ]
    title = f"{summary['mission'] or 'flight'}, seed {NONE if summary['seed'] is None else summary['seed']}"
    columns = ("outcome", "elapsed s", "v peak m/s", "v mean m/s", "gates passed", "collisions")
    return TextTable(f"{title} (by {summary['judged_by']})", columns, [row])


def error_table(summary: Mapping[str, Any]) -> TextTable:
    """RMSEs per axis and total."""
    rows = []
    for key, (name, unit) in _ERRORS.items():
        if summary[key] is not None:
            rows.append([f"{name}, {unit}", *(number(summary[key][axis], 4) for axis in AXES)])
    return TextTable("RMSE (total: √ mean ‖e‖²)", ("", *AXES), rows)


def pose_error_table(summary: Mapping[str, Any]) -> TextTable:
    """The estimate's absolute and relative pose errors."""
    rows = []
    found = [(_ALIGNED[how], errors) for how, errors in (summary["estimation_ape"] or {}).items()]
    rpe = summary["estimation_rpe"]
    if rpe is not None:
        found.append((f"RPE over {rpe['step']:g} s", rpe))
    for name, errors in found:
        for part, unit, scale in (("translation", "m", 1.0), ("rotation", "°", _DEGREES)):
            if errors is not None and errors[part] is not None:
                rows.append([f"{name}, {unit}", *(number(errors[part][key], 4, scale) for key in _SPREAD)])
    return TextTable("Pose errors, estimate − truth", ("", *_SPREAD), rows)


def gate_table(summary: Mapping[str, Any]) -> TextTable:
    """Each gate of each lap."""
    several = any(gate["lap"] > 1 for gate in summary["gates"])
    rows = []
    legs = {(split["lap"], split["to"]): split["time"] for split in summary["splits"]}
    for gate in summary["gates"]:
        name = f"{gate['id']}, lap {gate['lap']}" if several else str(gate["id"])
        split, passed = legs.get((gate["lap"], str(gate["id"]))), "yes" if gate["passed"] else "NO"
        rows.append([name, passed, number(gate["time"], 2), number(split, 2), number(gate["offset"], 3)])
    columns = ("gate", "passed", "time s", "split s", "offset m")
    return TextTable(f"Gates (by {summary['judged_by']})", columns, rows)


def lap_table(summary: Mapping[str, Any]) -> TextTable:
    """Each lap's time, where there are several."""
    found = summary["laps"]
    rows = [[str(lap["lap"]), number(lap["time"], 2)] for lap in found] if len(found) > 1 else []
    return TextTable("Laps", ("lap", "time s"), rows)


def effort_table(summary: Mapping[str, Any]) -> TextTable:
    """What was asked of the vehicle, and how much of the time at its limits."""
    effort, limited = summary["effort"], summary["saturation"]
    rows = []
    if effort is not None:
        rows.append(["∫ ‖ω‖² dt, rad²/s", number(effort["rates"], 2)])
        rows.append(["thrust, mean, m/s²", number(effort["thrust_mean"], 2)])
        rows.append(["thrust, variance, m²/s⁴", number(effort["thrust_variance"], 2)])
        rows.append(["variation of the rates, rad/s²", number(effort["rates_variation"], 2)])
        rows.append(["variation of the thrust, m/s³", number(effort["thrust_variation"], 2)])
    if limited is not None:
        for key, name in _LIMITS.items():
            rows.append([f"at the limit: {name}, % of the time", number(limited[key], 1, 100.0)])
    return TextTable("Commands", ("", ""), rows)


def latency_table(summary: Mapping[str, Any]) -> TextTable:
    """How long each stage takes from a measurement to a command."""
    rows = [
        [stage, str(found["count"]), *(number(found[key], 2, 1e3) for key in ("p50", "p95", "p99"))]
        for stage, found in summary["latency"].items()
    ]
    return TextTable("Latency", ("stage", "count", "p50 ms", "p95 ms", "p99 ms"), rows)


def timing_table(summary: Mapping[str, Any]) -> TextTable:
    """The sender's punctuality and the planner's times."""
    sender, replans = summary["sender"], summary["replans"]
    rows = []
    if sender is not None:
        name = f"commands at {sender['rate']:.1f} Hz, {sender['overruns']} overruns"
        rows.append([name, *(number(sender[key], 2, 1e3) for key in ("p50", "p99", "p999"))])
        received = sender.get("received")
        if received is not None:
            name = f"as the autopilot received them: {received['rate']:.1f} Hz"
            rows.append([name, *(number(received[key], 2, 1e3) for key in ("p50", "p99", "p999"))])
    if replans["count"] or replans["refused"]:
        name = f"plans: {replans['count']} flown, {replans['refused']} refused"
        rows.append([name, *(number(replans[key], 2, 1e3) for key in ("p50", "p99")), ""])
    return TextTable("Timing", ("", "p50 ms", "p99 ms", "p99.9 ms"), rows)


def paper_table(table: Table, summary: Mapping[str, Any]) -> TextTable:
    """One of the paper's tables: ours, the paper's, and the ratio."""
    keys = SPEEDS if table.metric == "speeds" else AXES
    paper, ours = table.row(summary["v_max"]) or {}, table.ours(summary)
    ratios = {key: None if ours[key] is None else (ours[key] or 0.0) / paper[key] for key in keys}
    rows = [[name, *(number(values[key], 4) for key in keys)] for name, values in (("ours", ours), ("paper", paper))]
    rows.append(["ours / paper", *(number(ratios[key], 2) for key in keys)])
    title = f"Paper's table {table.number}: {table.title}, v_max {summary['v_max']:g} m/s"
    return TextTable(title, ("", *(_SPEED_TITLES.get(key, key) for key in keys)), rows)


def trouble_table(summary: Mapping[str, Any]) -> TextTable:
    """Faults and collisions."""
    troubles = [(fault["text"], fault["time"]) for fault in summary["faults"]]
    troubles += [(f"touched {t['obstacle']} at {t['speed']:.2f} m/s", t["time"]) for t in summary["collisions"]]
    rows = [[text, number(time, 2)] for text, time in troubles]
    return TextTable("Faults and collisions", ("what", "time s"), rows)


def number(value: float | None, decimals: int, scale: float = 1.0) -> str:
    """``value`` × ``scale`` with so many ``decimals``; a dash for None."""
    return NONE if value is None else f"{value * scale:.{decimals}f}"


def rich_table(table: TextTable) -> RichTable:
    """``table`` for a rich console."""
    made = RichTable(title=table.title, box=box.SIMPLE, title_justify="left", title_style="bold")
    for i, column in enumerate(table.columns):
        made.add_column(column, justify="left" if i == 0 else "right")
    for row in table.rows:
        made.add_row(*row)
    return made
