"""Finds a race line: a primal-dual interior-point method with slacks.

After J. Nocedal and S. Wright, "Numerical Optimization" (2006), chapter 19, with two changes that matter here. A step
is taken along a curve on which derivatives scale with durations, so that flying all or a part faster does not bend the
line. And each inequality's violation counts in the merit by its own multiplier: with one penalty for all, large enough
for the hardest, steps along curved limits would all be cut short (Maratos effect).
"""

import math
from typing import NamedTuple

from flightapp.frames import Vector
from flightapp.jit import fused, fused_kernel
from flightapp.planning.race_merit import accept, begin, change_slacks, logarithms, price, tried_violation
from flightapp.planning.race_problem import Problem, evaluate
from flightapp.planning.race_samples import DURATION, KNOT
from flightapp.planning.race_step import move, slopes, take_step
from flightapp.planning.race_system import assemble
from flightapp.planning.race_work import Work

SHORTEST = 0.3
"""Least duration a segment may reach in one step, of the least allowed."""
TRIES = 6
"""Halvings of a step."""
MOST_DAMPING, LEAST_DAMPING = 1e4, 1e-9
MORE, LESS = 4.0, 0.2
"""Ratios by which damping changes after a step that was cut short, and after one that was not."""

STEP, TRY, REFUSAL = 6, 1, 2
"""Effort of a step, of each further trial of its length, and of each further damping; one is some 2 µs per segment."""


class Parameters(NamedTuple):
    """How to search."""

    barrier: float
    """s, the first weight of the barrier; negative to keep slacks and multipliers from a search before."""
    enough: int
    """Steps after which to stop as soon as all is kept to, even while there is still time to be gained."""
    steps: int
    """The most steps."""
    effort: int
    """The most effort, but for what the last step takes."""
    gap: float
    """Share of the duration to which the duration is to be found."""
    excess: float
    """The greatest violation at samples that is left."""
    least_slack: float
    """At first."""
    settled: float
    """The barrier shrinks once the step promises less than this share of all inequalities times the barrier."""
    shrink: float
    """The ratio by which it does."""
    damping: float
    """At first."""
    weight: float
    """A violation costs this many times its multiplier."""


@fused
def _room_for_durations(line: Vector, problem: Problem, work: Work, share: float) -> float:
    """As much of ``share`` of the step as leaves each segment some duration."""
    for i in range(line.shape[0] - 1):
        shorter = -work.step[i, DURATION]
        if shorter > 0.0:
            share = min(share, 0.9 * (line[i, DURATION] - SHORTEST * problem.briefest[i]) / shorter)
    return share


@fused
def _promise(work: Work) -> float:
    """What the step promises: twice the descent of the quadratic model."""
    total = 0.0
    for i in range(work.step.shape[0]):
        for a in range(KNOT):
            total += work.right[i, a] * work.step[i, a]
    return total


@fused
def _duration(line: Vector) -> float:
    total = 0.0
    for i in range(line.shape[0] - 1):
        total += line[i, DURATION]
    return total


@fused_kernel
def improve(line: Vector, problem: Problem, parameters: Parameters, work: Work) -> int:
    """Make ``line`` (n + 1, 13) faster in place; returns the effort it took, negative where the arithmetic failed.

    The effort counts `STEP`, `TRY` and `REFUSAL` per segment; no step is begun once it exceeds ``parameters.effort``.
    """
    mu, damping, gap = parameters.barrier, parameters.damping, parameters.gap
    cost = evaluate(line, problem, work.ends, work.samples, work.near, work.c)
    count, mu = begin(problem, mu, parameters.least_slack, work)
    logs = logarithms(work.slack)
    before_last, last, effort = math.inf, math.inf, 0
    for steps in range(parameters.steps):
        if effort >= parameters.effort:
            break
        assemble(line, problem, mu, work)
        taken, refused = take_step(line, problem, damping, work)
        effort += STEP + REFUSAL * refused
        if taken < 0.0:
            return -effort
        slopes(line, problem, work)
        share, dually = change_slacks(mu, work)
        share = _room_for_durations(line, problem, work, share)
        merit = cost - mu * logs + price(parameters.weight, dually, work)
        tries = 0
        while True:
            move(line, work.step, share, problem, work.tried)
            cost = evaluate(work.tried, problem, work.ends, work.samples, work.near, work.tried_c)
            violation = tried_violation(share, work)
            logs = logarithms(work.tried_slack)
            if cost - mu * logs + violation < merit or tries == TRIES:
                break
            share *= 0.5
            tries += 1
        effort += TRY * tries
        complementarity, excess = accept(line, mu, dually, work)
        total = _duration(line)
        settled = steps + 1 >= parameters.enough or before_last - total < 0.3 * gap * total
        if settled and complementarity < gap * total and excess < parameters.excess:
            break
        before_last, last = last, total
        if tries > 0:
            damping = min(MORE * taken, MOST_DAMPING)
        elif taken == damping:
            damping = max(LESS * damping, LEAST_DAMPING)
        else:
            damping = taken
        if _promise(work) < parameters.settled * count * mu:
            mu = max(parameters.shrink * min(mu, complementarity / count), 0.3 * gap * total / count)
    return effort
