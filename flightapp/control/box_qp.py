"""Small quadratic programs with bounds, by projected Newton steps.

After Y. Tassa, N. Mansard and E. Todorov, "Control-limited differential dynamic programming" (2014).
"""

import math

from flightapp.frames import Vector
from flightapp.jit import fused

STEPS = 12
"""Most Newton steps; what they find is feasible, and mostly exact after one or two."""
HALVINGS = 8


@fused
def _factorise(H: Vector, free: Vector, L: Vector) -> bool:
    """Cholesky factor ``L`` of the rows and columns of ``H`` that are free, identity elsewhere; False if there is none.

    Its diagonal is inverted.
    """
    n = free.shape[0]
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
def back_substitute(L: Vector, b: Vector) -> None:
    """Solve L Lᵀ x = ``b`` (n,) in place; the diagonal of ``L`` is inverted."""
    n = b.shape[0]
    for i in range(n):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] *= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= L[k, i] * b[k]
        b[i] *= L[i, i]


@fused
def cost(H: Vector, g: Vector, x: Vector) -> float:
    """½ xᵀ ``H`` x + ``g``ᵀ x, of (n, n), (n,) and (n,)."""
    total, n = 0.0, x.shape[0]
    for i in range(n):
        row = 0.0
        for k in range(n):
            row += H[i, k] * x[k]
        total += x[i] * (0.5 * row + g[i])
    return float(total)


@fused
def _free(H: Vector, g: Vector, low: Vector, high: Vector, x: Vector, step: Vector, free: Vector) -> bool:
    """Gradient at ``x`` into ``step``, and which of ``x`` no bound holds; whether these are others than before."""
    changed, n = False, x.shape[0]
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
def _move(H: Vector, g: Vector, low: Vector, high: Vector, x: Vector, step: Vector, tried: Vector) -> bool:
    """Go along ``step`` and back into the bounds, as far as that pays; whether the whole step was within them."""
    before, share, n = cost(H, g, x), 1.0, x.shape[0]
    for _ in range(HALVINGS):
        whole = share == 1.0
        for i in range(n):
            wanted = x[i] - share * step[i]
            tried[i] = min(max(wanted, low[i]), high[i])
            whole = whole and tried[i] == wanted
        if whole or cost(H, g, tried) < before:
            for i in range(n):
                x[i] = tried[i]
            return whole
        share *= 0.5
    return False


@fused
def minimise(H: Vector, g: Vector, low: Vector, high: Vector, x: Vector, free: Vector, L: Vector, room: Vector) -> bool:
    """Minimise ½ xᵀ ``H`` x + ``g``ᵀ x within ``low`` ≤ x ≤ ``high``, each (n,) or (n, n).

    ``x`` gets the minimum, ``free`` 1 where no bound holds it, ``L`` the factor of the free rows and columns of ``H``
    (`back_substitute`); ``room`` is (2, n). False where ``H`` is not positive definite.
    """
    step, tried, n = room[0], room[1], x.shape[0]
    for i in range(n):
        x[i], free[i] = min(max(0.0, low[i]), high[i]), -1.0
    settled = False
    for _ in range(STEPS):
        changed = _free(H, g, low, high, x, step, free)
        if settled and not changed:
            return True
        if changed and not _factorise(H, free, L):
            return False
        for i in range(n):
            step[i] *= free[i]
        back_substitute(L, step)
        settled = _move(H, g, low, high, x, step, tried)
    return True


@fused
def answer(full: Vector, half: Vector, L: Vector, free: Vector, feed: Vector, gains: Vector, value: Vector) -> None:
    """How a free input answers to changes of a state, and what the state is then worth: a step of Riccati's recursion.

    ``full`` (n + m, n + m) is the second derivative by state and input, ``half`` (n + m, n + 1) has the first as its
    last column, ``L`` (m, m) factorises the inputs' own part where they are ``free`` (m,), and ``feed`` (m,) is the
    inputs' best change. ``gains`` (m, n) and ``value`` (n, n + 1), the second derivative and the first, are filled.
    """
    inputs, states = gains.shape
    _solve(full, L, free, gains)
    for i in range(states):
        slope = half[i, states]
        for c in range(states):
            value[i, c] = full[i, c]
        for m in range(inputs):
            q = full[states + m, i]
            slope += q * feed[m]
            for c in range(states):
                value[i, c] += q * gains[m, c]
        value[i, states] = slope


@fused
def _solve(full: Vector, L: Vector, free: Vector, gains: Vector) -> None:
    """``gains`` (m, n) of `answer`."""
    inputs, states = gains.shape
    for i in range(inputs):
        for c in range(states):
            gains[i, c] = -free[i] * full[states + i, c]
        for m in range(i):
            for c in range(states):
                gains[i, c] -= L[i, m] * gains[m, c]
        for c in range(states):
            gains[i, c] *= L[i, i]
    for i in range(inputs - 1, -1, -1):
        for m in range(i + 1, inputs):
            for c in range(states):
                gains[i, c] -= L[m, i] * gains[m, c]
        for c in range(states):
            gains[i, c] *= L[i, i]
