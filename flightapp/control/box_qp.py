"""Small quadratic programs with bounds, by projected Newton steps.

After Y. Tassa, N. Mansard and E. Todorov, "Control-limited differential dynamic programming" (2014). Sizes are
arguments: where they are constants the compiler writes out what they count.
"""

import math

from flightapp.frames import Vector
from flightapp.jit import fused

STEPS = 12
"""Most Newton steps; what they find is feasible, and mostly exact after one or two."""
HALVINGS = 8


@fused
def _factorise(H: Vector, free: Vector, L: Vector, n: int) -> bool:
    """Cholesky factor ``L`` of the rows and columns of ``H`` that are free, identity elsewhere; False if there is none.

    Its diagonal is inverted.
    """
    for j in range(n):
        for i in range(j, n):
            held = free[i] == 0.0 or free[j] == 0.0
            total = (1.0 if i == j else 0.0) if held else H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                L[j, j] = 1.0 / math.sqrt(total)
            else:
                L[i, j] = total * L[j, j]
    return True


@fused
def _back_substitute(L: Vector, b: Vector, n: int) -> None:
    """Solve L Lᵀ x = ``b`` (n,) in place; the diagonal of ``L`` is inverted."""
    for i in range(n):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] *= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= L[k, i] * b[k]
        b[i] *= L[i, i]


@fused
def cost(H: Vector, g: Vector, x: Vector, n: int) -> float:
    """½ xᵀ ``H`` x + ``g``ᵀ x, of (n, n), (n,) and (n,)."""
    total = 0.0
    for i in range(n):
        row = 0.0
        for k in range(n):
            row += H[i, k] * x[k]
        total += x[i] * (0.5 * row + g[i])
    return float(total)


@fused
def _free(H: Vector, g: Vector, low: Vector, high: Vector, x: Vector, step: Vector, free: Vector, n: int) -> bool:
    """Gradient at ``x`` into ``step``, and which of ``x`` no bound holds; whether these are others than before."""
    changed = False
    for i in range(n):
        slope = g[i]
        for k in range(n):
            slope += H[i, k] * x[k]
        held = (x[i] <= low[i] and slope > 0.0) or (x[i] >= high[i] and slope < 0.0)
        now = 0.0 if held else 1.0
        changed = changed or now != free[i]
        free[i], step[i] = now, slope
    return changed


@fused
def _move(H: Vector, g: Vector, low: Vector, high: Vector, x: Vector, step: Vector, tried: Vector, n: int) -> bool:
    """Go along ``step`` and back into the bounds, as far as that pays; whether the whole step was within them."""
    before, share = cost(H, g, x, n), 1.0
    for _ in range(HALVINGS):
        whole = share == 1.0
        for i in range(n):
            wanted = x[i] - share * step[i]
            tried[i] = min(max(wanted, low[i]), high[i])
            whole = whole and tried[i] == wanted
        if whole or cost(H, g, tried, n) < before:
            for i in range(n):
                x[i] = tried[i]
            return whole
        share *= 0.5
    return False


@fused
def minimise(
    H: Vector, g: Vector, low: Vector, high: Vector, x: Vector, free: Vector, L: Vector, room: Vector, n: int
) -> bool:
    """Minimise ½ xᵀ ``H`` x + ``g``ᵀ x within ``low`` ≤ x ≤ ``high``, each (n,) or (n, n).

    ``x`` gets the minimum, ``free`` 1 where no bound holds it, ``L`` the factor of the free rows and columns of ``H``,
    its diagonal inverted; ``room`` is (2, n). False where ``H`` is not positive definite.
    """
    step, tried = room[0], room[1]
    for i in range(n):
        x[i], free[i] = min(max(0.0, low[i]), high[i]), -1.0
    settled = False
    for _ in range(STEPS):
        changed = _free(H, g, low, high, x, step, free, n)
        if settled and not changed:
            return True
        if changed and not _factorise(H, free, L, n):
            return False
        for i in range(n):
            step[i] *= free[i]
        _back_substitute(L, step, n)
        settled = _move(H, g, low, high, x, step, tried, n)
    return True
