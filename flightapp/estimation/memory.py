"""The filter's recent past: measurements that arrive late are used where they belong."""

import math

import numpy as np

from flightapp.estimation.correction import replay, step
from flightapp.estimation.process import (
    ATTITUDE,
    FELT,
    FLOWN,
    FORCE,
    KIND,
    ODOM,
    PACE,
    RATES,
    ROW,
    SILENT,
    SPEED,
    STAMP,
)
from flightapp.frames import (
    GRAVITY,
    Vector,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    quat_normalize,
    quat_rotate,
    quat_to_rotvec,
)
from flightapp.jit import assign, kernel

STEPS = 192
"""Steps that are remembered: nearly a second at 200 Hz."""
SMOOTHED = 0.025
"""s, time constant of the speed that the vertical error follows."""
EVERY = 4
"""Steps from one remembered state to the next; those between are computed anew."""


@kernel
def between(a: Vector, b: Vector, stamp: float, out: Vector) -> None:
    """The step at ``stamp`` from ``a`` to ``b`` (22,) into ``out``: attitude, speed and rates of then, no pose."""
    share = (stamp - a[STAMP]) / (b[STAMP] - a[STAMP])
    assign(out, b)
    out[STAMP], out[KIND] = stamp, 0.0
    q = a[ATTITUDE : ATTITUDE + 4]
    turn = quat_to_rotvec(quat_multiply(quat_conjugate(q), b[ATTITUDE : ATTITUDE + 4]))
    assign(out[ATTITUDE : ATTITUDE + 4], quat_normalize(quat_multiply(q, quat_from_rotvec(share * turn))))
    for i in range(3):
        out[SPEED + i] = a[SPEED + i] + share * (b[SPEED + i] - a[SPEED + i])
        out[RATES + i] = a[RATES + i] + share * (b[RATES + i] - a[RATES + i])


@kernel
def coasted(before: Vector, stamp: float, rates: Vector, force: Vector, share: float, out: Vector) -> None:
    """The step at ``stamp`` with no pose: attitude and speed are those of ``before`` (22,), turned and pushed on.

    By the body ``rates`` (3,) then and before, and the mean specific ``force`` (3,), felt for ``share`` of the time.
    """
    assign(out, before)
    out[STAMP], out[KIND], out[FELT] = stamp, 0.0, share
    dt = stamp - before[STAMP]
    half = quat_from_rotvec(0.25 * dt * (before[RATES : RATES + 3] + rates))
    q = quat_multiply(before[ATTITUDE : ATTITUDE + 4], half)
    pull = quat_rotate(q, force)
    pull[2] -= GRAVITY
    assign(out[ATTITUDE : ATTITUDE + 4], quat_normalize(quat_multiply(q, half)))
    for i in range(3):
        out[SPEED + i] += dt * pull[i]
        out[RATES + i], out[FORCE + i] = rates[i], force[i]


