"""One flight in one dictionary: the contents of summary.json."""

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from pydantic import ValidationError

from flightapp.evaluation.alignment import Align, AlignmentError, align
from flightapp.evaluation.effort import bounds_of, control_effort, saturation
from flightapp.evaluation.flight import Flight
from flightapp.evaluation.gates import Crossing, crossings
from flightapp.evaluation.latency import latencies
from flightapp.evaluation.metrics import (
    Window,
    plan_statistics,
    position_error,
    position_nees,
    racing_window,
    rmse,
    sender_statistics,
    speeds,
    velocity_error,
)
from flightapp.evaluation.paths import interpolate, path_of
from flightapp.evaluation.pose_errors import Unit, absolute_errors, relative_errors
from flightapp.evaluation.splits import laps, splits
from flightapp.evaluation.told import Told
from flightapp.inputs import BadInputError
from flightapp.messages import Event, Outcome
from flightapp.track import Track

Summary = dict[str, Any]
DECIMALS = 6
ALIGNMENTS = (Align.NONE, Align.YAW, Align.SE3)
"""What an estimate's errors are told with."""
RPE_STEP = 1.0
"""s, step of the relative errors."""


def summarise(flight: Flight) -> Summary:
    """The metrics of ``flight``, in SI units, rounded to 1e-6, with its keys in a fixed order.

    The sender's row is from the commands' stamps and, in simulation over a link, from their arrivals; what the guard
    counted is from the log's header. Times count from the
    start of the racing window. Raises `BadInputError` if the header's track or config cannot be read.
    """
    window = racing_window(flight)
    motion = flight.truth if flight.has_truth else flight.states
    speed = speeds(motion, window)
    seed = flight.header.get("seed")
    told = flight_settings(flight)
    gates = _gates(flight, window, told)
    summary = {
        "mission": flight.header.get("mission"),
        "seed": int(seed) if seed and seed.lstrip("-").isdigit() else seed,
        "outcome": flight.header.get("outcome"),
        "v_max": told.race.v_max,
        "elapsed": window.duration,
        "v_peak": speed and speed.peak,
        "v_avg": speed and speed.mean,
        "gates": gates,
        "laps": [asdict(lap) for lap in laps(gates)],
        "splits": [asdict(split) for split in splits(gates, window.duration)],
        "collisions": [
            {"time": touch.stamp - window.start, "obstacle": touch.obstacle, "speed": touch.speed}
            for touch in flight.collisions
        ],
        **_errors(flight, window),
        **_pose_errors(flight, window),
        **_asked(flight, window, told),
        "latency": {stage: asdict(found) for stage, found in latencies(flight, window).items()},
        "replans": asdict(plan_statistics(flight.plans, window)),
        "sender": _sender(flight, window, told),
        "process": _process(flight),
        "faults": [_timed(event, window) for event in flight.events if event.kind == "fault"],
        "judged_by": "truth" if flight.has_truth else "estimate",
        "complete": flight.complete,
    }
    rounded: Summary = _rounded(summary)
    return rounded


