"""Flying a plan slower than planned: the same path, another timing law, no jump.

A plan P(τ) is flown as P(τ(t)). The rate dτ/dt is 1 where it is flown as planned; it changes along the
polynomial of degree 7 whose first three derivatives vanish at both ends, so that position, velocity, acceleration,
jerk and snap stay continuous. Each law is applied to the plan itself, never to what was made of it before, so that
nothing accumulates (time scaling after J. Hollerbach, "Dynamic scaling of manipulator trajectories", 1984).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from flightapp.frames import Vector
from flightapp.interfaces import Motion
from flightapp.jit import assign, kernel
from flightapp.trajectory import ORDER, Trajectory

PIECE = 0.05
"""s, longest piece of a change of rate; the path is met to far below a micrometre."""
SHORTEST = 0.01
"""s, no piece of a change is cut shorter where the plan itself does not: rounding would tell in the jerk."""
Law = tuple[float, float, float]
"""Rate before, rate after, duration of the change in s."""


@kernel
def progress(before: float, after: float, ramp: float, t: float) -> tuple[float, float, float, float]:
    """s of the plan since the change began, their rate and its two derivatives, ``t`` s since then."""
    if t <= 0.0:
        return before * t, before, 0.0, 0.0
    if t >= ramp:
        return 0.5 * ramp * (before + after) + after * (t - ramp), after, 0.0, 0.0
    u, gain = t / ramp, after - before
    u3 = u * u * u
    share = u3 * u * (35.0 + u * (-84.0 + u * (70.0 - 20.0 * u)))
    slope = 140.0 * u3 * (1.0 - u) ** 3
    bend = 420.0 * u * u * (1.0 - u) ** 2 * (1.0 - 2.0 * u)
    total = u3 * u * u * (7.0 + u * (-14.0 + u * (10.0 - 2.5 * u)))
    return before * t + gain * ramp * total, before + gain * share, gain * slope / ramp, gain * bend / (ramp * ramp)


@kernel
def _moment(before: float, after: float, ramp: float, done: float) -> float:
    """When ``done`` (s of the plan) have been flown, in s since the change began: `progress` inverted."""
    if done <= 0.0:
        return done / before
    whole = 0.5 * ramp * (before + after)
    if done >= whole:
        return ramp + (done - whole) / after if after > 0.0 else ramp
    low, high = 0.0, ramp
    t = ramp * done / whole
    for _ in range(60):
        made, rate, _, _ = progress(before, after, ramp, t)
        miss = done - made
        if miss > 0.0:
            low = t
        else:
            high = t
        moved = t + miss / rate if rate > 0.0 else low  # it vanishes before rest by rounding, too
        if abs(moved - t) < 1e-15 * max(ramp, 1.0):
            break
        t = moved if low < moved < high else 0.5 * (low + high)
    return t


@kernel
def _paced_motion(c: Vector, place: float, rate: tuple[float, float, float, float], out: Vector) -> None:
    """Displacement from the segment's start, velocity, acceleration and jerk (4,) of one axis at a rate.

    ``c`` (8,) is the segment, ``place`` the time since its start; for ``rate`` see `progress`.
    """
    p = v = a = j = 0.0
    for k in range(ORDER - 1, -1, -1):
        j = j * place + 3.0 * a
        a = a * place + 2.0 * v
        v = v * place + p
        p = p * place + (c[k] if k > 0 else 0.0)
    _, s, s1, s2 = rate
    out[0], out[1] = p, s * v
    out[2] = s * s * a + s1 * v
    out[3] = s * s * s * j + 3.0 * s * s1 * a + s2 * v


@kernel
def _join(origin: float, start: Vector, end: Vector, h: float, c: Vector) -> None:
    """Fill ``c`` (8,) with the polynomial from ``start`` to ``end`` (4,) in ``h`` s, both relative to ``origin``."""
    p = end[0] - start[0] - h * (start[1] + h * (0.5 * start[2] + h * start[3] / 6.0))
    v = h * (end[1] - start[1] - h * (start[2] + 0.5 * h * start[3]))
    a = h * h * (end[2] - start[2] - h * start[3])
    j = h * h * h * (end[3] - start[3])
    c[0], c[1], c[2], c[3] = origin + start[0], start[1], 0.5 * start[2], start[3] / 6.0
    h4 = h * h * h * h
    c[4] = (35.0 * p - 15.0 * v + 2.5 * a - j / 6.0) / h4
    c[5] = (-84.0 * p + 39.0 * v - 7.0 * a + 0.5 * j) / (h4 * h)
    c[6] = (70.0 * p - 34.0 * v + 6.5 * a - 0.5 * j) / (h4 * h * h)
    c[7] = (-20.0 * p + 10.0 * v - 2.0 * a + j / 6.0) / (h4 * h * h * h)


@kernel
def _piece_from(c: Vector, place: float, rate: float, out: Vector) -> None:
    """Fill ``out`` (8,) with the segment ``c`` (8,) from ``place`` on at a constant ``rate``: exactly the same path."""
    for k in range(ORDER):
        out[k] = c[k]
    for m in range(ORDER - 1):
        for k in range(ORDER - 2, m - 1, -1):
            out[k] += place * out[k + 1]
    power = 1.0
    for k in range(ORDER):
        out[k] *= power
        power *= rate


@kernel
def _ascend(values: Vector, count: int) -> None:
    """Sort the first ``count`` of ``values`` in place; numba takes seconds to compile its own sort."""
    for k in range(1, count):
        value, place = values[k], k
        while place > 0 and values[place - 1] > value:
            values[place] = values[place - 1]
            place -= 1
        values[place] = value


@kernel
def _is_free(t: float, cuts: Vector, count: int) -> bool:
    """Whether ``t`` is between the first and the last of ``cuts`` (≥ count,) and too near to none of them."""
    for k in range(count):
        if abs(cuts[k] - t) <= SHORTEST:
            return False
    return bool(cuts[0] < t < cuts[count - 1])


@kernel
def _cuts(knots: Vector, begun: float, offset: float, before: float, after: float, ramp: float) -> Vector:
    """(n,) s since the change began at which pieces end or begin: at the plan's knots, and where the rate changes.

    The first is ``offset``, at which the plan has got to ``begun``, which must be before its last knot.
    """
    base = progress(before, after, ramp, offset)[0] - begun
    parts = max(1, math.ceil(ramp / PIECE))
    cuts = np.empty(knots.size + parts + 2)
    cuts[0], count = offset, 1
    for k in range(knots.size):
        if knots[k] > begun:
            cuts[count] = _moment(before, after, ramp, base + knots[k])
            count += 1
    if before == after:
        return cuts[:count]
    own = count
    for k in range(parts + 1):
        t = ramp * k / parts
        if not _is_free(t, cuts, own):
            # A knot nearby does as well, but a change must not reach far into the constant pace around it.
            t += SHORTEST if k == parts else (-SHORTEST if k == 0 else 0.0)
        if _is_free(t, cuts, own):
            cuts[count] = t
            count += 1
    _ascend(cuts, count)
    return cuts[:count]


@kernel
def _resampled(
    knots: Vector, coefficients: Vector, begun: float, offset: float, before: float, after: float, ramp: float
) -> tuple[Vector, Vector]:
    """Knots (n + 1,) s from now on and coefficients (n, 3, 8) of a plan from its time ``begun`` on.

    Now is ``offset`` s since a change of rate ``before`` → ``after`` over ``ramp`` s began.
    """
    cuts = _cuts(knots, begun, offset, before, after, ramp)
    base = begun - progress(before, after, ramp, offset)[0]
    out = np.empty((cuts.size - 1, 3, ORDER))
    start, end, piece = np.empty(4), np.empty(4), np.empty(ORDER)
    i = 0
    for n in range(cuts.size - 1):
        middle = base + progress(before, after, ramp, 0.5 * (cuts[n] + cuts[n + 1]))[0]
        while i < knots.size - 2 and knots[i + 1] <= middle:
            i += 1
        here, there = progress(before, after, ramp, cuts[n]), progress(before, after, ramp, cuts[n + 1])
        constant = before == after or cuts[n] >= ramp or cuts[n + 1] <= 0.0
        for axis in range(3):
            _piece_from(coefficients[i, axis], base + here[0] - knots[i], here[1] if constant else 1.0, piece)
            if constant:
                assign(out[n, axis], piece)
            else:
                _paced_motion(piece, 0.0, here, start)
                _paced_motion(piece, there[0] - here[0], there, end)
                _join(piece[0], start, end, cuts[n + 1] - cuts[n], out[n, axis])
    return cuts - offset, out


@kernel
def _resampled_yaw(
    knots: Vector, coefficients: Vector, begun: float, offset: float, before: float, after: float, ramp: float
) -> tuple[Vector, Vector]:
    """The same of the heading: knots (n + 1,) and cubics (n, 4)."""
    cuts = _cuts(knots, begun, offset, before, after, ramp)
    base = begun - progress(before, after, ramp, offset)[0]
    out = np.empty((cuts.size - 1, 4))
    i = 0
    for n in range(cuts.size - 1):
        middle = base + progress(before, after, ramp, 0.5 * (cuts[n] + cuts[n + 1]))[0]
        while i < knots.size - 2 and knots[i + 1] <= middle:
            i += 1
        h = cuts[n + 1] - cuts[n]
        ends = np.empty((2, 2))
        for side in range(2):
            made, rate, _, _ = progress(before, after, ramp, cuts[n + side])
            s, c = base + made - knots[i], coefficients[i]
            ends[side, 0] = s * (c[1] + s * (c[2] + s * c[3]))
            ends[side, 1] = rate * (c[1] + s * (2.0 * c[2] + s * 3.0 * c[3]))
        turn, r0, r1 = ends[1, 0] - ends[0, 0], ends[0, 1], ends[1, 1]
        out[n, 0], out[n, 1] = coefficients[i, 0] + ends[0, 0], r0
        out[n, 2] = (3.0 * turn / h - 2.0 * r0 - r1) / h
        out[n, 3] = (r0 + r1 - 2.0 * turn / h) / (h * h)
    return cuts - offset, out


@dataclass(frozen=True, slots=True)
class Pace:
    """Seconds of the plan per second of flight, over stamps: one smooth change."""

    stamp: float = 0.0
    """When it changes."""
    before: float = 1.0
    after: float = 1.0
    ramp: float = 0.0
    """s that the change takes."""

    @property
    def law(self) -> Law:
        """Without its stamp."""
        return self.before, self.after, self.ramp

    def rate(self, stamp: float) -> float:
        """The rate at ``stamp``."""
        return progress(*self.law, stamp - self.stamp)[1]

    def settled(self, stamp: float) -> bool:
        """Whether ``stamp`` is after the change, and in none of the pieces that follow the path only nearly."""
        return self.before == self.after or stamp >= self.stamp + self.ramp + 2.0 * SHORTEST

    def progress(self, start: float, end: float) -> float:
        """s of the plan that are flown between two stamps."""
        return progress(*self.law, end - self.stamp)[0] - progress(*self.law, start - self.stamp)[0]

    def full(self, motion: Motion, stamp: float) -> Motion:
        """The plan's own motion where ``motion`` is what is flown at ``stamp``.

        A new plan that starts with it takes over without a jump when it is flown at this pace in its turn.
        """
        _, s, s1, s2 = progress(*self.law, stamp - self.stamp)
        velocity = motion.velocity / s
        acceleration = (motion.acceleration - s1 * velocity) / (s * s)
        jerk = (motion.jerk - 3.0 * s * s1 * acceleration - s2 * velocity) / (s * s * s)
        return Motion(motion.position, velocity, acceleration, jerk, motion.yaw, motion.yaw_rate / s)


STEADY = Pace()
"""Everything is flown as planned."""


def contiguous(rows: Vector) -> Vector:
    """A copy of ``rows`` of the one layout that kernels are compiled for."""
    return np.array(rows, float, order="C")


def paced(plan: Trajectory, begun: float, pace: Pace, stamp: float) -> Trajectory:
    """``plan`` from its time ``begun`` (s) on, flown from ``stamp`` on at ``pace``.

    Exactly the planned path; where the rate is constant exactly the planned polynomials. ``begun`` must be before the
    plan's end. Gates that the plan has passed before keep their place with negative times.
    """
    if pace.before == pace.after == 1.0 and begun == 0.0 and stamp == plan.stamp:
        return plan
    offset, (before, after, ramp) = stamp - pace.stamp, pace.law
    path = contiguous(plan.knots), contiguous(plan.coefficients)
    knots, coefficients = _resampled(*path, begun, offset, before, after, ramp)
    if begun < plan.yaw_knots[-1]:
        turn = contiguous(plan.yaw_knots), contiguous(plan.yaw_coefficients)
        yaw_knots, yaw_coefficients = _resampled_yaw(*turn, begun, offset, before, after, ramp)
    else:
        yaw_knots, yaw_coefficients = knots[[0, -1]], np.zeros((1, 4))
        yaw_coefficients[0, 0] = plan.sample(begun).yaw
    base = progress(before, after, ramp, offset)[0] - begun
    times = tuple(_moment(before, after, ramp, base + time) - offset for time in plan.gate_times)
    return replace(
        plan,
        stamp=stamp,
        knots=knots,
        coefficients=coefficients,
        yaw_knots=yaw_knots,
        yaw_coefficients=yaw_coefficients,
        gate_times=times,
    )
