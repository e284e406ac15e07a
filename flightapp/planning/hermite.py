"""Polynomials by what they do at their ends (Hermite form), on the unit interval.

A segment of duration T whose knots have d free derivatives is described by y (2 d + 1,) per axis: T v, T² a, T³ j
(the first d of them) at its start, the same at its end, and the displacement between the ends. With derivatives
scaled by powers of the duration all matrices are constant (C. Richter, A. Bry and N. Roy, "Polynomial trajectory
planning for aggressive quadrotor flight in dense indoor environments", 2016, section 3).
"""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import inlined
from flightapp.trajectory import ORDER

Order = tuple[int, ...]
"""A tuple with as many entries as knots have free derivatives: kernels are compiled for each length."""
ACCELERATION, JERK, SNAP = (0,), (0, 0), (0, 0, 0)
"""What the smoothest spline has the least of; it is of degree 3, 5 or 7."""
TERMS = 7
"""Most entries of y."""
SAMPLES = 8
"""Points of a segment at which the limits are looked at while the times are optimised: its start, and on evenly."""


def _derivative_row(u: float, derivative: int) -> Vector:
    """(8,) d-th derivative at ``u`` of each power of u."""
    row = np.zeros(ORDER)
    for m in range(derivative, ORDER):
        row[m] = math.perm(m, derivative) * u ** (m - derivative)
    return row


def _coefficients(free: int) -> Vector:
    """(8, 7) ascending coefficients, relative to the start point, of each entry of y; unused places are zero."""
    size = 2 * free + 2
    ends = np.array([_derivative_row(u, d)[:size] for u in (0.0, 1.0) for d in range(free + 1)])
    inverse = np.linalg.inv(ends)
    places = [*range(1, free + 1), *range(free + 2, size), free + 1]
    matrix = np.zeros((ORDER, TERMS))
    matrix[:size, : size - 1] = inverse[:, places]
    matrix[: free + 1] = 0.0
    for m in range(1, free + 1):
        matrix[m, m - 1] = 1.0 / math.factorial(m)
    return matrix


def _energy(free: int) -> Vector:
    """(7, 7) Q with yᵀ Q y the integral over the unit interval of the squared derivative of order d + 1."""
    derivative = free + 1
    gram = np.zeros((ORDER, ORDER))
    for m in range(derivative, ORDER):
        for n in range(derivative, ORDER):
            gram[m, n] = math.perm(m, derivative) * math.perm(n, derivative) / (m + n - 2 * derivative + 1)
    energy = COEFFICIENTS[free - 1].T @ gram @ COEFFICIENTS[free - 1]
    symmetric: Vector = 0.5 * (energy + energy.T)
    return symmetric


def _energy_change(free: int) -> Vector:
    """(7, 7) T / w times what a longer segment adds to w S Q S, with S the powers of T and w those of the energy."""
    powers = np.zeros(TERMS)
    powers[:free] = powers[free : 2 * free] = np.arange(1, free + 1)
    change: Vector = ENERGY[free - 1] * (powers[:, None] + powers[None, :] - 1.0 - 2.0 * free)
    return change


COEFFICIENTS: Vector = np.array([_coefficients(free) for free in (1, 2, 3)])
"""(3, 8, 7), by d − 1."""
ENERGY: Vector = np.array([_energy(free) for free in (1, 2, 3)])
"""(3, 7, 7), by d − 1."""
ENERGY_CHANGE: Vector = np.array([_energy_change(free) for free in (1, 2, 3)])
"""(3, 7, 7), by d − 1."""
PLACES: Vector = np.arange(SAMPLES) / SAMPLES
"""(samples,) u."""
DENSER = 8
"""Times as many points of a segment are looked at once a plan is done."""
DENSE_PLACES: Vector = np.arange(DENSER * SAMPLES) / (DENSER * SAMPLES)
"""(denser · samples,) u, at which a plan is measured once it is done."""
SLOPES: Vector = np.array([[_derivative_row(u, d) for d in (1, 2, 3)] for u in DENSE_PLACES])
"""(denser · samples, 3, 8) first to third derivative of each power of u at the dense places."""


@inlined
def segment_ends(order: Order, i: int, duration: float, points: Vector, derivatives: Vector, y: Vector) -> None:
    """Fill ``y`` (≥ 2 d + 1, 3) of segment ``i``; ``points`` is (n + 1, 3), ``derivatives`` (n + 1, 3, 3) v, a, j."""
    free = len(order)
    power = 1.0
    for q in range(free):
        power *= duration
        for axis in range(3):
            y[q, axis] = power * derivatives[i, q, axis]
            y[free + q, axis] = power * derivatives[i + 1, q, axis]
    for axis in range(3):
        y[2 * free, axis] = points[i + 1, axis] - points[i, axis]


