"""Success rate of many flights."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import chdtri

from flightapp.evaluation.summary import why_failed

NORMAL_975 = 1.959963984540054
"""The standard normal's 97.5 % quantile."""


def wilson_interval(successes: int, runs: int) -> tuple[float, float]:
    """The 95 % score interval of a success rate, after E. B. Wilson, J. Am. Stat. Assoc. 22 (1927), eq. (6).

    Raises ValueError unless 0 ≤ successes ≤ runs; of no runs at all it is (0, 1).
    """
    if not 0 <= successes <= runs:
        raise ValueError(f"{successes} successes in {runs} runs")
    if runs == 0:
        return 0.0, 1.0
    z2 = NORMAL_975**2
    rate = successes / runs
    centre = rate + z2 / (2.0 * runs)
    spread = NORMAL_975 * math.sqrt(rate * (1.0 - rate) / runs + z2 / (4.0 * runs**2))
    scale = 1.0 + z2 / runs
    low = 0.0 if successes == 0 else (centre - spread) / scale
    high = 1.0 if successes == runs else (centre + spread) / scale
    return low, high


def sweep_summary(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The sweep's JSON from each flight's summary.

    A flight that ended without a summary (its process crashed) is given as {"seed", "why"}. A success is
    what `why_failed` has nothing against; the elapsed times are of the successes, null if there are none.
    A failure tells the "command" that flies it alone where that is given with it.
    """
    reasons = [result.get("why") or why_failed(result) for result in results]
    elapsed = [result["elapsed"] for result, why in zip(results, reasons, strict=True) if not why]
    successes = len(elapsed)
    flown = [result for result in results if "why" not in result]
    offsets = [gate["offset"] for result in flown for gate in result["gates"] if gate.get("offset") is not None]
    return {
        "runs": len(results),
        "successes": successes,
        "rate": successes / len(results) if results else 0.0,
        "ci95": list(wilson_interval(successes, len(results))),
        "elapsed": _quantiles(elapsed),
        "offset": {**_quantiles(offsets), "max": max(offsets, default=None)},
        "estimation": _estimation(flown),
        "failures": [
            {"seed": result.get("seed"), "why": why, **{key: result[key] for key in ("command",) if key in result}}
            for result, why in zip(results, reasons, strict=True)
            if why
        ],
    }


def sweep_json(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The JSON of a sweep over many combinations of settings from the `Result`s of its flights.

    As `sweep_summary` of all of them; "points" has the same of each combination, with its "parameters"; "flights" has
    each flight's seed, parameters, why it failed (empty for a success), elapsed time (s) and the command that flies it.
    """
    points: dict[str, list[Mapping[str, Any]]] = {}
    for result in results:
        points.setdefault(result["label"], []).append(result)
    return {
        **sweep_summary([_judged(result) for result in results]),
        "points": [
            {"parameters": flown[0]["parameters"], **sweep_summary([_judged(result) for result in flown])}
            for flown in points.values()
        ],
        "flights": [_flight(result) for result in results],
    }


def _judged(result: Mapping[str, Any]) -> Mapping[str, Any]:
    """What `sweep_summary` wants to know of a `Result`."""
    return {**result.get("summary", {}), **{key: result[key] for key in ("seed", "why", "command") if key in result}}


def _flight(result: Mapping[str, Any]) -> dict[str, Any]:
    judged = _judged(result)
    return {
        "seed": result["seed"],
        "parameters": result["parameters"],
        "why": judged.get("why") or why_failed(judged),
        "elapsed": judged.get("elapsed"),
        "command": result["command"],
    }


def _quantiles(values: Sequence[float]) -> dict[str, float | None]:
    p50, p95 = np.percentile(values, (50.0, 95.0)).tolist() if values else (None, None)
    return {"p50": p50, "p95": p95}


def _estimation(results: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """The estimates' position errors (m) against ground truth and the tracker's own, and how consistent they are.

    "band95" holds the mean NEES of 95 % of such sweeps with a consistent estimator whose errors hardly change during
    a flight; errors that change make it narrower. None without ground truth.
    """
    judged = [r for r in results if r.get("estimation_rmse") and r.get("tracker_rmse") and r.get("estimation_nees")]
    if not judged:
        return None
    ours = [r["estimation_rmse"]["total"] for r in judged]
    theirs = [r["tracker_rmse"]["total"] for r in judged]
    band = np.asarray(chdtri(3 * len(judged), (0.975, 0.025))) / len(judged)
    return {
        "rmse": _quantiles(ours),
        "tracker_rmse": _quantiles(theirs),
        "ratio": _quantiles([a / b for a, b in zip(ours, theirs, strict=True) if b > 0.0]),
        "halved": sum(a <= 0.5 * b for a, b in zip(ours, theirs, strict=True)),
        "nees": {"mean": float(np.mean([r["estimation_nees"] for r in judged])), "band95": band.tolist()},
    }
