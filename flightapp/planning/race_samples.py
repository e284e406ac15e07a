"""Segments of a race line: polynomials of degree 7 by their ends, and their samples.

A knot is position, velocity, acceleration and jerk, so that a line is three times continuously differentiable and a
segment depends on its two knots and its duration alone. With the ends' d-th derivatives scaled by the d-th power of the
duration all matrices are constant (C. Richter, A. Bry and N. Roy, 2016, section 3). All samples of a segment are
computed side by side, which compilers turn into vector instructions.
"""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import fused, kernel
from flightapp.trajectory import ORDER

SAMPLES = 12
"""Per segment, evenly spaced; its first end is one, its last end is the next segment's first."""
ENTRIES = 8
"""Ends' derivatives: 0 to 3 at the first knot, 0 to 3 at the second."""
KNOT = 13
"""Variables of a knot: 3 d + axis for the d-th derivative, then the duration of the segment that starts there."""
DURATION = 12
"""Place of the duration among them."""
ROWS = 15
"""Rows of a segment's samples (15 SAMPLES,): position, velocity, what the thrust has to accelerate but for gravity, its
derivative, and the acceleration; three each. With drag the third is the acceleration plus the drag times the velocity.

All rows lie behind one another in one flat array, their places fixed: compilers then see that they do not overlap.
"""
AT_P, AT_V, AT_F, AT_J, AT_A = (3 * SAMPLES * d for d in range(5))
"""Where the rows of position, velocity, force, its derivative and acceleration begin."""
FINE = 9
"""Times as many samples are looked at once a line is found."""


EXPONENTS = np.array([[max(m - d, 0) for m in range(ORDER)] for d in range(4)])
FALLING = np.array([[math.perm(m, d) for m in range(ORDER)] for d in range(4)], float)
"""(4, 8) what is left of each power's exponent, and its factor, in the derivatives 0 to 3."""


def _derivative_row(u: float, derivative: int) -> Vector:
    """(8,) d-th derivative at ``u`` of each power of u."""
    return np.asarray(FALLING[derivative] * u ** EXPONENTS[derivative], float)


def _sampled(places: Vector) -> Vector:
    """(n, 4, 8) derivatives 0 to 3 at ``places`` (n,) in [0, 1], of each entry."""
    return np.array([[_derivative_row(u, d) @ COEFFICIENTS for d in range(4)] for u in places])


COEFFICIENTS: Vector = np.linalg.inv(np.array([_derivative_row(u, d) for u in (0.0, 1.0) for d in range(4)]))
"""(8, 8) ascending coefficients of each entry."""
BY_SAMPLE: Vector = _sampled(np.arange(SAMPLES) / SAMPLES)
"""(SAMPLES, 4, 8)."""
BY_ENTRY: Vector = np.ascontiguousarray(BY_SAMPLE.transpose(1, 2, 0))
"""(4, 8, SAMPLES) the same."""
DENSE: Vector = np.array(
    [np.transpose(_sampled((np.arange(SAMPLES) + part / FINE) / SAMPLES), (1, 2, 0)) for part in range(FINE)]
)
"""(FINE, 4, 8, SAMPLES): the samples themselves, and further and further behind each of them."""


@fused
def scaled_ends(i: int, line: Vector, duration: float, y: Vector) -> None:
    """Fill ``y`` (8, 3) with the ends of segment ``i`` of a line or step (n + 1, 13), scaled by the duration."""
    power = 1.0
    for d in range(4):
        for axis in range(3):
            y[d, axis] = power * line[i, 3 * d + axis]
            y[4 + d, axis] = power * line[i + 1, 3 * d + axis]
        power *= duration


@kernel
def polynomials(line: Vector) -> Vector:
    """(n, 3, 8) coefficients of the segments of ``line`` (n + 1, 13), in ascending powers of time."""
    n, y = line.shape[0] - 1, np.empty((ENTRIES, 3))
    out = np.empty((n, 3, ORDER))
    for i in range(n):
        scaled_ends(i, line, line[i, DURATION], y)
        for axis in range(3):
            power = 1.0
            for m in range(ORDER):
                total = 0.0
                for e in range(ENTRIES):
                    total += COEFFICIENTS[m, e] * y[e, axis]
                out[i, axis, m] = total * power
                power /= line[i, DURATION]
    return out


