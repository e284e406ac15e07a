"""The numbers of "Framework and Evaluation Methodology for Autonomous Drone Racing" beside ours."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

AXES = ("x", "y", "z", "total")
SPEEDS = ("v_peak", "v_avg", "elapsed")


@dataclass(frozen=True, slots=True)
class Table:
    """One table of the paper."""

    number: int
    title: str
    mission: str
    """The mission that flies it."""
    metric: str
    """The key of a flight's summary that it holds, or "speeds"."""
    rows: Mapping[str, Mapping[str, float]]
    """The paper's numbers by v_max; the columns are `AXES` or `SPEEDS`."""

    @property
    def columns(self) -> tuple[str, ...]:
        """`AXES` or `SPEEDS`."""
        return SPEEDS if self.metric == "speeds" else AXES

    @property
    def judged(self) -> tuple[str, ...]:
        """The columns of which less is better."""
        return ("elapsed",) if self.metric == "speeds" else AXES

    def row(self, v_max: float | None) -> Mapping[str, float] | None:
        """The paper's numbers for ``v_max`` in m/s; None if it didn't fly that."""
        return None if v_max is None else self.rows.get(f"{v_max:g}")

    def ours(self, summary: Mapping[str, Any]) -> dict[str, float | None]:
        """The same numbers of a flight's ``summary``; null where it has none."""
        if self.metric == "speeds":
            return {key: summary.get(key) for key in SPEEDS}
        return {key: (summary.get(self.metric) or {}).get(key) for key in AXES}


_TITLES = {
    "lemniscate": "lemniscate",
    "five_gates": "five gates",
    "one_gate": "one gate",
    "four_gates": "four gates",
    "sim": "in simulation",
    "real": "in the real world",
}
_METRICS = {
    "tracking_rmse": "position RMSE",
    "speed_rmse": "speed RMSE",
    "estimation_rmse": "estimation RMSE",
    "speeds": "speeds",
}


@cache
def paper_tables() -> tuple[Table, ...]:
    """Tables 1 to 13, in order."""
    tables = []
    for key, rows in _data().items():
        name, _, rest = key.partition("_")
        if not name.startswith("table") or rest == "profiling_seconds":
            continue
        metric = next(metric for metric in _METRICS if rest.endswith(metric))
        mission, _, world = rest.removesuffix(f"_{metric}").rpartition("_")
        title = f"{_METRICS[metric]}, {_TITLES[mission]} {_TITLES[world]}"
        numbers = {v: row if metric == "speeds" else dict(zip(AXES, row, strict=True)) for v, row in rows.items()}
        tables.append(Table(int(name.removeprefix("table")), title, mission, metric, numbers))
    return tuple(tables)


def profiling_times() -> Mapping[str, Mapping[str, float]]:
    """Table 14: seconds by computation, then by computer ("i7_10870H", "jetson_xavier_nx")."""
    times: Mapping[str, Mapping[str, float]] = _data()["table14_profiling_seconds"]
    return times


def compared_tables(mission: str | None, v_max: float | None) -> tuple[Table, ...]:
    """The tables that hold the paper's numbers for this flight."""
    return tuple(table for table in paper_tables() if table.mission == mission and table.row(v_max) is not None)


@cache
def _data() -> dict[str, Any]:
    text = files("flightapp.evaluation").joinpath("data/paper.json").read_text(encoding="utf-8")
    data: dict[str, Any] = json.loads(text)
    return data
