"""Pattern search (R. Hooke and T. Jeeves, "Direct search solution of numerical and statistical problems", 1961).

Along one parameter at a time, then on in the direction in which that led; deterministic, and content with a cost that
has no derivative. Parameters are positive, and steps are factors.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

Point = Mapping[str, float]
Cost = Callable[[Point], float]

FIRST, LAST = 1.4, 1.05
"""Factor by which a parameter is changed at first, and the least."""


@dataclass(frozen=True, slots=True)
class Range:
    """A parameter and the range in which it is sought."""

    name: str
    low: float
    high: float


class _Budget:
    """Costs, each computed once, until there have been too many."""

    def __init__(self, cost: Cost, most: int) -> None:
        self._cost, self._left = cost, most
        self._known: dict[tuple[float, ...], float] = {}

    @property
    def spent(self) -> bool:
        return self._left <= 0

    def __call__(self, point: Point) -> float:
        key = tuple(round(value, 9) for value in point.values())
        if key not in self._known:
            self._left -= 1
            self._known[key] = self._cost(point)
        return self._known[key]


def pattern_search(
    cost: Cost, start: Point, ranges: Sequence[Range], evaluations: int
) -> tuple[dict[str, float], float]:
    """The best point found from ``start`` with about so many ``evaluations`` of ``cost``, and its cost."""
    budget = _Budget(cost, evaluations)
    best = dict(start)
    least = budget(best)
    factor = FIRST
    while factor >= LAST and not budget.spent:
        point, found = _explore(budget, best, least, ranges, factor)
        if found >= least:
            factor = factor**0.5
            continue
        while found < least and not budget.spent:
            ahead = {r.name: _held(point[r.name] ** 2 / best[r.name], r) for r in ranges}
            best, least = point, found
            there = {**best, **ahead}
            point, found = _explore(budget, there, budget(there), ranges, factor)
        if found < least:
            best, least = point, found
    return best, least


def _explore(
    budget: _Budget, start: Point, at_start: float, ranges: Sequence[Range], factor: float
) -> tuple[dict[str, float], float]:
    """The best of changing one parameter after the other, and its cost."""
    best, least = dict(start), at_start
    for r in ranges:
        for change in (factor, 1.0 / factor):
            if budget.spent:
                return best, least
            tried = {**best, r.name: _held(best[r.name] * change, r)}
            found = budget(tried)
            if found < least:
                best, least = tried, found
                break
    return best, least


def _held(value: float, r: Range) -> float:
    return min(max(value, r.low), r.high)
