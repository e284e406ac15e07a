"""The smoothest spline through given points in given times, in linear time.

Among all splines of degree 7 with continuous position, velocity, acceleration and jerk, the one that
minimises the integral of the squared acceleration, jerk or snap. The unknowns are the derivatives at the
inner knots (C. Richter et al., 2016); neighbours alone are coupled, so that the normal equations are
block-tridiagonal: a symmetric band of half-width 5, factorised by Cholesky.
"""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.planning.hermite import ENERGY, duration_powers, energy_weight, segment_ends

BAND = 6
"""Stored diagonals: the main one and five below it."""


@kernel
def assemble(times: Vector, order: int, band: Vector) -> None:
    """Fill ``band`` (3 (n − 1), 6), lower diagonals by row, with the energy's second derivative.

    ``order`` is the derivative whose square is integrated: 2, 3 or 4.
    """
    band[:] = 0.0
    rows = band.shape[0]
    scales = np.empty(7)
    for i in range(times.size):
        duration_powers(times[i], scales)
        weight = energy_weight(times[i], order)
        for q in range(6):
            row = 3 * (i - 1) + q
            if row < 0 or row >= rows:
                continue
            for p in range(q + 1):
                if row - q + p >= 0:
                    band[row, q - p] += weight * scales[q] * scales[p] * ENERGY[order - 2, q, p]


@kernel
def factorise(band: Vector) -> bool:
    """Cholesky factor in place (the diagonal inverted); False where it is not positive definite."""
    for j in range(band.shape[0]):
        first = max(0, j - BAND + 1)
        for k in range(first, j):
            total = band[j, j - k]
            for m in range(first, k):
                total -= band[j, j - m] * band[k, k - m]
            band[j, j - k] = total * band[k, 0]
        total = band[j, 0]
        for m in range(first, j):
            total -= band[j, j - m] * band[j, j - m]
        if not total > 0.0:
            return False
        band[j, 0] = 1.0 / math.sqrt(total)
    return True


@kernel
def solve(band: Vector, x: Vector) -> None:
    """Solve in place for the right-hand sides ``x`` (rows, 3) with the factor of `factorise`."""
    rows = band.shape[0]
    for j in range(rows):
        for axis in range(3):
            total = x[j, axis]
            for k in range(max(0, j - BAND + 1), j):
                total -= band[j, j - k] * x[k, axis]
            x[j, axis] = total * band[j, 0]
    for j in range(rows - 1, -1, -1):
        for axis in range(3):
            total = x[j, axis]
            for k in range(j + 1, min(rows, j + BAND)):
                total -= band[k, k - j] * x[k, axis]
            x[j, axis] = total * band[j, 0]


@kernel
def smoothest(times: Vector, points: Vector, order: int, derivatives: Vector, band: Vector) -> bool:
    """Fill the inner rows of ``derivatives`` (3 (n + 1), 3) and leave the factor in ``band``.

    The first and last three rows (v, a and j at both ends) are given. ``times`` is (n,), ``points``
    (n + 1, 3). False where the times are too uneven for the arithmetic.
    """
    n = times.size
    derivatives[3 : 3 * n] = 0.0
    right = np.zeros((3 * (n - 1), 3))
    y, scales = np.empty((7, 3)), np.empty(7)
    for i in range(n):
        duration_powers(times[i], scales)
        segment_ends(i, scales, points, derivatives, y)
        weight = energy_weight(times[i], order)
        for q in range(6):
            row = 3 * (i - 1) + q
            if row < 0 or row >= right.shape[0]:
                continue
            scale = weight * scales[q]
            for axis in range(3):
                total = 0.0
                for p in range(7):
                    total += ENERGY[order - 2, q, p] * y[p, axis]
                right[row, axis] -= scale * total
    assemble(times, order, band)
    if not factorise(band):
        return False
    solve(band, right)
    for row in range(right.shape[0]):
        for axis in range(3):
            derivatives[3 + row, axis] = right[row, axis]
    return True
