"""Judges a flight by ground truth: which gates were passed, and what was hit.

The vehicle is the smallest ball around it, swept along the true path. A gate is its opening, with four
border boxes around it as solid frame; obstacles are boxes and cylinders. The ground is met by the ball's disc in the
body's x-y plane, where the feet are: the origin of a vehicle that stands is at z = 0.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.messages import Collision, GatePassage
from flightapp.track import FRAME_THICKNESS, Box, Track

GROUND = "ground"
"""The ground's name in collisions."""
TOUCHDOWN_SPEED = 1.0
"""m/s downwards, above it touching the ground is a collision; PX4 lands at MPC_LAND_SPEED, here 0.6."""
TOUCHDOWN_COS_TILT = 0.5
"""Cosine of 60°: touching the ground more tilted than that is a collision."""
GROUND_LEVEL = 0.01
"""m, height of the body's lowest point below which it touches the ground."""
RELEASE = 0.03
"""m between two bodies that end a contact, so that one scrape is reported once."""
SWEEP = 0.2
"""Greatest step along the path between distance checks, in radii: a graze is missed by at most
radius · SWEEP² / 8, 1.3 mm for 0.25 m."""

_FORWARD, _BACKWARD, _HIT = 0.0, 1.0, 2.0


@dataclass(frozen=True, slots=True)
class WrongPassage:
    """The body went through a gate that was not next, or through one from behind; it doesn't count."""

    stamp: float
    gate_id: int
    offset: float
    """m from the gate's centre, in its plane."""
    backwards: bool
    """Against the direction of passage."""


@inlined
def _gap(solid: Vector, x: float, y: float, z: float) -> float:
    """Distance (m) of a world point from a solid (9,): centre, cos and sin of its yaw, half sizes, 1 if it is round.

    A round one is an upright cylinder, whose first half size is its radius.
    """
    dx, dy = x - solid[0], y - solid[1]
    if solid[8] > 0.0:
        a, b = max(math.sqrt(dx * dx + dy * dy) - solid[5], 0.0), 0.0
    else:
        a = max(abs(solid[3] * dx + solid[4] * dy) - solid[5], 0.0)
        b = max(abs(solid[3] * dy - solid[4] * dx) - solid[6], 0.0)
    c = max(abs(z - solid[2]) - solid[7], 0.0)
    return math.sqrt(a * a + b * b + c * c)


@inlined
def _crossing(gate: Vector, half: float, a: Vector, b: Vector) -> tuple[int, float, float]:
    """Whether the path from row ``a`` to row ``b`` goes through a gate (5,): x, y, z, cos, sin of its yaw.

    Returns 1 forward, −1 backward or 0; the fraction of the step at the plane; the offset there in m.
    """
    before = gate[3] * (a[1] - gate[0]) + gate[4] * (a[2] - gate[1])
    after = gate[3] * (b[1] - gate[0]) + gate[4] * (b[2] - gate[1])
    forward = before < 0.0 <= after
    if not forward and not after < 0.0 <= before:
        return 0, 0.0, 0.0
    s = before / (before - after)
    dx = a[1] + s * (b[1] - a[1]) - gate[0]
    dy = a[2] + s * (b[2] - a[2]) - gate[1]
    left = gate[3] * dy - gate[4] * dx
    up = a[3] + s * (b[3] - a[3]) - gate[2]
    if abs(left) > half or abs(up) > half:
        return 0, 0.0, 0.0
    return 1 if forward else -1, s, math.hypot(left, up)


@inlined
def _gaps(solids: Vector, owners: NDArray[np.int64], radius: float, a: Vector, b: Vector, gaps: Vector) -> None:
    """Least distance ``gaps`` (k,) in m of the path from row ``a`` to row ``b`` from each owner's solids."""
    step = math.sqrt((b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2 + (b[3] - a[3]) ** 2)
    parts = 1 + int(step / (SWEEP * radius))
    gaps[:] = math.inf
    for i in range(solids.shape[0]):
        gap = _gap(solids[i], b[1], b[2], b[3])
        if gap < radius + step:
            for j in range(1, parts):
                s = j / parts
                x, y, z = a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2]), a[3] + s * (b[3] - a[3])
                gap = min(gap, _gap(solids[i], x, y, z))
        gaps[owners[i]] = min(gaps[owners[i]], gap)


