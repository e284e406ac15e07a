"""Trajectories in files: CSV for other tools, MCAP beside the flights. Both load back to the last bit.

A CSV file has one row per polynomial::

    # flightapp trajectory 1
    # stamp 12.5
    # gate 3 at 1.75
    curve,start,end,c0,c1,c2,c3,c4,c5,c6,c7
    x,0.0,0.8,...

``curve`` is x, y, z (m, world) or yaw (rad); its value between ``start`` and ``end`` (s since the stamp) is the sum of
ck · (t − start)^k. A yaw has c0 to c3. Numbers are written with as many digits as tell them apart. An MCAP file is a
flight log with nothing but the trajectory in it, so a trajectory can be taken out of a flight's log as well.
"""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.recording.reader import read_flight
from flightapp.recording.writer import FlightLog
from flightapp.trajectory import ORDER, Samples, Trajectory

FORMAT = "# flightapp trajectory 1"
CURVES: Mapping[str, int] = {"x": ORDER, "y": ORDER, "z": ORDER, "yaw": 4}
"""Each curve and its number of coefficients."""
COLUMNS = ("curve", "start", "end", *(f"c{k}" for k in range(ORDER)))
SUFFIXES = (".csv", ".mcap")
_AXES = {"position": "", "velocity": "v", "acceleration": "a", "jerk": "j", "snap": "s"}
SAMPLE_COLUMNS = ("time", *(f"{prefix}{axis}" for prefix in _AXES.values() for axis in "xyz"), "yaw", "yaw_rate")


def save_trajectory(trajectory: Trajectory, path: Path, header: Mapping[str, str] | None = None) -> None:
    """Write ``trajectory`` to ``path``, .csv or .mcap; ``header`` is kept in the log.

    A CSV file is overwritten, a log never. Raises `BadInputError` for another suffix and where nothing can be written.
    """
    try:
        if path.suffix == ".csv":
            path.write_text("\n".join(_lines(trajectory)) + "\n", encoding="utf-8")
        elif path.suffix == ".mcap":
            log = FlightLog(path, header=header or {})
            log.write("trajectory", trajectory)
            log.close()
        else:
            raise BadInputError(_unknown_suffix(path))
    except FileExistsError:
        raise BadInputError(f"{path}: exists, and may be a flight's record; choose another name") from None
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror or error}") from None


def load_trajectory(path: Path, index: int = -1) -> Trajectory:
    """The trajectory in ``path``, .csv or .mcap; of a flight's log the one of ``index``, the last by default.

    Raises `BadInputError` that names the file and, in a CSV file, line and column.
    """
    if path.suffix == ".csv":
        return _Table(path).trajectory()
    if path.suffix != ".mcap":
        raise BadInputError(_unknown_suffix(path))
    plans = read_flight(path).trajectories
    if not plans:
        raise BadInputError(f"{path}: a flight log without any trajectory")
    if not -len(plans) <= index < len(plans):
        raise BadInputError(f"{path}: has {len(plans)} trajectories, 0 to {len(plans) - 1}; there is no {index}")
    return plans[index]


def save_samples(trajectory: Trajectory, path: Path, rate: float) -> None:
    """Write the motion at ``rate`` Hz, and at its end, as CSV with the columns `SAMPLE_COLUMNS` (SI units).

    Other tools read it; it cannot be loaded back. Raises `BadInputError` where it cannot be written.
    """
    times = np.append(np.arange(0.0, trajectory.duration, 1.0 / rate), trajectory.duration)
    samples = trajectory.sample(times)
    rows = np.column_stack([times, *(getattr(samples, field.name) for field in fields(Samples))])
    lines = [",".join(SAMPLE_COLUMNS), *(",".join(map(repr, row)) for row in rows.tolist())]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _unknown_suffix(path: Path) -> str:
    return f"{path}: a trajectory's file ends in {' or '.join(SUFFIXES)}"


def _lines(trajectory: Trajectory) -> Iterator[str]:
    yield FORMAT
    yield f"# stamp {trajectory.stamp!r}"
    for gate_id, time in zip(trajectory.gate_ids, trajectory.gate_times, strict=True):
        yield f"# gate {gate_id} at {time!r}"
    yield ",".join(COLUMNS)
    for axis, curve in enumerate("xyz"):
        yield from _rows(curve, trajectory.knots, trajectory.coefficients[:, axis])
    yield from _rows("yaw", trajectory.yaw_knots, trajectory.yaw_coefficients)


