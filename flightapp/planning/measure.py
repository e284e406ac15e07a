"""How far a plan exceeds the limits, densely sampled, and how slowly it must be flown to keep to them."""

import math

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.hermite import DENSE_PLACES, SNAP, Order
from flightapp.planning.penalty import FORCE, LEAST, RATE, SPEED, THRUST, motion_at, penalties, weights_of
from flightapp.planning.spline import Spline, piece

NARROW, NARROW_RATE = 1.0 - 4e-4, 1.0 - 4e-3
"""Shares of the limits kept to at the samples, because of what may lie between them; the latter of the body rate."""


@inlined
def body_rate(a0: float, a1: float, a2: float, j0: float, j1: float, j2: float, slow: float) -> float:
    """Body rate (rad/s) of an acceleration and jerk flown ``slow`` times slower."""
    q = 1.0 / (slow * slow)
    x, y, z = q * a0, q * a1, q * a2 + GRAVITY
    c0, c1, c2 = j1 * z - j2 * y, j2 * x - j0 * z, j0 * y - j1 * x
    force = max(x * x + y * y + z * z, 1e-12)
    return math.sqrt(c0 * c0 + c1 * c1 + c2 * c2) * q / (slow * force)


@inlined
def _ratios(motion: Vector, limits: Vector, ratios: Vector) -> None:
    """Raise ``ratios`` (5,) to those of ``motion`` (3, 3) to the limits."""
    v, a, j = motion[0], motion[1], motion[2]
    flat, up = a[0] * a[0] + a[1] * a[1], a[2] + GRAVITY
    force = math.sqrt(flat + up * up)
    ratios[SPEED] = max(ratios[SPEED], math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2) / limits[SPEED])
    ratios[THRUST] = max(ratios[THRUST], math.sqrt(flat + a[2] * a[2]) / limits[THRUST])
    ratios[FORCE] = max(ratios[FORCE], force / limits[FORCE])
    ratios[LEAST] = max(ratios[LEAST], limits[LEAST] / max(force, 1e-6))
    ratios[RATE] = max(ratios[RATE], body_rate(a[0], a[1], a[2], j[0], j[1], j[2], 1.0) / limits[RATE])


@inlined
def _slower(motion: Vector, limits: Vector) -> float:
    """How many times slower ``motion`` (3, 3) must be flown, at least 1."""
    v, a, j = motion[0], motion[1], motion[2]
    square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
    speed = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    slow: float = max(1.0, speed / limits[SPEED], math.sqrt(math.sqrt(square) / limits[THRUST]))
    # |q a + g|² is a parabola in q = 1 / slow²: it must stay below the greatest and above the least force squared.
    half, spare = GRAVITY * a[2], limits[FORCE] ** 2 - GRAVITY**2
    if square + 2.0 * half > spare:
        slow = max(slow, math.sqrt(square / (math.sqrt(half * half + square * spare) - half)))
    spare = GRAVITY**2 - limits[LEAST] ** 2
    if half < 0.0 and half * half > square * spare:
        slow = max(slow, math.sqrt(square / (-half - math.sqrt(half * half - square * spare))))
    for _ in range(30):
        rate = body_rate(a[0], a[1], a[2], j[0], j[1], j[2], slow)
        if rate <= limits[RATE]:
            break
        slow *= 1.0 + 1e-6 + 0.5 * (math.pow(rate / limits[RATE], 0.34) - 1.0)
    return slow


@lean_kernel
def slowdown(order: Order, s: Spline, limits: Vector, places: Vector, slow: float, ratios: Vector) -> float:
    """How many times slower ``s`` must be flown, at least ``slow``, if it starts and ends at rest.

    ``places`` are `PLACES` or `DENSE_PLACES`.

    Fills ``ratios`` (5,) with the greatest ones to ``limits`` when it is flown ``slow`` times slower, as far as they
    exceed 1.
    """
    n, weights, stride = s.times.size, weights_of(limits), DENSE_PLACES.size // places.size
    for m in range(5):
        ratios[m] = 1.0
    for p in range(n + 2):
        _, part, t = piece(order, p, s, s.y, s.c)
        t *= slow
        if part in (0, 3):
            penalties(SNAP, t, s.c, places, weights, s.over)
        else:
            penalties(order, t, s.c, places, weights, s.over)
        more = 1.0
        for k in range(places.size):
            if s.over[k] > 0.0:
                motion_at(k * stride, t, s.c, s.motion)
                _ratios(s.motion, limits, ratios)
                more = max(more, _slower(s.motion, limits))
        slow *= more
    return slow
