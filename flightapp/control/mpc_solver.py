"""Plans the inputs of a horizon: iterated linear-quadratic regulation with bounds on the inputs.

After Y. Tassa, N. Mansard and E. Todorov, "Control-limited differential dynamic programming" (2014), with Gauss and
Newton's second derivatives, one or few iterations per tick on from the plan before (M. Diehl, H. G. Bock and J.
Schlöder, "A real-time iteration scheme for nonlinear optimization in optimal feedback control", 2005).
"""

import math

from flightapp.control.box_qp import cost, minimise
from flightapp.control.mpc_cost import add_state_cost, input_cost, input_weights, state_cost
from flightapp.control.mpc_model import INPUTS, TANGENT, difference, linearise, pull_back, step
from flightapp.control.mpc_work import Work
from flightapp.control.parameters import Parameters, unpacked
from flightapp.control.riccati import WIDE, answer, transpose
from flightapp.control.vectors import Triple, axes, dot
from flightapp.frames import Vector
from flightapp.jit import fused, fused_kernel

BOTH = TANGENT + INPUTS
SHARES = (1.0, 0.25)
"""Of the best change that are tried, until one pays."""
SETTLED = 1e-6
"""An expected gain below this share of the cost, or below this itself, is none."""
PLANNED, NO_PROGRESS, NOT_FINITE = 0, 1, 2
"""How a search ends."""


@fused
def _clipped(work: Work, i: int, value: float) -> float:
    return float(min(max(value, work.bounds[0, i]), work.bounds[1, i]))


@fused
def _go(p: Parameters, work: Work, k: int, x: Vector, u: Vector, push: Triple) -> float:
    """Make the ``k``-th step of the states ``x`` under the inputs ``u``; what it costs."""
    grid, r = work.grid[k], work.reference[k + 1]
    step(p, x[k], u[k], grid, push, x[k + 1])
    cost = grid[0] * input_cost(p, r, work.wanted[k], u[k])
    return float(cost + state_cost(p, x[k + 1], r, grid[0], k == u.shape[0] - 1))


@fused
def _begin(p: Parameters, work: Work, push: Triple) -> float:
    """The plan that was carried on, as states and inputs from `x`'s first on; its cost."""
    cost = 0.0
    for k in range(work.u.shape[0]):
        x, asked, wanted = work.x[k], work.asked[k], work.wanted[k]
        body, omega = axes((x[6], x[7], x[8], x[9])), (asked[0], asked[1], asked[2])
        wanted[0], wanted[1], wanted[2] = dot(body[0], omega), dot(body[1], omega), dot(body[2], omega)
        wanted[3] = asked[3]
        for i in range(INPUTS):
            work.u[k, i] = _clipped(work, i, wanted[i] + work.off[k, i])
        cost += _go(p, work, k, work.x, work.u, push)
    return cost


@fused
def _try(p: Parameters, work: Work, share: float, push: Triple) -> float:
    """The plan changed by ``share`` of the best change, in `tried_x` and `tried_u`; its cost."""
    cost = 0.0
    for i in range(work.x.shape[1]):
        work.tried_x[0, i] = work.x[0, i]
    for k in range(work.u.shape[0]):
        gains = work.gains[k]
        difference(work.x[k], work.tried_x[k], work.difference)
        for i in range(INPUTS):
            wanted = work.u[k, i] + share * work.feed[k, i]
            for c in range(TANGENT):
                wanted += gains[WIDE * i + c] * work.difference[c]
            work.tried_u[k, i] = _clipped(work, i, wanted)
        cost += _go(p, work, k, work.tried_x, work.tried_u, push)
    return cost


@fused
def accept(u: Vector, x: Vector, tried_u: Vector, tried_x: Vector) -> None:
    """Plan on from what was tried: inputs ``u`` (n, …) and states ``x`` (n + 1, …), the first of which stays."""
    for k in range(u.shape[0]):
        for i in range(u.shape[1]):
            u[k, i] = tried_u[k, i]
        for i in range(x.shape[1]):
            x[k + 1, i] = tried_x[k + 1, i]


@fused
def _improve(p: Parameters, work: Work, k: int) -> float:
    """The ``k``-th input's best change, and what it gains (≤ 0); NaN where there is none.

    `value` holds the cost to go after the step.
    """
    grid, u, full, half, across = work.grid[k], work.u[k], work.full, work.half, work.across
    linearise(p, work.x[k], u, grid, work.changes)
    pull_back(work.changes, grid, work.value, half)
    transpose(half, across, TANGENT, BOTH)
    pull_back(work.changes, grid, across, full)
    turn, yaw, lift = input_weights(p, work.reference[k + 1])
    weights = (turn, turn, yaw, lift)
    H, low, high, slope = work.small[0:4], work.small[8], work.small[9], work.lines[0]
    for i in range(INPUTS):
        weight = grid[0] * weights[i]
        slope[i] = half[WIDE * (TANGENT + i) + TANGENT] + weight * (u[i] - work.wanted[k, i])
        low[i], high[i] = work.bounds[0, i] - u[i], work.bounds[1, i] - u[i]
        for m in range(INPUTS):
            H[i, m] = full[WIDE * (TANGENT + i) + TANGENT + m]
        H[i, i] += weight
    feed = work.feed[k]
    if not minimise(H, slope, low, high, feed, work.lines[1], work.small[4:8], work.lines[2:4], INPUTS):
        return math.nan
    return cost(H, slope, feed, INPUTS)


@fused
def _backward(p: Parameters, work: Work) -> float:
    """The best changes of all inputs, from the last on; what they are expected to gain, NaN where there are none."""
    n, gain = work.u.shape[0], 0.0
    value = work.value
    for i in range(value.shape[0]):
        value[i] = 0.0
    for k in range(n - 1, -1, -1):
        add_state_cost(p, work.x[k + 1], work.reference[k + 1], work.grid[k, 0], k == n - 1, value)
        gain += _improve(p, work, k)
        factor, free, feed, gains = work.small[4:8], work.lines[1], work.feed[k], work.gains[k]
        answer(work.full, work.half, factor, free, feed, gains, value, TANGENT, INPUTS)
    return gain


@fused_kernel
def plan(work: Work, push: Triple, iterations: int) -> int:
    """Improve the plan `off` for the first state in `x` by so many ``iterations``; how that ended.

    `reference`, `asked` and `bounds` say what is wanted and allowed. The ``push`` (world, m/s²) acts on the vehicle
    throughout. The planned inputs are left in `u`, the states in `x`; where it ended with NOT_FINITE they are of no
    use.
    """
    p = unpacked(work.believed)
    cost = _begin(p, work, push)
    if not math.isfinite(cost):
        return NOT_FINITE
    for iteration in range(iterations):
        gain = _backward(p, work)
        if not math.isfinite(gain):
            return NOT_FINITE
        if -gain <= SETTLED * (1.0 + cost):
            break
        better = False
        for share in SHARES:
            tried = _try(p, work, share, push)
            if tried < cost:
                accept(work.u, work.x, work.tried_u, work.tried_x)
                cost, better = tried, True
                break
        if not better:
            if iteration == 0:
                return NO_PROGRESS
            break
    for k in range(work.u.shape[0]):
        for i in range(INPUTS):
            work.off[k, i] = work.u[k, i] - work.wanted[k, i]
    return PLANNED