@inlined
def _note(events: Vector, kind: float, who: int, stamp: float, value: float) -> None:
    """Write one event behind those that ``events`` holds; its first number counts them."""
    n = int(events[0, 0]) + 1
    events[0, 0] = n
    events[n, 0], events[n, 1], events[n, 2], events[n, 3] = kind, who, stamp, value


@inlined
def _touch(
    gaps: Vector, radius: float, contact: NDArray[np.int64], a: Vector, b: Vector, speed: float, events: Vector
) -> None:
    """Note the contacts that begin on the step from row ``a`` to ``b``.

    ``gaps`` (k,) are the distances of the solids; ``contact`` (k + 1,) has the ground last: 0 in flight,
    1 touching, and for the ground 2 crashed, as it may be stood on at first and lain on later.
    """
    for k in range(gaps.size):
        if gaps[k] < radius and contact[k] == 0:
            _note(events, _HIT, k, b[0], speed)
            contact[k] = 1
        elif gaps[k] > radius + RELEASE:
            contact[k] = 0
    cos_tilt = 1.0 - 2.0 * (b[5] * b[5] + b[6] * b[6])
    height = b[3] - radius * math.sqrt(max(1.0 - cos_tilt * cos_tilt, 0.0))
    if height > RELEASE:
        contact[-1] = 0
    elif contact[-1] < 2 and height <= GROUND_LEVEL:
        fell = contact[-1] == 0 and min(a[10], b[10]) < -TOUCHDOWN_SPEED
        contact[-1] = 1
        if fell or cos_tilt < TOUCHDOWN_COS_TILT:
            contact[-1] = 2
            _note(events, _HIT, gaps.size, b[0], speed)


@lean_kernel
def _judge(
    trace: Vector,
    last: Vector,
    gates: Vector,
    half: float,
    solids: Vector,
    owners: NDArray[np.int64],
    radius: float,
    contact: NDArray[np.int64],
    gaps: Vector,
    events: Vector,
) -> int:
    """Write events (kind, gate or owner, stamp, offset or speed) for the rows of ``trace`` that follow ``last``.

    The first of ``events`` counts them. Returns how many rows were judged: all, unless ``events`` might
    not hold what happens in the next one.
    """
    events[0, 0] = 0.0
    full = events.shape[0] - 1 - gates.shape[0] - contact.size
    rows: int = trace.shape[0]
    for i in range(rows):
        if events[0, 0] > full:
            return i
        row = trace[i]
        for g in range(gates.shape[0]):
            way, s, offset = _crossing(gates[g], half, last, row)
            if way != 0:
                kind = _FORWARD if way > 0 else _BACKWARD
                _note(events, kind, g, last[0] + s * (row[0] - last[0]), offset)
        speed = math.sqrt(last[8] ** 2 + last[9] ** 2 + last[10] ** 2)
        _gaps(solids, owners, radius, last, row, gaps)
        _touch(gaps, radius, contact, last, row, speed, events)
        for k in range(last.size):
            last[k] = row[k]
    return rows


def _solids(track: Track) -> tuple[Vector, NDArray[np.int64], tuple[str, ...]]:
    """All solids (n, 9) as `_gap` takes them, the owner of each (n,), and the owners' names."""
    inner, border = 0.5 * track.gate.opening, track.gate.border
    middle, outer, thick = inner + 0.5 * border, inner + border, 0.5 * FRAME_THICKNESS
    rows: list[tuple[float, ...]] = []
    owners: list[int] = []
    for index, gate in enumerate(track.gates):
        x, y, z = gate.position
        c, s = math.cos(gate.yaw), math.sin(gate.yaw)
        for side in (-middle, middle):
            rows.append((x, y, z + side, c, s, thick, outer, 0.5 * border, 0.0))
            rows.append((x - s * side, y + c * side, z, c, s, thick, 0.5 * border, inner, 0.0))
        owners += [index] * 4
    for index, obstacle in enumerate(track.obstacles, len(track.gates)):
        if isinstance(obstacle, Box):
            rows.append((*obstacle.centre, 1.0, 0.0, *(0.5 * side for side in obstacle.size), 0.0))
        else:
            (x, y, z), r, half = obstacle.base, obstacle.radius, 0.5 * obstacle.height
            rows.append((x, y, z + half, 1.0, 0.0, r, r, half, 1.0))
        owners.append(index)
    names = (*(f"gate {gate.id}" for gate in track.gates), *(solid.name for solid in track.obstacles), GROUND)
    return np.array(rows).reshape(-1, 9), np.array(owners, np.int64), names


