"""A trajectory: piecewise polynomials of degree 7 for the position and cubics for the yaw."""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import kernel
from flightapp.messages import Setpoint

ORDER = 8
"""Coefficients per axis and segment, ascending powers of the time since the segment's start."""
PEAK_STEP = 2e-3
"""s between the moments at which peaks are looked for."""


@kernel
def _locate(knots: Vector, t: float) -> int:
    """Index of the segment that holds time ``t``, clamped to the first and last."""
    i = int(np.searchsorted(knots, t, side="right")) - 1
    return min(max(i, 0), knots.size - 2)


@kernel
def evaluate(
    knots: Vector, coefficients: Vector, yaw_knots: Vector, yaw_coefficients: Vector, t: float, out: Vector
) -> None:
    """Sample at time ``t`` since the start into ``out`` (17,).

    ``out`` is position, velocity, acceleration, jerk, snap (three each), yaw, yaw rate. Before the start
    and after the end it is the resting first and last point.
    """
    clamped = min(max(t, knots[0]), knots[-1])
    i = _locate(knots, clamped)
    s = clamped - knots[i]
    for axis in range(3):
        c = coefficients[i, axis]
        p = v = a = j = n = 0.0
        for k in range(ORDER - 1, -1, -1):
            n = n * s + 4.0 * j
            j = j * s + 3.0 * a
            a = a * s + 2.0 * v
            v = v * s + p
            p = p * s + c[k]
        out[axis] = p
        out[3 + axis] = v
        out[6 + axis] = a
        out[9 + axis] = j
        out[12 + axis] = n
    clamped_yaw = min(max(t, yaw_knots[0]), yaw_knots[-1])
    i = _locate(yaw_knots, clamped_yaw)
    s = clamped_yaw - yaw_knots[i]
    c0, c1, c2, c3 = yaw_coefficients[i]
    out[15] = c0 + s * (c1 + s * (c2 + s * c3))
    out[16] = c1 + s * (2.0 * c2 + s * 3.0 * c3)
    if t < knots[0] or t > knots[-1]:
        out[3:15] = 0.0
    if t < yaw_knots[0] or t > yaw_knots[-1]:
        out[16] = 0.0


@kernel
def evaluate_many(
    knots: Vector, coefficients: Vector, yaw_knots: Vector, yaw_coefficients: Vector, times: Vector
) -> Vector:
    """`evaluate` at each of ``times`` (n,): (n, 17)."""
    out = np.empty((times.size, 17))
    for i in range(times.size):
        evaluate(knots, coefficients, yaw_knots, yaw_coefficients, times[i], out[i])
    return out


@kernel
def _peaks(knots: Vector, coefficients: Vector, step: float) -> Vector:
    """(7,) peaks in the order of `Peaks`, up to the tilt, from samples at most ``step`` s apart in each segment.

    Both ends of each segment belong to it, so that what jumps at a knot is seen on both sides.
    """
    out = np.zeros(7)
    out[4] = math.inf
    lowest = 1.0
    for i in range(knots.size - 1):
        duration = knots[i + 1] - knots[i]
        count = max(1, math.ceil(duration / step))
        for sample in range(count + 1):
            s = duration * sample / count
            vv = aa = jj = af = jf = 0.0
            up = 0.0
            for axis in range(3):
                c = coefficients[i, axis]
                p = v = a = j = 0.0
                for k in range(ORDER - 1, -1, -1):
                    j = j * s + 3.0 * a
                    a = a * s + 2.0 * v
                    v = v * s + p
                    p = p * s + c[k]
                vv, aa, jj = vv + v * v, aa + a * a, jj + j * j
                force = a + (GRAVITY if axis == 2 else 0.0)
                af, jf, up = af + force * force, jf + j * force, force
            force = max(math.sqrt(af), 1e-9)
            across = math.sqrt(max(jj - (jf / force) ** 2, 0.0))
            out[0], out[1], out[2] = max(out[0], vv), max(out[1], aa), max(out[2], jj)
            out[3], out[4] = max(out[3], force), min(out[4], force)
            out[5] = max(out[5], across / force)
            lowest = min(lowest, up / force)
    for k in range(3):
        out[k] = math.sqrt(out[k])
    out[6] = math.acos(max(lowest, -1.0))
    return out