@kernel
def motion_at(line: Vector, times: Vector, t: float) -> Vector:
    """(12,) the motion at ``t`` s on ``line`` (n + 1, 13), whose knots are passed at ``times`` (n + 1,)."""
    i, y, out = 0, np.empty((ENTRIES, 3)), np.empty(DURATION)
    while i < times.size - 2 and times[i + 1] <= t:
        i += 1
    duration = times[i + 1] - times[i]
    u, scale = (t - times[i]) / duration, 1.0
    scaled_ends(i, line, duration, y)
    for d in range(4):
        for axis in range(3):
            total = 0.0
            for m in range(ORDER - 1, d - 1, -1):
                c = 0.0
                for e in range(ENTRIES):
                    c += COEFFICIENTS[m, e] * y[e, axis]
                total = total * u + FALLING[d, m] * c
            out[3 * d + axis] = scale * total
        scale /= duration
    return out


@fused
def sample(basis: Vector, duration: float, y: Vector, q: Vector) -> None:
    """Fill ``q`` (15 SAMPLES,) where the entries ``y`` (8, 3) count as ``basis`` (4, 8, SAMPLES).

    As without drag, and without the last three rows.
    """
    scale = 1.0
    for d in range(4):
        b = basis[d]
        for axis in range(3):
            row = (3 * d + axis) * SAMPLES
            # One sum of all entries at once is a third of the work of adding one after the other.
            y0, y1, y2, y3 = scale * y[0, axis], scale * y[1, axis], scale * y[2, axis], scale * y[3, axis]
            y4, y5, y6, y7 = scale * y[4, axis], scale * y[5, axis], scale * y[6, axis], scale * y[7, axis]
            for k in range(SAMPLES):
                first = y0 * b[0, k] + y1 * b[1, k] + y2 * b[2, k] + y3 * b[3, k]
                q[row + k] = first + (y4 * b[4, k] + y5 * b[5, k] + y6 * b[6, k] + y7 * b[7, k])
        scale /= duration


@fused
def sample_changes(duration: float, y: Vector, q: Vector, out: Vector) -> None:
    """Fill ``out`` (15 SAMPLES,) with the derivative of samples ``q`` by the segment's duration, as `sample` does."""
    scale = 1.0 / duration
    for d in range(4):
        b = BY_ENTRY[d]
        for axis in range(3):
            row = (3 * d + axis) * SAMPLES
            x = -d / duration
            y1, y2, y3 = scale * y[1, axis], 2.0 * scale * y[2, axis], 3.0 * scale * y[3, axis]
            y5, y6, y7 = scale * y[5, axis], 2.0 * scale * y[6, axis], 3.0 * scale * y[7, axis]
            for k in range(SAMPLES):
                first = x * q[row + k] + y1 * b[1, k] + y2 * b[2, k] + y3 * b[3, k]
                out[row + k] = first + (y5 * b[5, k] + y6 * b[6, k] + y7 * b[7, k])
        scale /= duration


@fused
def add_drag(drag: float, q: Vector) -> None:
    """Make rows of ``q`` (15 SAMPLES,) that are as without ``drag`` (1/s) those with it, and fill the last three."""
    for k in range(3 * SAMPLES):
        q[AT_A + k] = q[AT_F + k]
    if drag != 0.0:
        # From the highest derivative down, as each takes what the next lower one is without drag.
        for k in range(3 * SAMPLES):
            q[AT_J + k] += drag * q[AT_F + k]
        for k in range(3 * SAMPLES):
            q[AT_F + k] += drag * q[AT_V + k]


@fused
def take_back(drag: float, g: Vector, at: int) -> None:
    """Turn derivatives ``g`` from ``at`` on, by the rows of samples, into those by the first twelve without drag."""
    if drag != 0.0:
        for k in range(3 * SAMPLES):
            g[at + AT_V + k] += drag * g[at + AT_F + k]
        for k in range(3 * SAMPLES):
            g[at + AT_F + k] += drag * g[at + AT_J + k]
    for k in range(3 * SAMPLES):
        g[at + AT_F + k] += g[at + AT_A + k]
