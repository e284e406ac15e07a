"""Descent on times and free points together: L-BFGS with a backtracking line search.

After J. Nocedal and S. Wright, "Numerical Optimization" (2006), algorithms 7.4, 7.5 and 3.1. Durations are
varied by their logarithm, which keeps them positive, and points in units of the legs that meet there.
"""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.planning.objective import cost

MEMORY = 10
"""Pairs of steps and gradient changes that approximate the curvature."""
STRIDE = 0.5
"""Greatest change of a variable in one step."""
SUFFICIENT = 1e-4
"""Share of the predicted descent that a step must achieve (Armijo)."""
TOLERANCE = 1e-4
"""Relative descent of one step below which the search is given up, after three such steps."""
SHORT = 0.05
"""m, least unit of a point."""
TRIES = 12
"""Step lengths tried in one direction."""

Problem = tuple[Vector, Vector, Vector, Vector, Vector, Vector, int, float, Vector]
"""Units of length, times, points, free, normals, limits, order, weight, derivatives: see `descend`."""


@kernel
def _units(points: Vector) -> Vector:
    """(n + 1,) m, the mean of the legs that meet at each point: short ones bend at smaller moves."""
    n = points.shape[0] - 1
    units = np.zeros(n + 1)
    for k in range(n):
        square = 0.0
        for axis in range(3):
            square += (points[k + 1, axis] - points[k, axis]) ** 2
        half = 0.5 * math.sqrt(square)
        units[k] += half
        units[k + 1] += half
    for k in range(n + 1):
        units[k] = max(units[k], SHORT)
    return units


@kernel
def _pack(units: Vector, times: Vector, points: Vector, free: Vector) -> Vector:
    """Variables (n + 3 per free point,): logarithms of times, then free points in units."""
    n = times.size
    size = n
    for k in range(n + 1):
        size += 3 if free[k] > 0.0 else 0
    x = np.empty(size)
    for i in range(n):
        x[i] = math.log(times[i])
    place = n
    for k in range(n + 1):
        if free[k] > 0.0:
            for axis in range(3):
                x[place + axis] = points[k, axis] / units[k]
            place += 3
    return x


@kernel
def _cost_at(x: Vector, problem: Problem, gradient: Vector) -> float:
    """`cost` at the packed variables; writes the problem's times, points, derivatives, and ``gradient``."""
    units, times, points, free, normals, limits, order, weight, derivatives = problem
    n = times.size
    for i in range(n):
        times[i] = math.exp(x[i])
    place = n
    for k in range(n + 1):
        if free[k] > 0.0:
            for axis in range(3):
                points[k, axis] = units[k] * x[place + axis]
            place += 3
    by_time, by_point = np.empty(n), np.empty((n + 1, 3))
    value = cost(times, points, normals, limits, order, weight, derivatives, by_time, by_point)
    for i in range(n):
        gradient[i] = by_time[i] * times[i]
    place = n
    for k in range(n + 1):
        if free[k] > 0.0:
            for axis in range(3):
                gradient[place + axis] = units[k] * by_point[k, axis]
            place += 3
    return value


@kernel
def _dot(a: Vector, b: Vector) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@kernel
def _direction(gradient: Vector, steps: Vector, changes: Vector, count: int, out: Vector) -> None:
    """The two-loop recursion: fill ``out`` with minus the inverse curvature times the gradient."""
    shares = np.empty(MEMORY)
    for i in range(out.size):
        out[i] = -gradient[i]
    held = min(count, MEMORY)
    for back in range(held):
        slot = (count - 1 - back) % MEMORY
        shares[slot] = _dot(steps[slot], out) / _dot(steps[slot], changes[slot])
        for i in range(out.size):
            out[i] -= shares[slot] * changes[slot, i]
    scale = 0.1 / max(math.sqrt(_dot(gradient, gradient)), 0.1)
    if held > 0:
        slot = (count - 1) % MEMORY
        scale = _dot(steps[slot], changes[slot]) / _dot(changes[slot], changes[slot])
    for i in range(out.size):
        out[i] *= scale
    for back in range(held - 1, -1, -1):
        slot = (count - 1 - back) % MEMORY
        share = shares[slot] - _dot(changes[slot], out) / _dot(steps[slot], changes[slot])
        for i in range(out.size):
            out[i] += share * steps[slot, i]


@kernel
def _search(
    x: Vector, value: float, slope: float, direction: Vector, problem: Problem, tried: Vector, gradient: Vector
) -> float:
    """Cost at the first step along ``direction`` that descends enough, found in ``tried``; infinite if none does."""
    longest = 0.0
    for i in range(x.size):
        longest = max(longest, abs(direction[i]))
    step = min(1.0, STRIDE / longest)
    for _ in range(TRIES):
        for i in range(x.size):
            tried[i] = x[i] + step * direction[i]
        reached = _cost_at(tried, problem, gradient)
        if reached <= value + SUFFICIENT * step * slope:
            return reached
        bend = reached - value - slope * step
        fitted = -0.5 * slope * step * step / bend if 0.0 < bend < math.inf else 0.0
        step = min(max(fitted, 0.1 * step), 0.5 * step)
    return math.inf


@kernel
def descend(
    times: Vector,
    points: Vector,
    free: Vector,
    normals: Vector,
    limits: Vector,
    order: int,
    weight: float,
    derivatives: Vector,
    iterations: int,
) -> float:
    """Improve ``times`` (n,) and those ``points`` (n + 1, 3) where ``free`` (n + 1,) is 1, in place.

    ``derivatives`` (3 (n + 1), 3) are those of the smoothest spline on return; the other arguments are those
    of `cost`. Returns the cost, infinite where it could not be computed.
    """
    units = _units(points)
    x = _pack(units, times, points, free)
    problem = (units, times, points, free, normals, limits, order, weight, derivatives)
    gradient, tried_gradient = np.empty(x.size), np.empty(x.size)
    direction, tried = np.empty(x.size), np.empty(x.size)
    steps, changes = np.empty((MEMORY, x.size)), np.empty((MEMORY, x.size))
    value = _cost_at(x, problem, gradient)
    count, idle = 0, 0
    for _ in range(iterations):
        if not value < math.inf or idle == 3:
            break
        _direction(gradient, steps, changes, count, direction)
        slope = _dot(gradient, direction)
        reached = math.inf
        if slope < 0.0:
            reached = _search(x, value, slope, direction, problem, tried, tried_gradient)
        if not reached < math.inf:
            if count == 0:
                break
            count = 0
            continue
        idle = idle + 1 if value - reached < TOLERANCE * abs(value) else 0
        curvature, change = 0.0, 0.0
        for i in range(x.size):
            curvature += (tried[i] - x[i]) * (tried_gradient[i] - gradient[i])
            change += (tried_gradient[i] - gradient[i]) ** 2
        # A pair without positive curvature must not replace the oldest one that is still in use.
        keep = curvature > 1e-12 * change
        for i in range(x.size):
            if keep:
                steps[count % MEMORY, i] = tried[i] - x[i]
                changes[count % MEMORY, i] = tried_gradient[i] - gradient[i]
            x[i], gradient[i] = tried[i], tried_gradient[i]
        value = reached
        count += 1 if keep else 0
    return _cost_at(x, problem, gradient)
