"""Swaying on the spot with sums of sines: motion that shows how a vehicle answers, within a few metres.

A multisine's spectrum is where its frequencies are, its excursion is known beforehand, and it repeats nothing that
the vehicle could have settled in (R. Pintelon and J. Schoukens, "System Identification: A Frequency Domain Approach",
2012, chapter 5; for aircraft E. A. Morelli, "Multiple input design for real-time parameter estimation", 2003).
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import Limits
from flightapp.trajectory import ORDER, Trajectory

RAMP = 0.75
"""Periods of the slowest tone over which the swaying grows from rest and fades to rest."""
RAMP_LEAST = 1.0
"""s that this takes at least."""
KNOTS = 8
"""Knots in a period of the fastest tone."""
PEAK_STEP = 0.01
"""s between the moments at which its peaks are looked for."""
LIGHTEST = 0.3
"""Of gravity, the least specific force."""

STEP = [polyder(np.array([0.0] * 5 + [126.0, -420.0, 540.0, -315.0, 70.0]), k) for k in range(4)]
"""The smooth step from 0 to 1 of degree 9, whose first four derivatives are zero at both ends, and three of them."""

Tones = Sequence[tuple[float, float]]
"""Amplitude (m, or rad of the heading) and frequency (Hz) of each sine."""


@dataclass(frozen=True, slots=True)
class Sway:
    """How to sway: along the heading, to its left, up, and in heading."""

    seconds: float
    ahead: Tones = ()
    left: Tones = ()
    up: Tones = ()
    turn: Tones = ()

    @property
    def frequencies(self) -> tuple[float, ...]:
        """Hz, of all tones."""
        return tuple(f for tones in (self.ahead, self.left, self.up, self.turn) for _, f in tones)

    @property
    def ramp(self) -> float:
        """s over which it grows, and over which it fades."""
        slow = RAMP / min(self.frequencies, default=RAMP / RAMP_LEAST)
        return min(max(slow, RAMP_LEAST), 0.5 * self.seconds)


def sway(stamp: float, position: Vector, yaw: float, way: Sway) -> Trajectory:
    """Sway about ``position`` (3,) facing ``yaw``, from rest to rest.

    Raises `ValueError` for less time than the shortest ramps take.
    """
    if way.seconds < 2.0 * RAMP_LEAST:
        raise ValueError(f"swaying takes at least {2.0 * RAMP_LEAST:g} s, not {way.seconds:g} s")
    times = _knots(way)
    ramp = _ramp(times, way)
    ahead, left, up, turn = (_derivatives(tones, times, ramp) for tones in (way.ahead, way.left, way.up, way.turn))
    c, s = math.cos(yaw), math.sin(yaw)
    axes = (c * ahead - s * left, s * ahead + c * left, up)
    coefficients = np.stack([_septic(axis, times) for axis in axes], axis=1)
    coefficients[:, :, 0] += position
    heading = _cubic(turn, times)
    heading[:, 0] += yaw
    return Trajectory(stamp, times, coefficients, times, heading)


def within(way: Sway, limits: Limits, thrust_max: float, rate_max: float) -> Sway:
    """``way``, smaller where it could ask for more than ``limits``, ``thrust_max`` (m/s²) or ``rate_max`` (rad/s).

    Its peaks along the ground and upwards are taken to come at once.
    """
    flat, rise = (
        sway(0.0, np.zeros(3), 0.0, part).limits(PEAK_STEP)
        for part in (replace(way, up=()), Sway(way.seconds, up=way.up))
    )
    across, upwards = flat.acceleration, rise.acceleration
    # To turn the thrust takes the jerk across it, over what thrust there is.
    jerk = flat.jerk + rise.jerk * across / GRAVITY
    shares = (
        _share(limits.v_max, math.hypot(flat.speed, rise.speed)),
        _share(limits.a_max, math.hypot(across, upwards)),
        _share(max(thrust_max - GRAVITY, 0.0), across + upwards),
        _share((1.0 - LIGHTEST) * GRAVITY, upwards),
        _share(rate_max * GRAVITY, jerk + rate_max * upwards),
        _share(limits.yaw_rate_max, flat.yaw_rate),
    )
    return scaled(way, min(shares)) if min(shares) < 1.0 else way


def _share(limit: float, peak: float) -> float:
    return limit / peak if peak > limit else 1.0


def scaled(way: Sway, scale: float) -> Sway:
    """``way`` with all amplitudes times ``scale``."""
    tones = ([(scale * a, f) for a, f in axis] for axis in (way.ahead, way.left, way.up, way.turn))
    return Sway(way.seconds, *tones)


def _knots(way: Sway) -> Vector:
    """(n,) s, with the ramps' ends among them."""
    step = min(1.0 / (KNOTS * max(way.frequencies, default=1.0)), 0.2 * RAMP_LEAST)
    ends = (0.0, way.ramp, way.seconds - way.ramp, way.seconds)
    spans = [np.linspace(a, b, math.ceil((b - a) / step) + 1) for a, b in itertools.pairwise(ends) if b > a]
    return np.unique(np.concatenate(spans))