def _rows(curve: str, knots: Vector, coefficients: Vector) -> Iterator[str]:
    ends = knots.tolist()
    for i, row in enumerate(coefficients.tolist()):
        cells = [curve, *map(repr, (ends[i], ends[i + 1], *row))]
        yield ",".join(cells + [""] * (len(COLUMNS) - len(cells)))


class _Table:
    """A CSV file, row by row."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp = 0.0
        self._gates: list[tuple[int, float]] = []
        self._knots: dict[str, list[float]] = {curve: [0.0] for curve in CURVES}
        self._pieces: dict[str, list[list[float]]] = {curve: [] for curve in CURVES}
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            raise BadInputError(f"{path}: there is no such trajectory") from None
        except (OSError, UnicodeDecodeError) as error:
            raise BadInputError(f"{path}: cannot be read: {error}") from None
        self._read(lines)

    def trajectory(self) -> Trajectory:
        """What the file holds."""
        for curve in CURVES:
            if not self._pieces[curve]:
                raise BadInputError(f"{self._path}: has no rows for the curve '{curve}'")
        for curve in "yz":
            if self._knots[curve] != self._knots["x"]:
                raise BadInputError(f"{self._path}: the pieces of '{curve}' do not start and end with those of 'x'")
        knots, yaw_knots = np.array(self._knots["x"]), np.array(self._knots["yaw"])
        coefficients = np.stack([np.array(self._pieces[axis]) for axis in "xyz"], axis=1)
        ids = tuple(gate_id for gate_id, _ in self._gates)
        times = tuple(time for _, time in self._gates)
        yaws = np.array(self._pieces["yaw"])
        return Trajectory(self._stamp, knots, np.ascontiguousarray(coefficients), yaw_knots, yaws, ids, times)

    def _read(self, lines: Sequence[str]) -> None:
        if not lines or lines[0].strip() != FORMAT:
            samples = bool(lines) and lines[0].startswith("time,")
            reason = "holds samples, from which no trajectory can be loaded; save its pieces" if samples else ""
            raise BadInputError(f"{self._path}: {reason or f'not a trajectory: its first line must be {FORMAT!r}'}")
        titled = False
        for number, line in enumerate(lines[1:], start=2):
            if line.startswith("#"):
                self._remark(number, line[1:].split())
            elif not titled:
                titled = True
                if tuple(line.strip().split(",")) != COLUMNS:
                    raise self._wrong(number, f"expected the columns {','.join(COLUMNS)}")
            elif line.strip():
                self._row(number, next(csv.reader([line])))

    def _remark(self, number: int, words: list[str]) -> None:
        match words:
            case ["stamp", stamp]:
                self._stamp = self._number(number, "stamp", stamp)
            case ["gate", gate_id, "at", time] if gate_id.isdecimal():
                self._gates.append((int(gate_id), self._number(number, "time of the gate", time)))
            case _:
                raise self._wrong(number, f"'# {' '.join(words)}' is neither '# stamp S' nor '# gate ID at S'")

    def _row(self, number: int, cells: list[str]) -> None:
        curve = cells[0]
        if curve not in CURVES:
            raise self._wrong(number, f"column curve: '{curve}' is none of {', '.join(CURVES)}")
        width = 3 + CURVES[curve]
        if len(cells) < width or any(cells[width:]) or len(cells) > len(COLUMNS):
            raise self._wrong(number, f"a row of '{curve}' has {width} cells, then empty ones")
        start, end, *row = [self._number(number, COLUMNS[i], cells[i]) for i in range(1, width)]
        knots = self._knots[curve]
        if start != knots[-1]:
            raise self._wrong(number, f"column start: {start!r}, but the piece before ends at {knots[-1]!r}")
        if not end > start:
            raise self._wrong(number, f"column end: {end!r} is not after start = {start!r}")
        knots.append(end)
        self._pieces[curve].append(row)

    def _number(self, line: int, column: str, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._wrong(line, f"column {column}: '{text}' is not a finite number")
        return value

    def _wrong(self, line: int, text: str) -> BadInputError:
        return BadInputError(f"{self._path}: line {line}: {text}")
