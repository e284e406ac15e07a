"""Descent on the times of a plan: L-BFGS with a backtracking line search.

After J. Nocedal and S. Wright, "Numerical Optimization" (2006), algorithms 7.4, 7.5 and 3.1. Durations are varied by
their logarithm, which keeps them positive.
"""

import math
from typing import NamedTuple

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.planning.hermite import Order
from flightapp.planning.minimum import smoothest
from flightapp.planning.objective import cost
from flightapp.planning.spline import Spline

MEMORY = 6
"""Pairs of steps and gradient changes that approximate the curvature."""
STRIDE = 0.5
"""Greatest change of a variable in one step."""
SUFFICIENT = 1e-4
"""Share of the predicted descent that a step must achieve (Armijo)."""
MOST = 60
"""Evaluations of the cost in one descent."""
TRIES = 12
"""Step lengths tried in one direction."""


class Search(NamedTuple):
    """Room for a descent on n variables."""

    vectors: Vector
    """(5, n) variables, their gradient, the direction, and variables and gradient being tried."""
    steps: Vector
    """(MEMORY, n)."""
    changes: Vector
    """(MEMORY, n)."""
    shares: Vector
    """(2, MEMORY)."""


def search(n: int) -> Search:
    """Room for ``n`` variables."""
    room = np.empty((5 + 2 * MEMORY, n))
    return Search(room[:5], room[5 : 5 + MEMORY], room[5 + MEMORY :], np.empty((2, MEMORY)))


@inlined
def _dot(a: Vector, b: Vector) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@inlined
def _direct(search: Search, count: int) -> float:
    """The two-loop recursion: minus the inverse curvature times the gradient; returns the slope along it."""
    gradient, out = search.vectors[1], search.vectors[2]
    steps, changes, shares, curvatures = search.steps, search.changes, search.shares[0], search.shares[1]
    for i in range(out.size):
        out[i] = -gradient[i]
    held = min(count, MEMORY)
    for back in range(held):
        slot = (count - 1 - back) % MEMORY
        shares[slot] = _dot(steps[slot], out) / curvatures[slot]
        for i in range(out.size):
            out[i] -= shares[slot] * changes[slot, i]
    scale = 0.1 / max(math.sqrt(_dot(gradient, gradient)), 0.1)
    if held > 0:
        slot = (count - 1) % MEMORY
        scale = curvatures[slot] / _dot(changes[slot], changes[slot])
    for i in range(out.size):
        out[i] *= scale
    for back in range(held - 1, -1, -1):
        slot = (count - 1 - back) % MEMORY
        share = shares[slot] - _dot(changes[slot], out) / curvatures[slot]
        for i in range(out.size):
            out[i] += share * steps[slot, i]
    return _dot(gradient, out)


@inlined
def _remember(search: Search, count: int, first: bool) -> int:
    """Go on from what was tried; returns how many pairs were remembered, of those with positive curvature."""
    x, gradient, tried, found = search.vectors[0], search.vectors[1], search.vectors[3], search.vectors[4]
    slot = count % MEMORY
    curvature, change = 0.0, 0.0
    for i in range(x.size):
        curvature += (tried[i] - x[i]) * (found[i] - gradient[i])
        change += (found[i] - gradient[i]) ** 2
    keep = curvature > 1e-12 * change and not first
    for i in range(x.size):
        if keep:
            search.steps[slot, i] = tried[i] - x[i]
            search.changes[slot, i] = found[i] - gradient[i]
        x[i], gradient[i] = tried[i], found[i]
    if keep:
        search.shares[1, slot] = curvature
        return count + 1
    return count


@inlined
def _aim(search: Search, count: int) -> tuple[int, float, float]:
    """Set the direction; how many pairs it uses (none of them if they do not lead down), its slope, and a step."""
    slope, longest = 0.0, 0.0
    for _ in range(2):
        slope = _direct(search, count)
        if slope < 0.0 or count == 0:
            break
        count = 0
    for i in range(search.vectors.shape[1]):
        longest = max(longest, abs(search.vectors[2, i]))
    return count, slope, min(1.0, STRIDE / max(longest, 1e-300))


@inlined
def _shorter(step: float, slope: float, rise: float) -> float:
    """The next step after one that changed the cost by ``rise``: the least point of the parabola through both."""
    bend = rise - slope * step
    fitted = -0.5 * slope * step * step / bend if 0.0 < bend < math.inf else 0.0
    return min(max(fitted, 0.1 * step), 0.5 * step)


@inlined
def _set_times(s: Spline, logs: Vector) -> None:
    for i in range(logs.size):
        s.times[i] = math.exp(logs[i])


@lean_kernel
def descend(
    order: Order, s: Spline, search: Search, limits: Vector, weight: float, tolerance: float, patience: int
) -> float:
    """Improve the times of ``s`` in place until ``patience`` steps in a row gain less than ``tolerance`` of the cost.

    The other arguments are those of `cost`. Returns the cost, infinite where it could not be computed.
    """
    x, direction, tried = search.vectors[0], search.vectors[2], search.vectors[3]
    for i in range(x.size):
        tried[i] = math.log(s.times[i])
    # The first round evaluates the start itself: a step of no length that always counts.
    value, slope, step, count, idle, tries, stale = math.inf, 0.0, 0.0, 0, 0, 0, False
    for _ in range(MOST):
        _set_times(s, tried)
        reached = cost(order, s, limits, weight, search.vectors[4])
        if not min(reached, value) < math.inf:
            return math.inf
        stale = not reached <= value + SUFFICIENT * step * slope
        if not stale:
            idle = idle + 1 if value - reached < tolerance * reached else 0
            count = _remember(search, count, value == math.inf)
            value, tries = reached, 0
        elif tries < TRIES:
            tries += 1
            step = _shorter(step, slope, reached - value)
        else:
            idle = patience if count == 0 else idle
            count, tries = 0, 0
        if idle == patience:
            break
        if tries == 0:
            count, slope, step = _aim(search, count)
            if not slope < 0.0:
                break
        for i in range(x.size):
            tried[i] = x[i] + step * direction[i]
    if stale:
        _set_times(s, x)
        smoothest(order, s.times, s.points, s.ends, s.derivatives, s.factors, s.couplings)
    return value
