"""Symmetric block-tridiagonal systems of equations: Cholesky factorisation and solution in linear time."""

import math

from flightapp.frames import Vector
from flightapp.jit import fused, fused_kernel
from flightapp.planning.race_samples import KNOT


@fused
def _subtract(rows: Vector, m: int, x0: float, x1: float, x2: float, x3: float, count: int, target: Vector) -> None:
    """Take four of ``rows``, from the ``m``-th on, times numbers, from the first ``count`` entries of ``target``.

    ``count`` should not be known when this is compiled: loops of known length are unrolled and not done side by side.
    """
    for b in range(count):
        target[b] -= x0 * rows[m, b] + x1 * rows[m + 1, b] + x2 * rows[m + 2, b] + x3 * rows[m + 3, b]


@fused
def _without(D: Vector, F: Vector) -> None:
    """Take from the lower half of the block ``D`` what the block above, of transposed factor ``F``, has of it."""
    for a in range(D.shape[0]):
        target = D[a]
        for m in range(0, KNOT - 3, 4):
            _subtract(F, m, F[m, a], F[m + 1, a], F[m + 2, a], F[m + 3, a], a + 1, target)
        for m in range(KNOT - KNOT % 4, KNOT):
            for b in range(a + 1):
                target[b] -= F[m, a] * F[m, b]


@fused
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


@fused
def _divide(D: Vector, F: Vector) -> None:
    """Fill ``F``, the block under the one whose factor is ``D``, with its transposed part of the factor."""
    for a in range(KNOT):
        for b in range(a):
            F[a, b], F[b, a] = F[b, a], F[a, b]
    count = F.shape[0]
    for m in range(KNOT):
        target, whole = F[m], m - m % 4
        for j in range(0, whole, 4):
            _subtract(F, j, D[m, j], D[m, j + 1], D[m, j + 2], D[m, j + 3], count, target)
        for j in range(whole, m):
            x = D[m, j]
            for b in range(count):
                target[b] -= x * F[j, b]
        for b in range(count):
            target[b] *= D[m, m]


@fused_kernel
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


@fused_kernel
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
