"""Our flights beside the paper's numbers: rows with mean, deviation and ratio, and why a ratio is not below 1."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightapp.evaluation.experiments import Experiment
from flightapp.evaluation.paper import AXES, Table
from flightapp.evaluation.summary import why_failed

TRUTH = {"tracking_rmse": "tracking_rmse_truth", "speed_rmse": "speed_rmse_truth", "estimation_rmse": "tracker_rmse"}
"""What stands below our row of a table: the same by ground truth, or of the bare tracker."""
Numbers = Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class Row:
    """One v_max of one table."""

    table: Table
    v_max: float
    vehicle: str
    flights: int
    good: int
    """Those that succeeded; all numbers are theirs."""
    ours: Numbers
    """Mean by column."""
    deviation: Numbers
    """Standard deviation by column, of at least two flights."""
    other: Numbers | None
    """Means of what `TRUTH` says."""
    paper: Mapping[str, float] | None
    """None where the paper flew nothing like it."""
    why: tuple[str, ...]
    """For each number that is not better than the paper's: why not; and why flights failed."""

    @property
    def ratio(self) -> dict[str, float | None]:
        """Ours by the paper's."""
        if self.paper is None:
            return dict.fromkeys(self.table.columns)
        return {column: _ratio(self.ours[column], self.paper[column]) for column in self.table.columns}


def rows_of(table: Table, experiment: Experiment, v_max: float, results: Sequence[Mapping[str, Any]]) -> Row:
    """The row of ``table`` for the `Result`s of flights of ``experiment`` at ``v_max`` (m/s)."""
    failures = [str(r.get("why") or why_failed(r["summary"])) for r in results]
    good = [r["summary"] for r, why in zip(results, failures, strict=True) if not why]
    numbers = [table.ours(summary) for summary in good]
    ours = {column: _mean([n[column] for n in numbers]) for column in table.columns}
    deviation = {column: _deviation([n[column] for n in numbers]) for column in table.columns}
    other = None
    if table.metric in TRUTH:
        others = [summary.get(TRUTH[table.metric]) or {} for summary in good]
        other = {column: _mean([n.get(column) for n in others]) for column in AXES}
    paper = table.row(v_max) if v_max in experiment.v_max else None
    why = [*_why_failed([text for text in failures if text], len(results))]
    if paper is not None:
        why += _why_not_better(table, v_max, ours, paper)
    vehicle = experiment.vehicle.stem.removeprefix("sim_")
    return Row(table, v_max, vehicle, len(results), len(good), ours, deviation, other, paper, tuple(why))


def row_json(row: Row) -> dict[str, Any]:
    """The machine-readable row."""
    return {
        "v_max": row.v_max,
        "vehicle": row.vehicle,
        "flights": row.flights,
        "good": row.good,
        "ours": dict(row.ours),
        "deviation": dict(row.deviation),
        "by_truth" if row.table.metric != "estimation_rmse" else "tracker": row.other and dict(row.other),
        "paper": row.paper and dict(row.paper),
        "ratio": row.ratio,
        "why": list(row.why),
    }


def _why_failed(failures: Sequence[str], flights: int) -> list[str]:
    if not failures:
        return []
    kinds = ", ".join(f"{failures.count(text)} × {text}" for text in dict.fromkeys(failures))
    return [f"{len(failures)} of {flights} flights failed: {kinds}"]


def _why_not_better(table: Table, v_max: float, ours: Numbers, paper: Mapping[str, float]) -> list[str]:
    """A sentence for each number of which less is better, and that is not less than the paper's."""
    told = []
    for column in table.judged:
        ratio = _ratio(ours[column], paper[column])
        if ratio is None or ratio < 1.0:
            continue
        told.append(f"{column} {ratio:.2f} × the paper's: {_reason(table, column, ours, paper)}")
    return told


def _reason(table: Table, column: str, ours: Numbers, paper: Mapping[str, float]) -> str:
    largest = max(AXES[:3], key=lambda axis: paper.get(axis, 0.0))
    if column == "total" and paper["total"] < paper[largest]:
        root = math.sqrt(math.fsum(paper[axis] ** 2 for axis in AXES[:3]))
        against = _ratio(ours["total"], root) or math.nan
        return (
            f"the paper's total, {paper['total']:.4f}, is less than its {largest}, {paper[largest]:.4f}; against the"
            f" root of its axes' squares, {root:.4f}, which is what ours is, the ratio is {against:.2f}"
        )
    return REASONS.get((table.number, column), "not explained")


REASONS: Mapping[tuple[int, str], str] = {}
"""Why a column of a table is not better than the paper's, where it is not."""


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _deviation(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.std(known, ddof=1)) if len(known) > 1 else None


def _ratio(ours: float | None, paper: float) -> float | None:
    return None if ours is None else ours / paper
