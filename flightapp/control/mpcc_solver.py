"""The inputs of a contouring horizon, and the rates of its progress, planned together.

As in `mpc_solver`, with the progress as two more states: the line's time τ, and its rate; the input that it has is the
rate at the end of each step, towards which it goes evenly. It touches the vehicle only through what the horizon costs.
"""

import math

from flightapp.control.box_qp import cost, minimise
from flightapp.control.mpc_cost import input_cost, input_weights
from flightapp.control.mpc_model import INPUTS as DRIVEN
from flightapp.control.mpc_model import difference, linearise, pull_back, step
from flightapp.control.mpc_solver import NO_PROGRESS, NOT_FINITE, PLANNED, SETTLED, accept
from flightapp.control.mpcc_cost import add_state_cost, state_cost
from flightapp.control.mpcc_horizon import contour_from
from flightapp.control.mpcc_work import INPUTS, PROGRESS, TANGENT, Contour, ContourWork
from flightapp.control.parameters import Parameters, unpacked
from flightapp.control.riccati import WIDE, answer, transpose
from flightapp.control.vectors import Triple, axes, dot
from flightapp.frames import Vector
from flightapp.jit import fused, fused_kernel

RATE = DRIVEN
"""Place of the rate among the inputs."""
BOTH = TANGENT + INPUTS
SHARES = (1.0, 0.25, 0.0625)
"""Of the best change that are tried, until one pays."""


@fused
def _clipped(work: ContourWork, k: int, i: int, value: float) -> float:
    return float(min(max(value, work.bounds[k, 0, i]), work.bounds[k, 1, i]))


@fused
def _rate_cost(c: Contour, work: ContourWork, k: int, before: float, rate: float) -> float:
    h, lacking, change = work.grid[k, 0], work.bounds[k, 1, RATE] - rate, rate - before
    return float(0.5 * (h * c.progress * lacking * lacking + c.steady / h * change * change))


@fused
def _go(p: Parameters, c: Contour, work: ContourWork, k: int, x: Vector, u: Vector, push: Triple) -> float:
    """Make the ``k``-th step of the states ``x`` under the inputs ``u``; what it costs."""
    grid, r, now, then, rate = work.grid[k], work.reference[k + 1], x[k], x[k + 1], u[k, RATE]
    step(p, now[PROGRESS:], u[k], grid, push, then[PROGRESS:])
    then[0], then[1] = now[0] + 0.5 * grid[0] * (now[1] + rate), rate
    cost = grid[0] * input_cost(p, r, work.wanted[k], u[k]) + _rate_cost(c, work, k, now[1], rate)
    return float(cost + state_cost(p, then, r, grid[0], k == u.shape[0] - 1))


@fused
def _begin(p: Parameters, c: Contour, work: ContourWork, push: Triple) -> float:
    """The plan that was carried on, as states and inputs from `x`'s first on; its cost."""
    cost = 0.0
    for k in range(work.u.shape[0]):
        x, asked, wanted = work.x[k], work.asked[k], work.wanted[k]
        body, omega = axes((x[8], x[9], x[10], x[11])), (asked[0], asked[1], asked[2])
        wanted[0], wanted[1], wanted[2] = dot(body[0], omega), dot(body[1], omega), dot(body[2], omega)
        wanted[3] = asked[3]
        for i in range(DRIVEN):
            work.u[k, i] = _clipped(work, k, i, wanted[i] + work.off[k, i])
        work.u[k, RATE] = work.rates[k + 1]
        cost += _go(p, c, work, k, work.x, work.u, push)
    return cost


@fused
def _try(p: Parameters, c: Contour, work: ContourWork, share: float, push: Triple) -> float:
    """The plan changed by ``share`` of the best change, in `tried_x` and `tried_u`; its cost."""
    cost, change = 0.0, work.difference
    for i in range(work.x.shape[1]):
        work.tried_x[0, i] = work.x[0, i]
    for k in range(work.u.shape[0]):
        x, tried = work.x[k], work.tried_x[k]
        for i in range(PROGRESS):
            change[i] = tried[i] - x[i]
        difference(x[PROGRESS:], tried[PROGRESS:], change[PROGRESS:])
        for i in range(INPUTS):
            wanted = work.u[k, i] + share * work.feed[k, i]
            for m in range(TANGENT):
                wanted += work.gains[k, WIDE * i + m] * change[m]
            work.tried_u[k, i] = _clipped(work, k, i, wanted)
        cost += _go(p, c, work, k, work.tried_x, work.tried_u, push)
    return cost


