"""Recorded poses: flight logs, CSV, TUM and EuRoC files, and angular velocities of gyroscopes.

`*.mcap` is a flight log: the poses of the body, as they came out of the intake.

`*.csv` is a header of column names, then numbers: stamp (s), x, y, z (m), qw, qx, qy, qz and, where known, vx, vy, vz
(m/s, world), wx, wy, wz (rad/s, body), ax, ay, az (m/s², world, without gravity), confidence (0 to 3), epoch; in any
order; other columns are not read.

`*.csv` whose first line begins with # is EuRoC's (https://projects.asl.ethz.ch/datasets/euroc-mav): stamp (ns), p (m),
q (w, x, y, z) and, where known, v (m/s); the biases behind that are not read.

`*.txt` and `*.tum` are TUM's: stamp (s), x, y, z (m), qx, qy, qz, qw with spaces between; # begins a comment.

Velocities and angular velocities that are missing are the central differences of positions and orientations (one-sided
at both ends): not causal, but without the half sample of lag that a causal difference has.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightapp.evaluation.flight import Poses
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.recording.reader import read_flight

SUFFIXES = (".mcap", ".csv", ".txt", ".tum")
_POSE = ("stamp", "x", "y", "z", "qw", "qx", "qy", "qz")
_VELOCITY, _OMEGA, _PUSH = ("vx", "vy", "vz"), ("wx", "wy", "wz"), ("ax", "ay", "az")
_TUM = ("stamp", "x", "y", "z", "qx", "qy", "qz", "qw")
_EUROC, _EUROC_MARK = (*_POSE, *_VELOCITY), "p_"
_TURNING, _TURNING_MARK = ("stamp", *_OMEGA), "w_"
_WHOLE = ("confidence", "epoch")
NANOSECONDS = 1e-9
CONFIDENT = 3


@dataclass(frozen=True, slots=True)
class PoseRecording:
    """What a file holds."""

    poses: Poses
    of_body: bool
    """Whether they are the body's, in odom and stamped with the capture, and not what a tracker said."""


def read_poses(path: Path) -> PoseRecording:
    """The poses in ``path``, by its suffix; raises `BadInputError` that names file and line."""
    if path.suffix not in SUFFIXES:
        raise BadInputError(f"{path}: poses are read from files that end in {', '.join(SUFFIXES)}")
    if path.suffix == ".mcap":
        poses = read_flight(path).poses
        if not poses.stamp.size:
            raise BadInputError(f"{path}: the flight log has no poses")
        return PoseRecording(poses, True)
    columns = _columns(path, _TUM if path.suffix != ".csv" else None, _EUROC, _EUROC_MARK)
    _require(path, columns, _POSE)
    return PoseRecording(_poses(columns), False)


def read_turning(path: Path) -> tuple[Vector, Vector]:
    """Stamps (n,) in s and angular velocities (n, 3) in rad/s, in whatever axes, of a CSV file that has them.

    Its columns are stamp, wx, wy and wz, or those of EuRoC's imu0/data.csv. Raises `BadInputError`.
    """
    columns = _columns(path, None, _TURNING, _TURNING_MARK)
    _require(path, columns, _TURNING)
    return columns["stamp"], _stack(columns, _OMEGA)


def _require(path: Path, columns: dict[str, Vector], names: Sequence[str]) -> None:
    missing = [name for name in names if name not in columns]
    if missing:
        raise BadInputError(f"{path}:1: there is no column {', '.join(missing)}; known here: {', '.join(columns)}")


def _poses(columns: dict[str, Vector]) -> Poses:
    stamp, position = columns["stamp"], _stack(columns, ("x", "y", "z"))
    q = _stack(columns, ("qw", "qx", "qy", "qz"))
    told = np.full(len(stamp), CONFIDENT)
    return Poses(
        stamp,
        position,
        q,
        _stack(columns, _VELOCITY) if "vx" in columns else _rate(stamp, position),
        _stack(columns, _OMEGA) if "wx" in columns else turning(stamp, q),
        columns.get("confidence", told).astype(np.uint32),
        _stack(columns, _PUSH) if "ax" in columns else np.full((len(stamp), 3), np.nan),
        columns.get("epoch", 0 * told).astype(np.uint32),
    )


