"""What a plan costs, and how that changes with its times and points.

The cost is the duration plus a smooth penalty on what exceeds the limits at samples of each segment: speed,
acceleration, specific force, body rate (|jerk| ≤ rate · |specific force|, from differential flatness: D.
Mellinger and V. Kumar, 2011), height over the floor, and the angle at which gates are crossed. The spline is
always the smoothest one (`minimum`), so that the cost depends on times and points alone; its gradient is
found with one more solve on the same factor (adjoint method).
"""

import math

import numpy as np

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import kernel
from flightapp.planning.hermite import (
    BASIS,
    BASIS_BY_SAMPLE,
    ENERGY,
    POWERS,
    SAMPLES,
    duration_powers,
    energy_weight,
    segment_ends,
)
from flightapp.planning.minimum import BAND, smoothest, solve

SPEED, ACCELERATION, FORCE, RATE, FLOOR, CROSSING = 0, 1, 2, 3, 4, 5
"""Places in a limits array (6,): m/s, m/s², m/s², rad/s, m, cosine of the greatest angle."""


@kernel
def _weights_of(limits: Vector) -> Vector:
    """(5,) the squares that `_motion_penalty` compares with: 1/v², 1/a², 1/f², 1/(ω g)², ω²."""
    speed, acceleration, force, rate = limits[SPEED], limits[ACCELERATION], limits[FORCE], limits[RATE]
    return np.array((speed**-2, acceleration**-2, force**-2, (rate * GRAVITY) ** -2, rate**2))


@kernel
def _motion_penalty(motion: Vector, k: int, weights: Vector, gradients: Vector) -> float:
    """Penalty of sample ``k`` of ``motion``; adds half its gradients to ``gradients`` (3, 3): by v, a and j."""
    v, a, j, g = motion[1], motion[2], motion[3], gradients
    value = 0.0
    excess = (v[0, k] * v[0, k] + v[1, k] * v[1, k] + v[2, k] * v[2, k]) * weights[0] - 1.0
    if excess > 0.0:
        value += excess * excess
        for axis in range(3):
            g[0, axis] += 2.0 * excess * weights[0] * v[axis, k]
    flat = a[0, k] * a[0, k] + a[1, k] * a[1, k]
    excess = (flat + a[2, k] * a[2, k]) * weights[1] - 1.0
    if excess > 0.0:
        value += excess * excess
        for axis in range(3):
            g[1, axis] += 2.0 * excess * weights[1] * a[axis, k]
    up = a[2, k] + GRAVITY
    force = flat + up * up
    excess = force * weights[2] - 1.0
    if excess > 0.0:
        value += excess * excess
        for axis in range(3):
            g[1, axis] += 2.0 * excess * weights[2] * (a[axis, k] if axis < 2 else up)
    excess = (j[0, k] * j[0, k] + j[1, k] * j[1, k] + j[2, k] * j[2, k] - weights[4] * force) * weights[3]
    if excess > 0.0:
        value += excess * excess
        for axis in range(3):
            g[2, axis] += 2.0 * excess * weights[3] * j[axis, k]
            g[1, axis] -= 2.0 * excess * weights[3] * weights[4] * (a[axis, k] if axis < 2 else up)
    return value


@kernel
def _motion_of(duration: float, y: Vector, motion: Vector) -> None:
    """Fill ``motion`` (4, 3, samples) with displacement, velocity, acceleration and jerk of one segment."""
    scale = duration
    for d in range(4):
        scale /= duration
        for axis in range(3):
            row = motion[d, axis]
            row[:] = 0.0
            for q in range(7):
                share = scale * y[q, axis]
                basis = BASIS[d, q]
                for k in range(SAMPLES + 1):
                    row[k] += share * basis[k]


@kernel
def _segment_penalty(
    duration: float, motion: Vector, drop: float, weights: Vector, weight: float, gy: Vector
) -> tuple[float, float, float]:
    """Penalty of one segment, its derivatives by the duration and by the start height; adds to ``gy`` (3, 7).

    ``drop`` (m) is the floor's height above the segment's start.
    """
    value, by_time, by_height = 0.0, 0.0, 0.0
    gradients = np.empty((3, 3))
    for k in range(SAMPLES + 1):
        share = weight / SAMPLES if 0 < k < SAMPLES else 0.5 * weight / SAMPLES
        gradients[:] = 0.0
        penalty = _motion_penalty(motion, k, weights, gradients)
        below = drop - motion[0, 2, k]
        if below > 0.0:
            penalty += below * below
            by_height -= 2.0 * share * duration * below
            for q in range(7):
                gy[2, q] -= 2.0 * share * duration * below * BASIS[0, q, k]
        if penalty == 0.0:
            continue
        value += share * duration * penalty
        by_time += share * penalty
        scale = 2.0 * share
        for d in range(3):
            for axis in range(3):
                g = scale * gradients[d, axis]
                by_time -= 2.0 * share * (d + 1.0) * gradients[d, axis] * motion[d + 1, axis, k]
                row, basis = gy[axis], BASIS_BY_SAMPLE[d + 1, k]
                for q in range(7):
                    row[q] += g * basis[q]
            scale /= duration
    return value, by_time, by_height