class Referee:
    """Follows the true motion of a vehicle of ``radius`` m through the true ``track``, ``laps`` times."""

    def __init__(self, track: Track, radius: float, laps: int = 1) -> None:
        self._ids = tuple(gate.id for gate in track.gates)
        self._due = self._ids * laps
        self._half = 0.5 * track.gate.opening
        self.rearrange(track)
        self._radius = radius
        self._last: Vector | None = None
        self._contact = np.zeros(len(self._names), np.int64)
        self._gaps = np.empty(len(self._names) - 1)
        self._events = np.empty((4 * (len(self._ids) + len(self._names)), 4))
        self._passed = 0
        self._wrong: list[WrongPassage] = []

    def rearrange(self, track: Track) -> None:
        """From now on the gates stand as ``track`` says, which has the same ones."""
        self._gates = np.array([(*g.position, math.cos(g.yaw), math.sin(g.yaw)) for g in track.gates]).reshape(-1, 5)
        self._solids, self._owners, self._names = _solids(track)

    @property
    def passed(self) -> tuple[int, ...]:
        """Ids of the gates that were passed, in order, lap after lap."""
        return self._due[: self._passed]

    @property
    def wrong(self) -> tuple[WrongPassage, ...]:
        """Passages that didn't count: out of order, or backwards."""
        return tuple(self._wrong)

    @property
    def next_gate(self) -> int | None:
        """Id of the gate to be passed next; None after the last."""
        return self._due[self._passed] if self._passed < len(self._due) else None

    @property
    def lap(self) -> int:
        """Completed laps."""
        return self._passed // len(self._ids) if self._ids else 0

    @property
    def complete(self) -> bool:
        """Whether all gates of all laps were passed in order; at once on a track without gates."""
        return self._passed == len(self._due)

    def observe(self, trace: Vector) -> list[GatePassage | Collision]:
        """What happened in a piece of the true motion, which continues the piece before it.

        ``trace`` is (n, ≥ 11): stamp, position (m), q_wb, velocity (m/s), and whatever follows. Returns the
        passages that count, and one collision per contact, by stamp; other passages are in `wrong`.
        """
        trace = np.ascontiguousarray(trace, float)
        if trace.shape[0] == 0:
            return []
        if self._last is None:
            self._last = trace[0, :11].copy()
        return list(self._verdicts(trace, self._last))

    def _verdicts(self, trace: Vector, last: Vector) -> Iterator[GatePassage | Collision]:
        done = 0
        while done < trace.shape[0]:
            done += _judge(
                trace[done:],
                last,
                self._gates,
                self._half,
                self._solids,
                self._owners,
                self._radius,
                self._contact,
                self._gaps,
                self._events,
            )
            count = int(self._events[0, 0])
            for kind, index, stamp, value in self._events[1 : 1 + count].tolist():
                verdict = self._verdict(kind, int(index), stamp, value)
                if verdict is not None:
                    yield verdict

    def _verdict(self, kind: float, index: int, stamp: float, value: float) -> GatePassage | Collision | None:
        if kind == _HIT:
            return Collision(stamp, self._names[index], value)
        gate_id = self._ids[index]
        if kind == _FORWARD and gate_id == self.next_gate:
            self._passed += 1
            return GatePassage(stamp, gate_id, value)
        self._wrong.append(WrongPassage(stamp, gate_id, value, kind == _BACKWARD))
        return None
