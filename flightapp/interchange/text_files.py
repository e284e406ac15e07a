"""A flight as CSV files, one for each stream, or its paths as TUM files.

Stamps are the flight's own seconds, all else SI units in the frames of `messages`. A CSV of poses has the columns that
`sensors.pose_files` reads; a number is written with as many digits as tell it apart.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flightapp.evaluation.flight import Flight, Motions
from flightapp.evaluation.paths import TimedPath
from flightapp.frames import Vector
from flightapp.interchange.sources import flight_paths
from flightapp.messages import GateEstimate, Stage

MOTION = ("stamp", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")
GATE = ("stamp", "gate", "x", "y", "z", "yaw", "sightings", "last_seen")
TUM_DECIMALS = 9
"""Of the stamps, as the TUM benchmark's tools expect plain seconds."""

Sheet = tuple[str, Sequence[str], Iterable[Sequence[Any]]]
"""Name, columns, rows."""


def write_csv(flight: Flight, out: Path) -> list[Path]:
    """A file in ``out`` for each stream that has anything in it; the files."""
    written = []
    for name, columns, rows in _sheets(flight):
        listed = list(rows)
        if listed:
            path = out / f"{name}.csv"
            with path.open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(columns)
                writer.writerows(listed)
            written.append(path)
    return written


def write_tum(flight: Flight, out: Path) -> list[Path]:
    """A file in ``out`` for each path with orientations: stamp x y z qx qy qz qw; the files."""
    written = []
    for name, timed in flight_paths(flight).items():
        if timed.stamp.size and timed.orientation is not None:
            path = out / f"{name}.tum"
            path.write_text("".join(_tum_lines(timed, timed.orientation)), encoding="utf-8")
            written.append(path)
    return written


def _tum_lines(path: TimedPath, orientation: Vector) -> Iterator[str]:
    table = np.hstack((path.position, orientation[:, 1:], orientation[:, :1])).tolist()
    for stamp, row in zip(path.stamp.tolist(), table, strict=True):
        yield f"{stamp:.{TUM_DECIMALS}f} {' '.join(map(repr, row))}\n"


def _sheets(flight: Flight) -> Iterator[Sheet]:
    states, poses, setpoints, commands, imu = flight.states, flight.poses, flight.setpoints, flight.commands, flight.imu
    variances = (*(f"p{a}{a}" for a in "xyz"), *(f"v{a}{a}" for a in "xyz"), *(f"r{a}{a}" for a in "xyz"))
    yield "state", (*MOTION, *variances, "doubtful"), _rows(*_moving(states), states.variance, states.doubtful)
    yield "truth", MOTION, _rows(*_moving(flight.truth))
    told = (poses.acceleration, poses.confidence, poses.epoch)
    yield "pose", (*MOTION, "ax", "ay", "az", "confidence", "epoch"), _rows(*_moving(poses), *told)
    s = setpoints
    axes = [f"{prefix}{axis}" for prefix in ("", "v", "a", "j") for axis in "xyz"]
    moving = (s.stamp, s.position, s.velocity, s.acceleration, s.jerk, s.yaw, s.yaw_rate)
    yield "setpoint", ("stamp", *axes, "yaw", "yaw_rate"), _rows(*moving)
    yield "command", ("stamp", "wx", "wy", "wz", "thrust"), _rows(commands.stamp, commands.rates, commands.thrust)
    felt = (imu.stamp, imu.specific_force, imu.angular_velocity)
    yield "imu", ("stamp", "fx", "fy", "fz", "wx", "wy", "wz"), _rows(*felt)
    yield from _seldom(flight)


def _seldom(flight: Flight) -> Iterator[Sheet]:
    """What comes irregularly."""
    yield "gates", GATE, (_gate(m.stamp, gate) for m in flight.maps for gate in m.gates)
    true = flight.true_gates[-1] if flight.true_gates else ()
    yield "true_gates", GATE[1:], (_gate(0.0, gate)[1:] for gate in true)
    seen = ((s.stamp, g.gate_id, *g.position, *g.orientation, g.markers) for s in flight.sightings for g in s.gates)
    yield "sightings", ("stamp", "gate", "x", "y", "z", "qw", "qx", "qy", "qz", "markers"), map(_plain, seen)
    yield "events", ("stamp", "kind", "text"), ((e.stamp, e.kind, e.text) for e in flight.events)
    plans = ((p.stamp, p.elapsed, int(p.accepted), p.reason) for p in flight.plans)
    yield "plans", ("stamp", "elapsed", "accepted", "reason"), plans
    columns = ("stamp", "mode", "armed", "landed", "ready", "voltage", "battery")
    statuses = (
        (s.stamp, s.mode, int(s.armed), int(s.landed), int(s.ready), s.voltage, s.battery) for s in flight.statuses
    )
    yield "status", columns, statuses
    yield "passages", ("stamp", "gate", "offset"), ((p.stamp, p.gate_id, p.offset) for p in flight.passages)
    yield "collisions", ("stamp", "obstacle", "speed"), ((c.stamp, c.obstacle, c.speed) for c in flight.collisions)
    t = flight.stages
    stages = zip(t.stamp.tolist(), t.stage.tolist(), t.captured.tolist(), t.begun.tolist(), strict=True)
    named = ((stamp, Stage(stage).name.lower(), *rest) for stamp, stage, *rest in stages)
    yield "stages", ("stamp", "stage", "captured", "begun"), named


def _moving(motion: Motions) -> tuple[Vector, ...]:
    return motion.stamp, motion.position, motion.orientation, motion.velocity, motion.angular_velocity


def _gate(stamp: float, gate: GateEstimate) -> Sequence[Any]:
    return _plain((stamp, gate.gate_id, *gate.position, gate.yaw, gate.sightings, gate.last_seen))


def _plain(row: Iterable[Any]) -> Sequence[Any]:
    """numpy's numbers as Python's own, which are written without their type's name."""
    return [value.item() if isinstance(value, np.generic) else value for value in row]


def _rows(*columns: Any) -> Iterable[Sequence[Any]]:
    """Rows of arrays (n,) and (n, k) side by side; whole numbers stay whole. An array that was not recorded is NaN."""
    n = len(columns[0])
    lists: list[list[Any]] = []
    for column in columns:
        known = column if len(column) == n else np.full((n, *column.shape[1:]), np.nan)
        lists += [known.tolist()] if known.ndim == 1 else known.T.tolist()
    return zip(*lists, strict=True)
