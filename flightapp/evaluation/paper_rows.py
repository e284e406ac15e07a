"""Our flights beside the paper's numbers: rows with mean, deviation and ratio, and why a ratio is not below 1."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightapp.evaluation.experiments import Experiment
from flightapp.evaluation.paper import AXES, Table
from flightapp.evaluation.summary import why_failed
from flightapp.evaluation.tables import number

TRUTH = {"tracking_rmse": "tracking_rmse_truth", "speed_rmse": "speed_rmse_truth", "estimation_rmse": "tracker_rmse"}
"""What stands below our row of a table: the same by ground truth, or of the bare tracker."""
TRACKER = "the tracker alone"
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
    closer: Numbers | None
    """Means of flights that are closer to the paper's, where there are any."""
    closer_name: str
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


def row_of(
    table: Table,
    experiment: Experiment,
    v_max: float,
    results: Sequence[Mapping[str, Any]],
    closer: Sequence[Mapping[str, Any]] = (),
) -> Row:
    """The row of ``table`` for the `Result`s of flights of ``experiment`` at ``v_max`` (m/s).

    ``closer`` are those of flights that are closer to the paper's.
    """
    good, failures = _sorted(results)
    numbers = [table.ours(summary) for summary in good]
    ours = {column: _mean([n[column] for n in numbers]) for column in table.columns}
    deviation = {column: _deviation([n[column] for n in numbers]) for column in table.columns}
    other = None
    if table.metric in TRUTH:
        others = [summary.get(TRUTH[table.metric]) or {} for summary in good]
        other = {column: _mean([n.get(column) for n in others]) for column in AXES}
    paper = table.row(v_max) if v_max in experiment.v_max else None
    why, near, name = _why_failed(failures, len(results)), None, ""
    if paper is not None:
        name = experiment.closer_name
        there = [table.ours(summary) for summary in _sorted(closer)[0]]
        near = {column: _mean([n[column] for n in there]) for column in table.columns} if there else None
        bare = other if table.metric == "estimation_rmse" else None
        why += _why_not_better(table, ours, paper, near or bare, name or TRACKER)
        if experiment.exact and other is not None:
            why += _why_not_better_by_truth(other, paper, near, name)
    vehicle = experiment.vehicle.stem.removeprefix("sim_")
    return Row(table, v_max, vehicle, len(results), len(good), ours, deviation, other, near, name, paper, tuple(why))


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
        "closer": row.closer and {"what": row.closer_name, **row.closer},
        "paper": row.paper and dict(row.paper),
        "ratio": row.ratio,
        "why": list(row.why),
    }


def _sorted(results: Sequence[Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], list[str]]:
    """The summaries of those that succeeded, and why the others did not."""
    failures = [str(result.get("why") or why_failed(result["summary"])) for result in results]
    good = [result["summary"] for result, why in zip(results, failures, strict=True) if not why]
    return good, [why for why in failures if why]


def _why_failed(failures: Sequence[str], flights: int) -> list[str]:
    if not failures:
        return []
    kinds = ", ".join(f"{failures.count(text)} × {text}" for text in dict.fromkeys(failures))
    return [f"{len(failures)} of {flights} flights failed: {kinds}"]


def _why_not_better(
    table: Table, ours: Numbers, paper: Mapping[str, float], closer: Numbers | None, name: str
) -> list[str]:
    """A sentence for each number of which less is better, and that is not less than the paper's."""
    told = []
    for column in table.judged:
        ratio = _ratio(ours[column], paper[column])
        if ratio is None or ratio < 1.0:
            continue
        told.append(f"{column} {ratio:.2f} × the paper's: {_reason(column, ours, paper, closer, name)}")
    return told


def _why_not_better_by_truth(
    truth: Numbers, paper: Mapping[str, float], closer: Numbers | None, name: str
) -> list[str]:
    """The same for the total by ground truth, which the paper's is where its state was exact."""
    ratio = _ratio(truth["total"], paper["total"])
    if ratio is None or ratio < 1.0:
        return []
    near = None if closer is None else _ratio(closer["total"], paper["total"])
    told = f"by truth, as the paper's state was exact, total is {ratio:.2f} ×, the tracker's errors included"
    return [told + ("" if near is None else f"; {name} it is {near:.2f} ×")]


def _reason(column: str, ours: Numbers, paper: Mapping[str, float], closer: Numbers | None, name: str) -> str:
    largest = max(AXES[:3], key=lambda axis: paper.get(axis, 0.0))
    if column == "total" and paper["total"] < paper[largest]:
        root = math.sqrt(math.fsum(paper[axis] ** 2 for axis in AXES[:3]))
        against = _ratio(ours["total"], root) or math.nan
        return (
            f"the paper's total, {paper['total']:.4f}, is less than its {largest}, {paper[largest]:.4f}; against the"
            f" root of its axes' squares, {root:.4f}, which is what ours is, the ratio is {against:.2f}"
        )
    if closer is None or (ratio := _ratio(closer[column], paper[column])) is None:
        return "not explained"
    if name != TRACKER:
        return f"{name} it is {ratio:.2f} ×"
    totals = f"the total from {number(closer['total'], 3)} to {number(ours['total'], 3)} m"
    return f"{name} is at {ratio:.2f} × there; fused with sightings of one gate it goes to this, and {totals}"


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _deviation(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.std(known, ddof=1)) if len(known) > 1 else None


def _ratio(ours: float | None, paper: float) -> float | None:
    return None if ours is None else ours / paper
