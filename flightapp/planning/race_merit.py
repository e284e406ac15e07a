"""Slacks and multipliers of the search for a race line, and its merit: what a step is judged by.

The merit is the cost, the barrier of the slacks, and the violation of c + s = 0 at a price for each inequality.
"""

import math

from flightapp.frames import Vector
from flightapp.jit import inlined
from flightapp.planning.race_problem import AT_KNOT, KINDS, Problem
from flightapp.planning.race_samples import KNOT, SAMPLES
from flightapp.planning.race_work import Work

TO_BOUNDARY = 0.98
"""Share of the way to zero that slacks and multipliers may go in one step."""
SPREAD = 1e4
"""Ratio by which a multiplier may differ from the barrier over its slack."""
GROUPS = KINDS + 3
"""Kinds of inequalities, those of knots among them."""


@inlined
def _span(group: int) -> tuple[int, int]:
    """First place of a group of inequalities, and the one after its last."""
    if group < KINDS:
        return group * SAMPLES, (group + 1) * SAMPLES
    return AT_KNOT + group - KINDS, AT_KNOT + group - KINDS + 1


@inlined
def _logarithm(values: Vector) -> float:
    """Sum of the logarithms of ``values`` (k,), which are slacks: their product is within the range of floats."""
    product, total = 1.0, 0.0
    for k in range(values.size):
        product *= values[k]
        if not 1e-200 < product < 1e200:
            total += math.log(product)
            product = 1.0
    return total + math.log(product)


@inlined
def begin(problem: Problem, mu: float, least: float, work: Work) -> tuple[float, float]:
    """Slacks and multipliers to start with; the number of inequalities and the barrier."""
    n = work.slack.shape[0] - 1
    count, total = 0.0, 0.0
    for group in range(GROUPS):
        if problem.active[group] == 0.0:
            continue
        first, last = _span(group)
        count += n * (last - first)
        for i in range(n + 1):
            slack, dual, c = work.slack[i], work.dual[i], work.c[i]
            for place in range(first, last):
                if mu > 0.0:
                    slack[place] = max(-c[place], least)
                    dual[place] = mu / slack[place]
                else:
                    slack[place] = max(-c[place], slack[place])
                    total += slack[place] * dual[place]
    return count, mu if mu > 0.0 else total / count


@inlined
def change_slacks(problem: Problem, mu: float, work: Work) -> tuple[float, float]:
    """Turn `Work.slope` into the slacks' change and fill `turn`; the greatest steps of slacks and multipliers."""
    nearest, least = 1.0, 1.0
    for i in range(work.slack.shape[0]):
        for group in range(GROUPS):
            if problem.active[group] == 0.0:
                continue
            first, last = _span(group)
            slack, dual, c = work.slack[i, first:last], work.dual[i, first:last], work.c[i, first:last]
            change, turn = work.slope[i, first:last], work.turn[i, first:last]
            for k in range(slack.size):
                change[k] = -(c[k] + slack[k]) - change[k]
                turn[k] = (mu - dual[k] * change[k]) / slack[k] - dual[k]
            for k in range(slack.size):
                nearest = max(nearest, -change[k] / slack[k])
                least = max(least, -turn[k] / dual[k])
    return min(1.0, TO_BOUNDARY / nearest), min(1.0, TO_BOUNDARY / least)


@inlined
def price(problem: Problem, mu: float, weight: float, dually: float, work: Work) -> float:
    """Fill `Work.penalty`: ``weight`` times the multiplier, now or after the step. The merit besides the cost."""
    merit = 0.0
    for i in range(work.slack.shape[0]):
        for group in range(GROUPS):
            if problem.active[group] == 0.0:
                continue
            first, last = _span(group)
            penalty, dual, turn = work.penalty[i, first:last], work.dual[i, first:last], work.turn[i, first:last]
            slack, c = work.slack[i, first:last], work.c[i, first:last]
            for k in range(slack.size):
                penalty[k] = weight * max(dual[k], dual[k] + dually * turn[k])
                merit += penalty[k] * abs(c[k] + slack[k])
            merit -= mu * _logarithm(slack)
    return merit


@inlined
def tried_merit(problem: Problem, mu: float, share: float, work: Work) -> float:
    """The merit besides the cost after ``share`` of the step; fills `Work.tried_slack`."""
    merit = 0.0
    for i in range(work.slack.shape[0]):
        for group in range(GROUPS):
            if problem.active[group] == 0.0:
                continue
            first, last = _span(group)
            slack, change, c = work.slack[i, first:last], work.slope[i, first:last], work.tried_c[i, first:last]
            tried, penalty = work.tried_slack[i, first:last], work.penalty[i, first:last]
            for k in range(slack.size):
                tried[k] = max(slack[k] + share * change[k], -c[k])
                merit += penalty[k] * abs(c[k] + tried[k])
            merit -= mu * _logarithm(tried)
    return merit


@inlined
def accept(line: Vector, problem: Problem, mu: float, dually: float, work: Work) -> tuple[float, float]:
    """Go to what was tried; the sum of slacks times multipliers and the greatest violation there."""
    total, excess = 0.0, 0.0
    for i in range(work.slack.shape[0]):
        for group in range(GROUPS):
            if problem.active[group] == 0.0:
                continue
            first, last = _span(group)
            slack, dual, c = work.slack[i, first:last], work.dual[i, first:last], work.c[i, first:last]
            turn = work.turn[i, first:last]
            tried_slack, tried_c = work.tried_slack[i, first:last], work.tried_c[i, first:last]
            for k in range(slack.size):
                slack[k], c[k] = tried_slack[k], tried_c[k]
                ratio = mu / slack[k]
                dual[k] = min(max(dual[k] + dually * turn[k], ratio / SPREAD), ratio * SPREAD)
                total += slack[k] * dual[k]
                excess = max(excess, c[k])
        for a in range(KNOT):
            line[i, a] = work.tried[i, a]
    return total, excess