@inlined
def segment_polynomial(order: Order, y: Vector, c: Vector) -> None:
    """Fill ``c`` (8, 3), ascending powers of u relative to the start point, from ``y``."""
    free = len(order)
    for axis in range(3):
        c[0, axis] = 0.0
        for m in range(1, free + 1):
            c[m, axis] = COEFFICIENTS[free - 1, m, m - 1] * y[m - 1, axis]
        for m in range(free + 1, ORDER):
            total = 0.0
            if m < 2 * free + 2:
                for q in range(2 * free + 1):
                    total += COEFFICIENTS[free - 1, m, q] * y[q, axis]
            c[m, axis] = total


@inlined
def bend_start(order: Order, duration: float, motion: Vector, c: Vector) -> None:
    """Give ``c`` (8, 3) the acceleration and jerk of ``motion`` (3, 3: v, a, j) where it starts.

    What is added is p u² (1 − u)⁴ (1 + 4 u) + q u³ (1 − u)⁴, of which position and velocity at both ends, and
    acceleration and jerk at the far end, are zero.
    """
    for axis in range(3):
        p, q = 0.0, 0.0
        if len(order) < 2:
            p = 0.5 * duration**2 * motion[1, axis] - c[2, axis]
        if len(order) < 3:
            q = duration**3 / 6.0 * motion[2, axis] - c[3, axis]
        c[2, axis] += p
        c[3, axis] += q
        c[4, axis] -= 10.0 * p + 4.0 * q
        c[5, axis] += 20.0 * p + 6.0 * q
        c[6, axis] -= 15.0 * p + 4.0 * q
        c[7, axis] += 4.0 * p + q


@inlined
def bend_end(order: Order, duration: float, motion: Vector, c: Vector) -> None:
    """Like `bend_start` where ``c`` ends: p u⁴ (1 − u)² (5 − 4 u) + q u⁴ (1 − u)³ is added."""
    for axis in range(3):
        p, q = 0.5 * duration**2 * motion[1, axis], -(duration**3) / 6.0 * motion[2, axis]
        for m in range(2, ORDER):
            p -= 0.5 * m * (m - 1.0) * c[m, axis]
            q += m * (m - 1.0) * (m - 2.0) / 6.0 * c[m, axis]
        if len(order) > 1:
            p = 0.0
        if len(order) > 2:
            q = 0.0
        c[4, axis] += 5.0 * p + q
        c[5, axis] -= 14.0 * p + 3.0 * q
        c[6, axis] += 13.0 * p + 3.0 * q
        c[7, axis] -= 4.0 * p + q


@inlined
def pull_start(order: Order, duration: float, motion: Vector, g: Vector) -> float:
    """Turn the gradient ``g`` (8, 3) by what `bend_start` gave into that by what it got; returns that by T."""
    by_time = 0.0
    for axis in range(3):
        p = g[2, axis] - 10.0 * g[4, axis] + 20.0 * g[5, axis] - 15.0 * g[6, axis] + 4.0 * g[7, axis]
        q = g[3, axis] - 4.0 * g[4, axis] + 6.0 * g[5, axis] - 4.0 * g[6, axis] + g[7, axis]
        if len(order) < 2:
            g[2, axis] -= p
            by_time += p * duration * motion[1, axis]
        if len(order) < 3:
            g[3, axis] -= q
            by_time += q * 0.5 * duration**2 * motion[2, axis]
    return by_time


@inlined
def pull_end(order: Order, duration: float, motion: Vector, g: Vector) -> float:
    """What `pull_start` is to `bend_start`, for `bend_end`."""
    by_time = 0.0
    for axis in range(3):
        p = 5.0 * g[4, axis] - 14.0 * g[5, axis] + 13.0 * g[6, axis] - 4.0 * g[7, axis]
        q = g[4, axis] - 3.0 * g[5, axis] + 3.0 * g[6, axis] - g[7, axis]
        if len(order) > 1:
            p = 0.0
        if len(order) > 2:
            q = 0.0
        for m in range(2, ORDER):
            g[m, axis] += (m - 1.0) * m * ((m - 2.0) / 6.0 * q - 0.5 * p)
        by_time += duration * p * motion[1, axis] - 0.5 * duration**2 * q * motion[2, axis]
    return by_time