@dataclass(frozen=True, slots=True)
class Peaks:
    """What a trajectory asks of the vehicle at most.

    The specific force, the body rate and the tilt are those of a vehicle without drag (differential flatness:
    D. Mellinger and V. Kumar, 2011).
    """

    speed: float
    """m/s."""
    acceleration: float
    """m/s²."""
    jerk: float
    """m/s³."""
    specific_force: float
    """m/s², with gravity, the greatest."""
    specific_force_min: float
    """m/s², the least."""
    body_rate: float
    """rad/s of roll and pitch together: the jerk across the specific force, over the specific force."""
    tilt: float
    """rad, of the specific force from the vertical."""
    yaw_rate: float
    """rad/s."""
    yaw_acceleration: float
    """rad/s²."""


@dataclass(frozen=True, slots=True)
class Samples:
    """A trajectory at n times; every field has n rows (or is flat, for one time)."""

    position: Vector
    velocity: Vector
    acceleration: Vector
    jerk: Vector
    snap: Vector
    yaw: Vector
    yaw_rate: Vector


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A path in space and time, from a moment on; past its end it rests at its last point."""

    stamp: float
    """The moment at which it starts (its time 0)."""
    knots: Vector
    """(n + 1,) s since the start, ascending from 0."""
    coefficients: Vector
    """(n, 3, 8) position, ascending powers of the time since the segment's start."""
    yaw_knots: Vector
    """(m + 1,) s since the start."""
    yaw_coefficients: Vector
    """(m, 4) yaw, ascending powers; rad."""
    gate_ids: tuple[int, ...] = ()
    """Gates that it flies through, in order."""
    gate_times: tuple[float, ...] = ()
    """s since the start at which it is in each gate's plane."""

    @property
    def duration(self) -> float:
        """Seconds from its start to its end."""
        return float(self.knots[-1])

    @property
    def end_stamp(self) -> float:
        """The moment at which it ends."""
        return self.stamp + self.duration

    @property
    def _pieces(self) -> tuple[Vector, Vector, Vector, Vector]:
        return self.knots, self.coefficients, self.yaw_knots, self.yaw_coefficients

    def sample(self, t: float | Vector) -> Samples:
        """The motion at time(s) ``t`` since the start."""
        times = np.atleast_1d(np.asarray(t, float))
        rows = evaluate_many(*self._pieces, times)
        if np.ndim(t) == 0:
            rows = rows[0]
        return Samples(
            rows[..., 0:3],
            rows[..., 3:6],
            rows[..., 6:9],
            rows[..., 9:12],
            rows[..., 12:15],
            rows[..., 15],
            rows[..., 16],
        )

    def limits(self, step: float = PEAK_STEP) -> Peaks:
        """Peaks over samples at most ``step`` s apart and over all knots; those of the yaw are exact."""
        moving = _peaks(self.knots, self.coefficients, float(step))
        return Peaks(*moving.tolist(), *_yaw_peaks(self.yaw_knots, self.yaw_coefficients))

    def setpoint(self, stamp: float) -> Setpoint:
        """The reference at ``stamp``."""
        out = np.empty(17)
        evaluate(*self._pieces, stamp - self.stamp, out)
        return Setpoint(stamp, out[0:3], out[3:6], out[6:9], out[9:12], float(out[15]), float(out[16]))


def _yaw_peaks(knots: Vector, coefficients: Vector) -> list[float]:
    """Greatest yaw rate and yaw acceleration: at the ends of a cubic, or where its acceleration is zero."""
    duration = np.diff(knots)
    _, c1, c2, c3 = coefficients.T
    bend = np.divide(-c2, 3.0 * c3, out=np.zeros_like(c2), where=c3 != 0.0)
    bend = np.clip(bend, 0.0, duration)
    rates = [c1 + s * (2.0 * c2 + 3.0 * c3 * s) for s in (np.zeros_like(duration), bend, duration)]
    accelerations = (2.0 * c2, 2.0 * c2 + 6.0 * c3 * duration)
    return [float(np.abs(rates).max()), float(np.abs(accelerations).max())]


def hover(stamp: float, position: Vector, yaw: float, duration: float = 1e-3) -> Trajectory:
    """Rest at ``position`` (3,) facing ``yaw``."""
    coefficients = np.zeros((1, 3, ORDER))
    coefficients[0, :, 0] = position
    knots = np.array([0.0, duration])
    return Trajectory(stamp, knots, coefficients, knots, np.array([[yaw, 0.0, 0.0, 0.0]]))
