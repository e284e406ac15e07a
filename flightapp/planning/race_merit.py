"""Slacks and multipliers of the search for a race line, and its merit: what a step is judged by.

The merit is the cost, the barrier of the slacks, and the violation of c + s = 0 at a price for each inequality.
"""

import math

from flightapp.frames import Vector
from flightapp.jit import fused
from flightapp.planning.race_problem import AT_KNOT, BRIEF, KINDS, PLACES, Problem
from flightapp.planning.race_samples import KNOT, SAMPLES
from flightapp.planning.race_work import Work

TO_BOUNDARY = 0.98
"""Share of the way to zero that slacks and multipliers may go in one step."""
SPREAD = 1e4
"""Ratio by which a multiplier may differ from the barrier over its slack."""


@fused
def _logarithm(values: Vector) -> float:
    """Sum of the logarithms of ``values`` (k,), which are slacks: their product is within the range of floats."""
    product, total = 1.0, 0.0
    for k in range(values.size):
        product *= values[k]
        if not 1e-200 < product < 1e200:
            total += math.log(product)
            product = 1.0
    return total + math.log(product)


@fused
def _count(problem: Problem, counted: Vector) -> None:
    """Fill ``counted`` (2, PLACES) with 1 for the inequalities that are wanted of a segment and of the last knot."""
    for place in range(PLACES):
        kind = place // SAMPLES if place < AT_KNOT else KINDS + place - AT_KNOT
        counted[0, place] = problem.active[kind]
        counted[1, place] = problem.active[kind] if place > BRIEF else 0.0


@fused
def begin(problem: Problem, mu: float, least: float, work: Work) -> tuple[float, float]:
    """Slacks and multipliers to start with; the number of inequalities and the barrier.

    Inequalities that are not wanted have the slack 1 and the multiplier 0, and keep them. With a negative ``mu`` slacks
    that are positive stay, with their multipliers, and the barrier is their mean product.
    """
    n = work.slack.shape[0] - 1
    count, known, total, anew = 0.0, 0.0, 0.0, mu > 0.0
    _count(problem, work.counted)
    for i in range(n + 1):
        slack, dual, c, wanted = work.slack[i], work.dual[i], work.c[i], work.counted[i // n]
        for k in range(PLACES):
            count += wanted[k]
            if not anew and slack[k] > 0.0:
                slack[k] = max(-c[k], slack[k])
                total += slack[k] * dual[k]
                known += wanted[k]
    barrier = mu if anew else total / known
    for i in range(n + 1):
        slack, dual, c, wanted = work.slack[i], work.dual[i], work.c[i], work.counted[i // n]
        for k in range(PLACES):
            if anew or slack[k] == 0.0:
                slack[k] = max(-c[k], least) if wanted[k] != 0.0 else 1.0
                dual[k] = barrier * wanted[k] / slack[k]
    return count, barrier


@fused
def change_slacks(mu: float, work: Work) -> tuple[float, float]:
    """Turn `Work.slope` into the slacks' change and fill `turn`; the greatest steps of slacks and multipliers."""
    nearest, least, n = 1.0, 1.0, work.slack.shape[0] - 1
    for i in range(n + 1):
        slack, dual, c, wanted = work.slack[i], work.dual[i], work.c[i], work.counted[i // n]
        change, turn = work.slope[i], work.turn[i]
        for k in range(PLACES):
            change[k] = -(c[k] + slack[k]) - change[k]
            turn[k] = (mu * wanted[k] - dual[k] * change[k]) / slack[k] - dual[k]
        for k in range(PLACES):
            # Divisions are waited for; most need none.
            if -change[k] > nearest * slack[k]:
                nearest = -change[k] / slack[k]
            if -turn[k] > least * dual[k]:
                least = -turn[k] / dual[k]
    return min(1.0, TO_BOUNDARY / nearest), min(1.0, TO_BOUNDARY / least)


@fused
def price(weight: float, dually: float, work: Work) -> float:
    """Fill `Work.penalty`: ``weight`` times the multiplier, now or after the step. What is violated at that price."""
    merit = 0.0
    for i in range(work.slack.shape[0]):
        penalty, dual, turn = work.penalty[i], work.dual[i], work.turn[i]
        slack, c = work.slack[i], work.c[i]
        for k in range(PLACES):
            penalty[k] = weight * max(dual[k], dual[k] + dually * turn[k])
            merit += penalty[k] * abs(c[k] + slack[k])
    return merit


@fused
def logarithms(slack: Vector) -> float:
    """Sum of the logarithms of all of ``slack`` (n + 1, PLACES)."""
    total = 0.0
    for i in range(slack.shape[0]):
        total += _logarithm(slack[i])
    return total


@fused
def tried_violation(share: float, work: Work) -> float:
    """What is violated after ``share`` of the step, at `Work.penalty`; fills `Work.tried_slack`."""
    merit = 0.0
    for i in range(work.slack.shape[0]):
        slack, change, c = work.slack[i], work.slope[i], work.tried_c[i]
        tried, penalty = work.tried_slack[i], work.penalty[i]
        for k in range(PLACES):
            tried[k] = max(slack[k] + share * change[k], -c[k])
            merit += penalty[k] * abs(c[k] + tried[k])
    return merit


@fused
def accept(line: Vector, mu: float, dually: float, work: Work) -> tuple[float, float]:
    """Go to what was tried; the sum of slacks times multipliers and the greatest violation there."""
    total, excess, n = 0.0, 0.0, work.slack.shape[0] - 1
    for i in range(n + 1):
        slack, dual, c, wanted = work.slack[i], work.dual[i], work.c[i], work.counted[i // n]
        turn, tried_slack, tried_c = work.turn[i], work.tried_slack[i], work.tried_c[i]
        for k in range(PLACES):
            slack[k], c[k] = tried_slack[k], tried_c[k]
            ratio = mu * wanted[k] / slack[k]
            dual[k] = min(max(dual[k] + dually * turn[k], ratio / SPREAD), ratio * SPREAD)
            total += slack[k] * dual[k]
        for k in range(PLACES):
            if c[k] > excess:  # noqa: PLR1730 - a branch that is hardly ever taken is faster than a maximum
                excess = c[k]
        for a in range(KNOT):
            line[i, a] = work.tried[i, a]
    return total, excess