def _stack(columns: dict[str, Vector], names: Sequence[str]) -> Vector:
    return np.column_stack([columns[name] for name in names])


def _rate(stamp: Vector, values: Vector) -> Vector:
    if len(stamp) < 2:
        return np.zeros_like(values)
    rate: Vector = np.gradient(values, stamp, axis=0)
    return rate


def turning(stamp: Vector, q: Vector) -> Vector:
    """Angular velocities (n, 3) in rad/s, body, from orientations ``q`` (n, 4) at ``stamp`` (n,), by differences."""
    n = len(stamp)
    if n < 2:
        return np.zeros((n, 3))
    before, after = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
    a, b = q[before], q[after]
    w = np.sum(a * b, axis=1)
    v = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    v = np.where(w < 0.0, -1.0, 1.0)[:, None] * v
    length = np.linalg.norm(v, axis=1)
    angle = 2.0 * np.arctan2(length, np.abs(w))
    scale = np.where(length > 1e-12, angle / np.maximum(length, 1e-12), 2.0)
    rate: Vector = v * (scale / (stamp[after] - stamp[before]))[:, None]
    return rate


def _columns(path: Path, fixed: Sequence[str] | None, euroc: Sequence[str], mark: str) -> dict[str, Vector]:
    """The columns of a text file by name: ``fixed`` ones between spaces, or of a CSV file with names.

    Of an EuRoC file they are ``euroc``; its second column's name must begin with ``mark``.
    """
    lines = _lines(path)
    split: Callable[[str], list[str]] = str.split
    rows, scale, names = list(enumerate(lines, start=1)), 1.0, list(fixed or ())
    if fixed is None:
        split, rows = _cells, rows[1:]
        names = _cells(lines[0].lstrip("\ufeff")) if lines else []
        if names and names[0].startswith("#"):
            if len(names) < 2 or not names[1].startswith(mark):
                raise BadInputError(f"{path}:1: not the EuRoC file that is needed: its second column must be {mark}…")
            names, scale = list(euroc[: len(names)]), NANOSECONDS
    data = _table(path, rows, split, names)
    columns = {name: np.ascontiguousarray(data[:, i]) for i, name in enumerate(names)}
    for name in _WHOLE:
        if name in columns:
            bad = ~((columns[name] >= 0.0) & (columns[name] < 2.0**32))
            if bad.any():
                raise BadInputError(f"{path}:{int(data[bad.argmax(), -1])}: {name} must be a whole number, 0 or more")
    return {**columns, "stamp": _stamps(path, data, names, scale)}


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split(",")]


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise BadInputError(f"{path}: there is no such file") from None
    except UnicodeDecodeError:
        raise BadInputError(f"{path}: is not a text file") from None
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _table(
    path: Path, rows: Sequence[tuple[int, str]], split: Callable[[str], list[str]], names: Sequence[str]
) -> Vector:
    """Numbers (n, 1 + columns): those of ``names``, and the number of the line behind them."""
    table: list[list[float]] = []
    for number, line in rows:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = split(line)
        if len(cells) < len(names):
            raise BadInputError(
                f"{path}:{number}: {len(cells)} values where there must be {len(names)}: {', '.join(names)}"
            )
        try:
            table.append([*map(float, cells[: len(names)]), number])
        except ValueError as error:
            raise BadInputError(f"{path}:{number}: not a number: {str(error).rpartition(': ')[2]}") from None
    if not table:
        raise BadInputError(f"{path}: there are no samples in it")
    return np.array(table)


def _stamps(path: Path, data: Vector, names: Sequence[str], scale: float) -> Vector:
    if "stamp" not in names:
        raise BadInputError(f"{path}:1: there is no column stamp; known here: {', '.join(names)}")
    column = data[:, names.index("stamp")]
    stamps: Vector = (column - column[0]) * scale + column[0] * scale
    wrong = np.flatnonzero(~(np.diff(stamps, prepend=-np.inf) > 0.0) | ~np.isfinite(stamps))
    if wrong.size:
        raise BadInputError(f"{path}:{int(data[wrong[0], -1])}: the stamp does not come after the one before")
    return stamps
