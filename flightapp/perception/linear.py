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
def substitute(L: Vector, b: Vector) -> None:
    """Replace ``b`` (n,) by the solution of L Lᵀ x = b, with ``L`` (n, n) from `factor`."""
    n = b.size
    for i in range(n):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] /= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]
