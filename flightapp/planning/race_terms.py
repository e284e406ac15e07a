"""What the inequalities of a race line contribute at samples: derivatives by position, velocity, acceleration, jerk."""

import math

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import inlined
from flightapp.planning.race_problem import (
    ACCELERATION,
    ALONG,
    CLEARANCE,
    FLOOR,
    FORCE,
    G2,
    KINDS,
    LEAST_FORCE,
    RATE,
    SPEED,
    TILT,
    Problem,
    at_samples,
)
from flightapp.planning.race_samples import SAMPLES
from flightapp.planning.race_work import Work


@inlined
def first_row(kind: int) -> int:
    """The first row of samples that an inequality depends on."""
    if kind == ACCELERATION:
        return 12
    return 3 if kind == SPEED else (0 if kind >= FLOOR else 6)


@inlined
def row_count(kind: int) -> int:
    """How many rows it depends on."""
    return 6 if kind == RATE else 3


@inlined
def _differentiate(kind: int, q: Vector, limits: Vector, away: Vector, g: Vector) -> None:
    """Fill ``g`` (6, SAMPLES) with the derivatives of inequality ``kind`` by its rows of ``q`` (15, SAMPLES)."""
    limit = limits[kind]
    if kind >= FLOOR:
        for a in range(3):
            for k in range(SAMPLES):
                g[a, k] = -away[a, k] if kind == CLEARANCE else (-1.0 if a == 2 else 0.0)
        return
    first = first_row(kind)
    lift = 0.0 if kind < FORCE else GRAVITY
    x, y, z = q[first], q[first + 1], q[first + 2]
    if kind == RATE:
        _differentiate_rate(q, limit, g)
        return
    for k in range(SAMPLES):
        scale = 2.0 * limit
        if kind == LEAST_FORCE:
            scale = -2.0 / G2
        elif kind == TILT:
            up = z[k] + lift
            scale = limit / (GRAVITY * math.sqrt(x[k] * x[k] + y[k] * y[k] + up * up))
        g[0, k], g[1, k], g[2, k] = scale * x[k], scale * y[k], scale * (z[k] + lift)
        if kind == TILT:
            g[2, k] -= 1.0 / GRAVITY


@inlined
def _differentiate_rate(q: Vector, limit: float, g: Vector) -> None:
    x, y, z, a, b, c = q[6], q[7], q[8], q[9], q[10], q[11]
    for k in range(SAMPLES):
        up = z[k] + GRAVITY
        force = x[k] * x[k] + y[k] * y[k] + up * up
        share = (a[k] * x[k] + b[k] * y[k] + c[k] * up) / force
        scale, lost = 2.0 * limit / G2, ALONG * share
        fall = 2.0 / G2 - scale * lost * share
        g[0, k] = -fall * x[k] - scale * lost * a[k]
        g[1, k] = -fall * y[k] - scale * lost * b[k]
        g[2, k] = -fall * up - scale * lost * c[k]
        g[3, k] = scale * (a[k] - lost * x[k])
        g[4, k] = scale * (b[k] - lost * y[k])
        g[5, k] = scale * (c[k] - lost * up)


@inlined
def _bend(kind: int, q: Vector, limits: Vector, dual: Vector, weights: Vector, H: Vector) -> None:
    """Add the second derivative of inequality ``kind`` by the samples, times ``dual`` (SAMPLES,), where it is convex.

    ``weights`` (2, SAMPLES) are scratch.
    """
    limit = limits[kind]
    if kind <= FORCE:
        first = first_row(kind)
        for a in range(first, first + 3):
            for k in range(SAMPLES):
                H[a, a, k] += 2.0 * limit * dual[k]
    if kind not in (RATE, TILT):
        return
    # Both bend as a square across the specific force does, or nearly so.
    first = 9 if kind == RATE else 6
    gain, loss = weights[0], weights[1]
    for k in range(SAMPLES):
        up = q[8, k] + GRAVITY
        force = q[6, k] * q[6, k] + q[7, k] * q[7, k] + up * up
        gain[k] = 2.0 * limit / G2 * dual[k] if kind == RATE else limit / (GRAVITY * math.sqrt(force)) * dual[k]
        loss[k] = gain[k] * (ALONG if kind == RATE else 1.0) / force
    for a in range(3):
        lift_a = GRAVITY if a == 2 else 0.0
        for k in range(SAMPLES):
            H[first + a, first + a, k] += gain[k]
        for b in range(a, 3):
            lift_b = GRAVITY if b == 2 else 0.0
            for k in range(SAMPLES):
                H[first + a, first + b, k] -= loss[k] * (q[6 + a, k] + lift_a) * (q[6 + b, k] + lift_b)


@inlined
def sum_samples(i: int, problem: Problem, mu: float, work: Work) -> None:
    """Fill ``work.gradients[i]``, ``work.curvature`` and ``work.pull`` from segment ``i``'s samples and multipliers."""
    q, away, H, pull = work.samples[0:15], work.samples[15:19], work.curvature, work.pull
    ratio, force = work.weights[0], work.weights[1]
    # The number of rows is read from an array, as loops of fixed length are unrolled, which takes seconds to compile.
    rows = pull.shape[0]
    for a in range(rows):
        for k in range(SAMPLES):
            pull[a, k] = 0.0
        for b in range(a, rows):
            for k in range(SAMPLES):
                H[a, b, k] = 0.0
    for kind in range(KINDS):
        if problem.active[kind] == 0.0:
            continue
        place, first, count = kind * SAMPLES, first_row(kind), row_count(kind)
        slack, dual = work.slack[i, place : place + SAMPLES], work.dual[i, place : place + SAMPLES]
        c, g = work.c[i, place : place + SAMPLES], work.gradients[i, kind]
        if kind == CLEARANCE:
            at_samples(kind, q, problem.limits[i], problem.rows, away, ratio)
        _differentiate(kind, q, problem.limits[i], away, g)
        _bend(kind, q, problem.limits[i], dual, work.weights, H)
        for k in range(SAMPLES):
            ratio[k] = dual[k] / slack[k]
            force[k] = mu / slack[k] + ratio[k] * (c[k] + slack[k])
        for a in range(count):
            for k in range(SAMPLES):
                pull[first + a, k] += force[k] * g[a, k]
            for b in range(a, count):
                for k in range(SAMPLES):
                    H[first + a, first + b, k] += ratio[k] * g[a, k] * g[b, k]