def _derivatives(tones: Tones, times: Vector, ramp: Vector) -> Vector:
    """(4, n) value and first three derivatives of the sum of ``tones`` times ``ramp`` (4, n), by Leibniz's rule."""
    wave = np.zeros((4, times.size))
    for index, (amplitude, frequency) in enumerate(tones):
        w = 2.0 * math.pi * frequency
        # Phases that keep the peaks of a sum low (M. Schroeder, 1970).
        phase = w * times - math.pi * index * (index + 1) / max(len(tones), 1)
        for k in range(4):
            wave[k] += amplitude * w**k * np.sin(phase + 0.5 * math.pi * k)
    return np.array([sum(math.comb(k, j) * ramp[j] * wave[k - j] for j in range(k + 1)) for k in range(4)])


def _ramp(times: Vector, way: Sway) -> Vector:
    """(4, n) a smooth step up and one down, and their first three derivatives."""
    up, down = np.clip(times / way.ramp, 0.0, 1.0), np.clip((way.seconds - times) / way.ramp, 0.0, 1.0)
    rows = []
    for k in range(4):
        slope = polyval(up, STEP[k]) + (-1.0) ** k * polyval(down, STEP[k])
        rows.append(slope / way.ramp**k - (1.0 if k == 0 else 0.0))
    return np.array(rows)


def _septic(ends: Vector, times: Vector) -> Vector:
    """(n - 1, 8) ascending coefficients of the polynomials with the derivatives ``ends`` (4, n) at ``times``."""
    h = np.diff(times)
    start = ends[:, :-1] / np.array([1.0, 1.0, 2.0, 6.0])[:, None]
    powers = h ** np.arange(ORDER)[:, None]
    lacking = []
    for k in range(4):
        factors = np.array([math.perm(m, k) for m in range(4)], float)
        reached = sum(factors[m] * start[m] * h ** (m - k) for m in range(k, 4))
        lacking.append((ends[k, 1:] - reached) * h**k)
    M = np.array([[math.perm(m, k) for m in range(4, 8)] for k in range(4)], float)
    upper = np.linalg.solve(M, np.array(lacking)) / powers[4:]
    return np.ascontiguousarray(np.concatenate((start, upper)).T)


def _cubic(ends: Vector, times: Vector) -> Vector:
    """(n - 1, 4) ascending coefficients of the cubics with values and slopes ``ends[:2]`` at ``times``."""
    h = np.diff(times)
    a, b = ends[0, :-1], ends[1, :-1]
    rise, slope = (ends[0, 1:] - a - b * h) / h**2, (ends[1, 1:] - b) / h
    return np.ascontiguousarray(np.stack((a, b, 3.0 * rise - slope, (slope - 2.0 * rise) / h), axis=1))