@kernel
def _crossing_penalty(
    normals: Vector, derivatives: Vector, limits: Vector, weight: float, by_derivatives: Vector
) -> float:
    """Penalty on crossing gates at an angle; adds its gradient to ``by_derivatives``."""
    value = 0.0
    slow = (0.02 * limits[SPEED]) ** 2
    for k in range(normals.shape[0]):
        n, v = normals[k], derivatives[3 * k]
        if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
            continue
        speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + slow)
        along = v[0] * n[0] + v[1] * n[1] + v[2] * n[2]
        excess = limits[CROSSING] - along / speed
        if excess > 0.0:
            value += weight * excess * excess
            for axis in range(3):
                slope = n[axis] / speed - along * v[axis] / speed**3
                by_derivatives[3 * k, axis] -= 2.0 * weight * excess * slope
    return value


@kernel
def _through_spline(
    times: Vector, points: Vector, derivatives: Vector, adjoint: Vector, order: int, by_time: Vector, by_point: Vector
) -> None:
    """Add what the smoothest spline's own dependence on times and points contributes to the gradients."""
    y, z, scales = np.empty((7, 3)), np.empty((7, 3)), np.empty(7)
    for i in range(times.size):
        duration_powers(times[i], scales)
        segment_ends(i, scales, points, derivatives, y)
        segment_ends(i, scales, points, adjoint, z)
        z[6] = 0.0
        weight = energy_weight(times[i], order)
        change = 0.0
        for axis in range(3):
            for q in range(7):
                pull = 0.0
                for p in range(6):
                    pull += ENERGY[order - 2, q, p] * z[p, axis]
                power = POWERS[q] + 1.0 - 2.0 * order
                change += power * y[q, axis] * pull
                if q == 6:
                    by_point[i + 1, axis] -= weight * pull
                    by_point[i, axis] += weight * pull
            for p in range(6):
                pull = 0.0
                for q in range(7):
                    pull += ENERGY[order - 2, p, q] * y[q, axis]
                change += POWERS[p] * z[p, axis] * pull
        by_time[i] -= weight * change / times[i]


@kernel
def cost(
    times: Vector,
    points: Vector,
    normals: Vector,
    limits: Vector,
    order: int,
    weight: float,
    derivatives: Vector,
    by_time: Vector,
    by_point: Vector,
) -> float:
    """Duration plus penalties (s); fills the inner ``derivatives`` and the gradients (n,) and (n + 1, 3).

    ``normals`` (n + 1, 3) are the directions of passage, zero where there is no gate. Infinite where the
    spline cannot be computed.
    """
    n = times.size
    by_time[:], by_point[:] = 1.0, 0.0
    band = np.empty((3 * (n - 1), BAND))
    if not smoothest(times, points, order, derivatives, band):
        return math.inf
    by_derivatives = np.zeros((3 * (n + 1), 3))
    weights = _weights_of(limits)
    value = _crossing_penalty(normals, derivatives, limits, weight, by_derivatives)
    y, gy, scales, motion = np.empty((7, 3)), np.empty((3, 7)), np.empty(7), np.empty((4, 3, SAMPLES + 1))
    for i in range(n):
        duration_powers(times[i], scales)
        segment_ends(i, scales, points, derivatives, y)
        gy[:] = 0.0
        _motion_of(times[i], y, motion)
        penalty, own, by_height = _segment_penalty(times[i], motion, limits[FLOOR] - points[i, 2], weights, weight, gy)
        value += times[i] + penalty
        by_time[i] += own
        by_point[i, 2] += by_height
        for axis in range(3):
            by_point[i + 1, axis] += gy[axis, 6]
            by_point[i, axis] -= gy[axis, 6]
            for q in range(6):
                by_derivatives[3 * i + q, axis] += scales[q] * gy[axis, q]
                by_time[i] += POWERS[q] / times[i] * y[q, axis] * gy[axis, q]
    adjoint = by_derivatives
    adjoint[:3] = 0.0
    adjoint[3 * n :] = 0.0
    solve(band, adjoint[3 : 3 * n])
    _through_spline(times, points, derivatives, adjoint, order, by_time, by_point)
    return value
