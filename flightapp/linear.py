"""Small symmetric systems by Cholesky's method, in place and without allocation."""

import math

from flightapp.frames import Vector
from flightapp.jit import kernel


@kernel
def factor(A: Vector) -> bool:
    """Replace the lower half of ``A`` (n, n), symmetric, by its Cholesky factor; False where it is not positive."""
    for i in range(A.shape[0]):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            if i > j:
                A[i, j] = total / A[j, j]
            elif total > 0.0 and math.isfinite(total):
                A[i, i] = math.sqrt(total)
            else:
                return False
    return True


@kernel
def whiten(L: Vector, v: Vector) -> None:
    """Replace ``v`` (n,) by L⁻¹ v, with ``L`` (n, n) from `factor`."""
    for i in range(v.size):
        for k in range(i):
            v[i] -= L[i, k] * v[k]
        v[i] /= L[i, i]


@kernel
def substitute(L: Vector, b: Vector) -> None:
    """Replace ``b`` (n,) by the solution of L Lᵀ x = b, with ``L`` (n, n) from `factor`."""
    whiten(L, b)
    for i in range(b.size - 1, -1, -1):
        for k in range(i + 1, b.size):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]
