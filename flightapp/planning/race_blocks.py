"""Symmetric block-tridiagonal systems of equations: Cholesky factorisation and solution in linear time."""

import math

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.race_samples import KNOT


@inlined
def _without(D: Vector, F: Vector) -> None:
    """Take from the block ``D`` what the block above, whose ``F`` is the transposed factor, has of it."""
    for m in range(KNOT):
        for a in range(KNOT):
            x = F[m, a]
            if x != 0.0:
                for b in range(KNOT):
                    D[a, b] -= x * F[m, b]


@inlined
def _decompose(D: Vector) -> bool:
    """Cholesky factor of one block in place, its diagonal inverted; False where it is not positive definite."""
    for j in range(KNOT):
        pivot = D[j, j]
        if not pivot > 0.0:
            return False
        root = 1.0 / math.sqrt(pivot)
        D[j, j] = root
        for a in range(j + 1, KNOT):
            D[a, j] *= root
        for a in range(j + 1, KNOT):
            x = D[a, j]
            for b in range(j + 1, a + 1):
                D[a, b] -= x * D[b, j]
    return True


@inlined
def _divide(D: Vector, F: Vector) -> None:
    """Fill ``F``, the block under the one whose factor is ``D``, with its transposed part of the factor."""
    for a in range(KNOT):
        for b in range(a):
            F[a, b], F[b, a] = F[b, a], F[a, b]
    for m in range(KNOT):
        for j in range(m):
            x = D[m, j]
            for b in range(KNOT):
                F[m, b] -= x * F[j, b]
        for b in range(KNOT):
            F[m, b] *= D[m, m]


@lean_kernel
def factorise(diagonal: Vector, below: Vector) -> bool:
    """Cholesky factor in place; False where the matrix is not positive definite.

    ``diagonal`` (n + 1, 13, 13) are the blocks on the diagonal, of which the lower triangles are used; ``below``
    (n, 13, 13) those under it, and on return their transposes. The factor's own diagonal is inverted.
    """
    for k in range(diagonal.shape[0]):
        if k > 0:
            _without(diagonal[k], below[k - 1])
        if not _decompose(diagonal[k]):
            return False
        if k < below.shape[0]:
            _divide(diagonal[k], below[k])
    return True


@lean_kernel
def solve(diagonal: Vector, below: Vector, x: Vector) -> None:
    """Solve in place for the right-hand side ``x`` (n + 1, 13) with the factor of `factorise`."""
    n = below.shape[0]
    for k in range(n + 1):
        D = diagonal[k]
        if k > 0:
            F = below[k - 1]
            for m in range(KNOT):
                for b in range(KNOT):
                    x[k, b] -= F[m, b] * x[k - 1, m]
        for j in range(KNOT):
            total = x[k, j]
            for m in range(j):
                total -= D[j, m] * x[k, m]
            x[k, j] = total * D[j, j]
    for k in range(n, -1, -1):
        D = diagonal[k]
        if k < n:
            F = below[k]
            for m in range(KNOT):
                total = 0.0
                for b in range(KNOT):
                    total += F[m, b] * x[k + 1, b]
                x[k, m] -= total
        for j in range(KNOT - 1, -1, -1):
            total = x[k, j]
            for m in range(j + 1, KNOT):
                total -= D[m, j] * x[k, m]
            x[k, j] = total * D[j, j]
