"""The smoothest spline through given points in given times, in linear time.

The unknowns are the first d derivatives at the inner knots; the integral of the squared acceleration (d = 1), jerk
(2) or snap (3) is a quadratic form in them (C. Richter et al., 2016). Neighbours alone are coupled, so that the
normal equations are block-tridiagonal with blocks of d × d: Cholesky factors L on the diagonal, W below it. At the
minimum the derivatives up to order 2 d are continuous.
"""

import math

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.hermite import ENERGY, Order


@inlined
def energy_weight(order: Order, duration: float) -> float:
    """T^(−1 − 2 d), which makes the energy on the unit interval that of a segment."""
    inverse = 1.0 / duration
    power = inverse
    for _ in range(len(order)):
        power *= inverse * inverse
    return power


@inlined
def _factorise(order: Order, block: Vector) -> bool:
    """Cholesky factor of ``block`` (≥ d, ≥ d) in place, its diagonal inverted; False where it is not positive."""
    free = len(order)
    for p in range(free):
        for q in range(p):
            total = block[p, q]
            for k in range(q):
                total -= block[p, k] * block[q, k]
            block[p, q] = total * block[q, q]
        total = block[p, p]
        for k in range(p):
            total -= block[p, k] * block[p, k]
        if not total > 0.0:
            return False
        block[p, p] = 1.0 / math.sqrt(total)
    return True


@inlined
def _forward(order: Order, block: Vector, x: Vector) -> None:
    """Solve L z = x in place; ``x`` is (≥ d, 3)."""
    for p in range(len(order)):
        for axis in range(3):
            total = x[p, axis]
            for k in range(p):
                total -= block[p, k] * x[k, axis]
            x[p, axis] = total * block[p, p]


@inlined
def _eliminate(order: Order, coupling: Vector, before: Vector, x: Vector) -> None:
    """Subtract W z of the knot before from ``x``."""
    for p in range(len(order)):
        for axis in range(3):
            for q in range(len(order)):
                x[p, axis] -= coupling[p, q] * before[q, axis]


@inlined
def _backward(order: Order, n: int, factors: Vector, couplings: Vector, x: Vector) -> None:
    """Solve Lᵀ x = z for all inner knots, from the last."""
    free = len(order)
    for i in range(n - 1, 0, -1):
        for axis in range(3):
            for p in range(free - 1, -1, -1):
                total = x[i, p, axis]
                if i < n - 1:
                    for q in range(free):
                        total -= couplings[i, q, p] * x[i + 1, q, axis]
                for k in range(p + 1, free):
                    total -= factors[i, k, p] * x[i, k, axis]
                x[i, p, axis] = total * factors[i, p, p]


@lean_kernel
def solve(order: Order, n: int, factors: Vector, couplings: Vector, x: Vector) -> None:
    """Solve in place for the right-hand sides at the inner knots of ``x`` (n + 1, 3, 3) with `smoothest`'s factors."""
    for i in range(1, n):
        if i > 1:
            _eliminate(order, couplings[i - 1], x[i - 1], x[i])
        _forward(order, factors[i], x[i])
    _backward(order, n, factors, couplings, x)


@inlined
def _assemble(order: Order, i: int, t: float, points: Vector, x: Vector, factors: Vector, couplings: Vector) -> None:
    """Add what segment ``i`` contributes to the equations of the knots at its ends.

    That of the knot after it is begun here; those of the first and last knot of all have room, but no meaning.
    """
    free, Q = len(order), ENERGY[len(order) - 1]
    left = energy_weight(order, t)
    for p in range(free):
        left *= t
        for axis in range(3):
            pull = left * (points[i + 1, axis] - points[i, axis])
            x[i, p, axis] -= Q[p, 2 * free] * pull
            x[i + 1, p, axis] = -Q[free + p, 2 * free] * pull
        right = left
        for q in range(free):
            right *= t
            factors[i, p, q] += Q[p, q] * right
            factors[i + 1, p, q] = Q[free + p, free + q] * right
            couplings[i, p, q] = Q[free + p, q] * right


@inlined
def _reduce(order: Order, coupling: Vector, block: Vector) -> None:
    """Subtract W Wᵀ from ``block`` (≥ d, ≥ d), its lower half."""
    for p in range(len(order)):
        for q in range(p + 1):
            for k in range(len(order)):
                block[p, q] -= coupling[p, k] * coupling[q, k]


@inlined
def _couple(order: Order, block: Vector, coupling: Vector) -> None:
    """Turn what couples two knots into W, with the factor ``block`` of the first."""
    for p in range(len(order)):
        for q in range(len(order)):
            total = coupling[p, q]
            for k in range(q):
                total -= coupling[p, k] * block[q, k]
            coupling[p, q] = total * block[q, q]


@lean_kernel
def smoothest(
    order: Order, times: Vector, points: Vector, ends: Vector, x: Vector, factors: Vector, couplings: Vector
) -> bool:
    """Fill the first d derivatives of all knots in ``x`` (n + 1, 3, 3): v, a and j of each.

    Those of the first and last knot are given by ``ends`` (2, 3, 3). ``times`` is (n,), ``points`` (n + 1, 3);
    ``factors`` and ``couplings`` (n + 1, 3, 3) are left for `solve`. False where the times are too uneven for the
    arithmetic.
    """
    n, free = times.size, len(order)
    for i in range(n):
        _assemble(order, i, times[i], points, x, factors, couplings)
        if i == n - 1:
            for p in range(free):
                for q in range(free):
                    for axis in range(3):
                        x[i, p, axis] -= couplings[i, q, p] * ends[1, q, axis]
        if i == 0:
            _eliminate(order, couplings[0], ends[0], x[1])
            continue
        if i > 1:
            _eliminate(order, couplings[i - 1], x[i - 1], x[i])
            _reduce(order, couplings[i - 1], factors[i])
        if not _factorise(order, factors[i]):
            return False
        _forward(order, factors[i], x[i])
        if i < n - 1:
            _couple(order, factors[i], couplings[i])
    _backward(order, n, factors, couplings, x)
    for p in range(free):
        for axis in range(3):
            x[0, p, axis] = ends[0, p, axis]
            x[n, p, axis] = ends[1, p, axis]
    return True