@fused
def _pull_back(work: ContourWork, grid: Vector, rows: Vector, out: Vector) -> None:
    """``out`` (20 WIDE,) = Fᵀ ``rows`` (15 WIDE,), where F (15, 20) are a step's derivatives by state and input."""
    pull_back(work.changes, grid, rows[PROGRESS * WIDE :], out[PROGRESS * WIDE :])
    half = 0.5 * grid[0]
    for c in range(WIDE):
        along = half * rows[c]
        out[c], out[WIDE + c] = rows[c], along
        out[(TANGENT + RATE) * WIDE + c] = along + rows[WIDE + c]


@fused
def _improve(p: Parameters, c: Contour, work: ContourWork, k: int) -> float:
    """The ``k``-th input's best change, and what it gains (≤ 0); NaN where there is none.

    `value` holds the cost to go after the step.
    """
    grid, x, u, full, half, across = work.grid[k], work.x[k], work.u[k], work.full, work.half, work.across
    linearise(p, x[PROGRESS:], u, grid, work.changes)
    _pull_back(work, grid, work.value, half)
    transpose(half, across, TANGENT, BOTH)
    _pull_back(work, grid, across, full)
    h, last = grid[0], TANGENT + RATE
    keep, change = c.steady / h, u[RATE] - x[1]
    full[WIDE + 1] += keep
    full[WIDE + last] -= keep
    full[WIDE * last + 1] -= keep
    half[WIDE + TANGENT] -= keep * change
    turn, yaw, lift = input_weights(p, work.reference[k + 1])
    weights = (h * turn, h * turn, h * yaw, h * lift)
    H, low, high, slope = work.small[0:INPUTS], work.small[2 * INPUTS], work.small[2 * INPUTS + 1], work.lines[0]
    for i in range(INPUTS):
        slope[i] = half[WIDE * (TANGENT + i) + TANGENT]
        low[i], high[i] = work.bounds[k, 0, i] - u[i], work.bounds[k, 1, i] - u[i]
        for m in range(INPUTS):
            H[i, m] = full[WIDE * (TANGENT + i) + TANGENT + m]
    for i in range(DRIVEN):
        slope[i] += weights[i] * (u[i] - work.wanted[k, i])
        H[i, i] += weights[i]
    slope[RATE] += keep * change - h * c.progress * (work.bounds[k, 1, RATE] - u[RATE])
    H[RATE, RATE] += keep + h * c.progress
    feed, factor = work.feed[k], work.small[INPUTS : 2 * INPUTS]
    if not minimise(H, slope, low, high, feed, work.lines[1], factor, work.lines[2:4], INPUTS):
        return math.nan
    return cost(H, slope, feed, INPUTS)


@fused
def _backward(p: Parameters, c: Contour, work: ContourWork) -> float:
    """The best changes of all inputs, from the last on; what they are expected to gain, NaN where there are none."""
    n, gain, value = work.u.shape[0], 0.0, work.value
    for i in range(value.shape[0]):
        value[i] = 0.0
    for k in range(n - 1, -1, -1):
        add_state_cost(p, work.x[k + 1], work.reference[k + 1], work.grid[k, 0], k == n - 1, value)
        gain += _improve(p, c, work, k)
        factor, free, feed, gains = work.small[INPUTS : 2 * INPUTS], work.lines[1], work.feed[k], work.gains[k]
        answer(work.full, work.half, factor, free, feed, gains, value, TANGENT, INPUTS)
    return gain


@fused_kernel
def plan(work: ContourWork, push: Triple, iterations: int) -> int:
    """Improve the plan in `off` and `rates` for the first state in `x` by so many ``iterations``; how that ended.

    As `mpc_solver.plan`.
    """
    p, c = unpacked(work.believed), contour_from(work.contour)
    cost = _begin(p, c, work, push)
    if not math.isfinite(cost):
        return NOT_FINITE
    for iteration in range(iterations):
        gain = _backward(p, c, work)
        if not math.isfinite(gain):
            return NOT_FINITE
        if -gain <= SETTLED * (1.0 + cost):
            break
        better = False
        for share in SHARES:
            tried = _try(p, c, work, share, push)
            if tried < cost:
                accept(work.u, work.x, work.tried_u, work.tried_x)
                cost, better = tried, True
                break
        if not better:
            if iteration == 0:
                return NO_PROGRESS
            break
    for k in range(work.u.shape[0]):
        for i in range(DRIVEN):
            work.off[k, i] = work.u[k, i] - work.wanted[k, i]
        work.rates[k + 1] = work.u[k, RATE]
    return PLANNED
