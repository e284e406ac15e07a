"""Polynomials of degree 7 by what they do at their ends (Hermite form), on the unit interval.

A segment of duration T is described by y (7,) per axis: T v, T² a, T³ j at its start, the same at its
end, and the displacement between the ends. With derivatives scaled by powers of the duration all matrices
are constant (C. Richter, A. Bry and N. Roy, "Polynomial trajectory planning for aggressive quadrotor flight
in dense indoor environments", 2016, section 3).
"""

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.trajectory import ORDER

TERMS = 7
"""Entries of y."""
SAMPLES = 7
"""Intervals between the points of a segment at which the limits are looked at while the times are being optimised."""
DENSE_SAMPLES = 64
"""Intervals between the points of a segment at which a plan is measured once it is done."""
POWERS: Vector = np.array([1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 0.0])
"""Power of the duration that scales each entry of y."""


def _falling(power: int, derivative: int) -> float:
    factor = 1.0
    for i in range(derivative):
        factor *= power - i
    return factor


def _derivative_row(u: float, derivative: int) -> Vector:
    """(8,) d-th derivative at ``u`` of each power of u."""
    row = np.zeros(ORDER)
    for m in range(derivative, ORDER):
        row[m] = _falling(m, derivative) * u ** (m - derivative)
    return row


def _coefficients_of_ends() -> Vector:
    """(8, 7) ascending coefficients, relative to the start point, of each entry of y."""
    ends = np.array([_derivative_row(u, d) for u in (0.0, 1.0) for d in range(4)])
    inverse = np.linalg.inv(ends)
    matrix = np.ascontiguousarray(inverse[:, [1, 2, 3, 5, 6, 7, 4]])
    matrix[0] = 0.0
    matrix[1:4] = 0.0
    matrix[1, 0], matrix[2, 1], matrix[3, 2] = 1.0, 0.5, 1.0 / 6.0
    return matrix


def _energy(derivative: int) -> Vector:
    """(7, 7) Q with yᵀ Q y the integral over the unit interval of the squared derivative."""
    gram = np.zeros((ORDER, ORDER))
    for m in range(derivative, ORDER):
        for n in range(derivative, ORDER):
            gram[m, n] = _falling(m, derivative) * _falling(n, derivative) / (m + n - 2 * derivative + 1)
    energy = COEFFICIENTS.T @ gram @ COEFFICIENTS
    symmetric: Vector = 0.5 * (energy + energy.T)
    return symmetric


def _sampled(count: int) -> Vector:
    """(count, 4, 7) position, velocity, acceleration and jerk of each entry of y, at even u in [0, 1]."""
    places = np.linspace(0.0, 1.0, count)
    return np.array([[_derivative_row(u, d) @ COEFFICIENTS for d in range(4)] for u in places])


COEFFICIENTS: Vector = _coefficients_of_ends()
ENERGY: Vector = np.array([_energy(2), _energy(3), _energy(4)])
"""(3, 7, 7) for acceleration, jerk and snap."""
BASIS: Vector = np.ascontiguousarray(_sampled(SAMPLES + 1).transpose(1, 2, 0))
"""(4, 7, samples), so that one entry's part in all samples is contiguous."""
BASIS_BY_SAMPLE: Vector = np.ascontiguousarray(BASIS.transpose(0, 2, 1))
"""(4, samples, 7), so that one sample's part in all entries is contiguous."""
DENSE_BASIS: Vector = _sampled(DENSE_SAMPLES + 1)


@kernel
def duration_powers(duration: float, scales: Vector) -> None:
    """Fill ``scales`` (7,) with the powers of the duration that belong to the entries of y."""
    power = 1.0
    for m in range(3):
        power *= duration
        scales[m] = power
        scales[3 + m] = power
    scales[6] = 1.0


@kernel
def energy_weight(duration: float, order: int) -> float:
    """T^(1 − 2r), which makes the energy on the unit interval that of a segment."""
    power = duration
    for _ in range(order):
        power /= duration * duration
    return power


@kernel
def segment_ends(i: int, scales: Vector, points: Vector, derivatives: Vector, y: Vector) -> None:
    """Fill ``y`` (7, 3) of segment ``i``, whose `duration_powers` are ``scales``.

    ``points`` is (n + 1, 3); ``derivatives`` (3 (n + 1), 3) has v, a and j of each knot as rows.
    """
    for q in range(6):
        for axis in range(3):
            y[q, axis] = scales[q] * derivatives[3 * i + q, axis]
    for axis in range(3):
        y[6, axis] = points[i + 1, axis] - points[i, axis]


@kernel
def polynomial_coefficients(times: Vector, points: Vector, derivatives: Vector) -> Vector:
    """(n, 3, 8) coefficients in ascending powers of the time since each segment's start."""
    n = times.size
    out = np.zeros((n, 3, ORDER))
    y, scales = np.empty((TERMS, 3)), np.empty(TERMS)
    for i in range(n):
        duration_powers(times[i], scales)
        segment_ends(i, scales, points, derivatives, y)
        for axis in range(3):
            scale = 1.0
            for m in range(ORDER):
                total = 0.0
                for q in range(TERMS):
                    total += COEFFICIENTS[m, q] * y[q, axis]
                out[i, axis, m] = total * scale
                scale /= times[i]
            out[i, axis, 0] = points[i, axis]
    return out