def to_json(summary: Mapping[str, Any]) -> str:
    """``summary`` as indented JSON; the same summary gives the same text."""
    return json.dumps(_rounded(summary), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def why_failed(summary: Mapping[str, Any]) -> str:
    """Why the flight does not count as a success; empty if it does.

    A success achieved its goal, touched nothing and passed every gate, by ground truth where there is one.
    """
    outcome = summary.get("outcome")
    missed = [str(gate["id"]) for gate in summary.get("gates", []) if not gate["passed"]]
    touched = sorted({touch["obstacle"] for touch in summary.get("collisions", [])})
    reasons = []
    if outcome != Outcome.GOAL_ACHIEVED.value:
        reasons.append(str(outcome or "no outcome"))
    if touched:
        reasons.append(f"touched {', '.join(touched)}")
    if missed:
        reasons.append(f"missed gate {', '.join(missed)}")
    return "; ".join(reasons)


def flight_track(flight: Flight) -> Track | None:
    """The track in the log's header; None if there is none; raises `BadInputError` if it is not one."""
    text = flight.header.get("track")
    if not text:
        return None
    try:
        return Track.model_validate_json(text)
    except ValidationError as error:
        raise BadInputError(f"the track in the log's header cannot be read: {error}") from None


def flight_settings(flight: Flight) -> Told:
    """What is used of the effective config in the log's header; raises `BadInputError` if that means nothing."""
    try:
        return Told.model_validate(tomllib.loads(flight.header.get("config", "")))
    except (tomllib.TOMLDecodeError, ValidationError, RecursionError) as error:
        raise BadInputError(f"the config in the log's header cannot be read: {error}") from None


def _errors(flight: Flight, window: Window) -> dict[str, Any]:
    errors = {
        "tracking_rmse": position_error(flight.setpoints, flight.states, window),
        "tracking_rmse_truth": position_error(flight.setpoints, flight.truth, window),
        "speed_rmse": velocity_error(flight.setpoints, flight.states, window),
        "speed_rmse_truth": velocity_error(flight.setpoints, flight.truth, window),
        "estimation_rmse": position_error(flight.states, flight.truth, window),
        "tracker_rmse": position_error(flight.poses, flight.truth, window),
    }
    totals = {name: rmse(error) for name, (_, error) in errors.items()}
    nees = {"estimation_nees": position_nees(flight.states, flight.truth, window)}
    return {name: total and asdict(total) for name, total in totals.items()} | nees


def _pose_errors(flight: Flight, window: Window) -> dict[str, Any]:
    """APE and RPE of the estimate against the truth, as the field tells them; null without truth."""
    inside = path_of("estimate", flight.states)
    inside = inside.at(window.holds(inside.stamp))
    estimate, truth = interpolate(inside, path_of("truth", flight.truth))
    ape: dict[str, Any] = {}
    for how in ALIGNMENTS:
        try:
            errors = absolute_errors(truth, align(truth, estimate, how).apply(estimate))
        except AlignmentError:
            errors = None
        ape[how.value] = errors and asdict(errors)
    oriented = truth.orientation is not None and estimate.orientation is not None
    rpe = relative_errors(truth, estimate, RPE_STEP, Unit.SECONDS) if oriented else None
    known = estimate.stamp.size > 0
    return {"estimation_ape": ape if known else None, "estimation_rpe": rpe and {"step": RPE_STEP, **asdict(rpe)}}


def _asked(flight: Flight, window: Window, told: Told) -> dict[str, Any]:
    """What was asked of the vehicle; null without commands, or without a config that tells their limits."""
    effort, bounds = control_effort(flight.commands, window), bounds_of(told)
    limited = bounds and saturation(flight.commands, window, bounds)
    return {"effort": effort and asdict(effort), "saturation": limited and asdict(limited)}


def _gates(flight: Flight, window: Window, told: Told) -> list[dict[str, Any]]:
    """One row for each gate of each lap; the k-th passage of a gate belongs to its k-th lap."""
    track = flight_track(flight)
    gate_ids = [gate.id for gate in track.passage] if track else sorted({p.gate_id for p in flight.passages})
    passages = {gate_id: _passages(flight, gate_id, window, track) for gate_id in gate_ids}
    rows = []
    for lap in range(told.mission.laps):
        for gate_id in gate_ids:
            found = passages[gate_id]
            here = found[lap] if lap < len(found) else None
            rows.append(
                {
                    "id": gate_id,
                    "lap": lap + 1,
                    "passed": here is not None,
                    "time": here and here.stamp - window.start,
                    "offset": here and here.offset,
                }
            )
    return rows


def _passages(flight: Flight, gate_id: int, window: Window, track: Track | None) -> list[Crossing]:
    """By the referee where there is one, by motion capture's path through the gate as surveyed, else by estimates."""
    if flight.true_gates or flight.passages:
        found = [Crossing(p.stamp, p.offset) for p in flight.passages if p.gate_id == gate_id]
    elif flight.has_truth:
        path, placed = flight.truth, track.gates if track else ()
        found = [
            crossing
            for gate in placed
            if gate.id == gate_id and track
            for crossing in crossings(path.stamp, path.position, np.array(gate.position), gate.yaw, track.gate.opening)
        ]
    else:
        gates = flight.maps[-1].gates if flight.maps else ()
        opening = track.gate.opening if track else 0.0
        path = flight.states
        found = [
            crossing
            for gate in gates
            if gate.gate_id == gate_id
            for crossing in crossings(path.stamp, path.position, gate.position, gate.yaw, opening)
        ]
    return [crossing for crossing in found if window.start <= crossing.stamp <= window.end]


def _sender(flight: Flight, window: Window, told: Told) -> dict[str, Any] | None:
    rate = told.control.rate
    statistics = sender_statistics(flight.commands.stamp, window, rate)
    if statistics is None:
        return None
    arrivals = np.concatenate([batch.stamps for batch in flight.arrivals]) if flight.arrivals else np.zeros(0)
    received = sender_statistics(arrivals, window, rate)
    guard = _recorded(flight.header.get("sender", "")).get("guard")
    extra = {"received": received and asdict(received), "guard": guard or None}
    return asdict(statistics) | extra


def _process(flight: Flight) -> dict[str, Any] | None:
    """CPU use as a share of one core, and resident memory (bytes) at start and end; null in virtual time."""
    loads = flight.loads
    if len(loads) < 2:
        return None
    cpu = (loads[-1].cpu - loads[0].cpu) / (loads[-1].stamp - loads[0].stamp)
    return {"cpu": cpu, "memory": [loads[0].memory, loads[-1].memory], "memory_max": max(x.memory for x in loads)}


def _recorded(entry: str) -> dict[str, Any]:
    """A JSON object of the log's header; empty where it is none."""
    try:
        value = json.loads(entry)
    except json.JSONDecodeError:
        return {}
    return value if isinstance(value, dict) else {}


def _timed(event: Event, window: Window) -> dict[str, Any]:
    return {"time": event.stamp - window.start, "text": event.text}


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    if isinstance(value, float):
        return round(float(value), DECIMALS) + 0.0 if math.isfinite(value) else None
    return value