class StepMemory:
    """The last `STEPS` steps of a filter with ``size`` states, and every `EVERY`-th of its states."""

    def __init__(self, size: int) -> None:
        self.rows = np.zeros((STEPS, ROW))
        self._xs = np.zeros((STEPS // EVERY, size))
        self._Ps = np.zeros((STEPS // EVERY, size, size))
        self.count = 0
        """Steps so far."""
        self._first = 0
        self._corrected = (np.zeros(ROW), 0, np.zeros(size), np.zeros((size, size)))
        """The newest step at which the state was corrected later, the number of the one after it, and that state."""

    @property
    def newest(self) -> Vector:
        """(22,) the last step."""
        row: Vector = self.rows[(self.count - 1) % STEPS]
        return row

    def begin(self, row: Vector, x: Vector, P: Vector) -> None:
        """Forget everything: ``row`` (22,) is the first step, after which the state is ``x``, ``P``."""
        self.count += -self.count % EVERY
        self._first = self.count
        self._keep(row, x, P)
        self._correct(row, self.count, x, P)

    def advance(self, row: Vector, x: Vector, P: Vector, settings: Vector) -> float:
        """Move ``x``, ``P`` on to ``row`` (22,), and remember that; the χ² of its pose."""
        before = self.newest
        dt, speed = float(row[STAMP] - before[STAMP]), math.hypot(*row[SPEED : SPEED + 3].tolist())
        row[FLOWN] = before[FLOWN] + dt * speed
        row[SILENT] = dt + (0.0 if before[KIND] > 0.0 else float(before[SILENT]))
        row[PACE] = speed + math.exp(-dt / SMOOTHED) * (before[PACE] - speed)
        chi2 = step(x, P, before, row, settings)
        self._keep(row, x, P)
        return chi2

    def _keep(self, row: Vector, x: Vector, P: Vector) -> None:
        number, self.count = self.count, self.count + 1
        self.rows[number % STEPS] = row
        if number % EVERY == 0:
            slot = number // EVERY % len(self._xs)
            self._xs[slot], self._Ps[slot] = x, P

    def reaches(self, stamp: float) -> bool:
        """Whether the state at ``stamp`` can be had."""
        if not self._first < self.count or not math.isfinite(stamp):
            return False
        # The oldest state that is remembered may be overwritten by the next one.
        oldest = max(self._first, (self.count - 1) // EVERY * EVERY - STEPS + 2 * EVERY)
        return bool(self.rows[oldest % STEPS, STAMP] <= stamp <= self.newest[STAMP])

    def rewind(self, stamp: float, x: Vector, P: Vector, settings: Vector) -> tuple[Vector, int]:
        """Put the state at ``stamp`` into ``x``, ``P``; the step (22,) at it, and the number of the one after it.

        ``stamp`` must not be before that of the last such step, from which was resumed.
        """
        row, following = self._restore(stamp, x, P, settings)
        if row[STAMP] < stamp:
            before, after = row, self.rows[following % STEPS]
            row = np.empty(ROW)
            between(before, after, stamp, row)
            step(x, P, before, row, settings)
        return row, following

    def _restore(self, stamp: float, x: Vector, P: Vector, settings: Vector) -> tuple[Vector, int]:
        """Put the state after the last step up to ``stamp`` into ``x``, ``P``; that step, and the next one's number."""
        number = self.count - 1
        while self.rows[number % STEPS, STAMP] > stamp:
            number -= 1
        kept = number // EVERY * EVERY
        corrected, following, *state = self._corrected
        if following > kept:
            # What is kept of the steps before does not know of the correction.
            x[:], P[:] = state
            self._replay(x, P, corrected, following, number + 1, settings)
            row = corrected if following == number + 1 else self.rows[number % STEPS]
        else:
            slot = kept // EVERY % len(self._xs)
            x[:], P[:] = self._xs[slot], self._Ps[slot]
            self._replay(x, P, self.rows[kept % STEPS], kept + 1, number + 1, settings)
            row = self.rows[number % STEPS]
        return row.copy(), number + 1

    def resume(self, row: Vector, following: int, x: Vector, P: Vector, settings: Vector) -> None:
        """Move ``x``, ``P`` from the step ``row`` (22,), which `rewind` gave, on to the present again."""
        self._correct(row, following, x, P)
        self._replay(x, P, row, following, self.count, settings)

    def _correct(self, row: Vector, following: int, x: Vector, P: Vector) -> None:
        self._corrected = (row.copy(), following, x.copy(), P.copy())

    def retreat(self, stamp: float, x: Vector, P: Vector, settings: Vector) -> list[Vector] | None:
        """Go back to the last step before ``stamp``, and forget those after it, which are returned, oldest first.

        None, and nothing done, where that cannot be had.
        """
        number = self.count - 1
        while number > self._first and self.rows[number % STEPS, STAMP] >= stamp:
            number -= 1
        before = float(self.rows[number % STEPS, STAMP])
        if not (before < stamp and self._corrected[0][STAMP] <= before and self.reaches(before)):
            return None
        later = [self.rows[i % STEPS].copy() for i in range(number + 1, self.count)]
        self._restore(before, x, P, settings)
        self.count = number + 1
        return later

    def _replay(self, x: Vector, P: Vector, before: Vector, begin: int, end: int, settings: Vector) -> None:
        replay(x, P, before, self.rows, begin, end, EVERY, self._xs, self._Ps, settings)


def pose_row(
    stamp: float,
    position: Vector,
    orientation: Vector,
    velocity: Vector,
    rates: Vector,
    felt: tuple[Vector, float] | None,
) -> Vector:
    """(22,) the step of a pose of the tracker, with the specific force that was ``felt`` since the last, if any."""
    row = np.zeros(ROW)
    row[STAMP], row[KIND] = stamp, 1.0
    row[ODOM : ODOM + 3], row[ATTITUDE : ATTITUDE + 4] = position, orientation
    row[SPEED : SPEED + 3], row[RATES : RATES + 3] = velocity, rates
    if felt is not None:
        row[FORCE : FORCE + 3], row[FELT] = felt
    return row
