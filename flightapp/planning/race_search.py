"""From a line to begin with to one that keeps to its limits everywhere.

Limits are looked at in samples, between which a line may exceed them. So a line that was found is measured densely;
where it goes beyond a limit, that segment's limit is drawn in and the search goes on a little, on smoother lines every
time. What then is left of the excess, a line from rest to rest loses by being flown slower.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.planning.race_bounds import coefficients
from flightapp.planning.race_problem import AREA, CLEARANCE, CROSSING, KINDS, LEAST_FORCE, TILT, Problem, measure
from flightapp.planning.race_samples import DURATION, FINE
from flightapp.planning.race_solver import STEP, Parameters, improve
from flightapp.planning.race_work import Store, Work

TOLERATED = 1.0008
"""Ratio to a limit, densely sampled, that counts as keeping to it."""
NEAR = 2e-3
"""m, or of a cosine, that may be missing to clearance, floor and tilt."""
FIRST = Parameters(0.02, 12, 40, 0, 0.03, 0.1, 1e-2, 1.5, 0.1, 0.1, 2.0)
"""For a line from nothing."""
WARM = FIRST._replace(
    barrier=2e-4, enough=1, steps=25, gap=0.04, excess=2e-3, settled=0.5, shrink=0.5, damping=20.0, weight=5.0
)
"""For a line that was found for nearly the same: it is kept to closely, and rather moved than made faster."""
ELSE = FIRST._replace(barrier=0.1)
"""For a line from rest to rest for which that did not settle: from the same beginning, but further from the limits."""
ENOUGH = 1.2
"""Times the effort that was in vain that must be left for it."""
AGAIN = FIRST._replace(barrier=-1.0, enough=1, steps=10, gap=0.02, excess=2e-3, shrink=0.2, damping=20.0)
"""For a line that was found just now, with limits drawn in."""
ROUNDS = 9
"""Times that limits are drawn in."""
LEAST, MOST = 1e-3, 1.1
"""A limit is drawn in by the excess and this, but by no more than this ratio."""
FARTHEST = 0.05
"""m, or of a cosine, by which those are drawn in at most."""
CALMER = 1.5
"""The ratio by which smoothing grows every time."""
NEARLY = 1.005
"""A line from rest to rest that keeps to its limits when it is flown so many times slower is good enough."""
STRETCHES, HASTE = 16, 0.4
"""Times that a line is flown slower, and the growth of the exponent by which it is."""
FEW = 3
"""Times that are enough where flying slower helps at once: it does not where the thrust nearly vanishes."""
EFFORT = 9_500
"""Times segments, effort that the search for one plan may take, as `race_solver` counts it."""
CROWDED = 1.4
"""Times that effort among obstacles."""
LOOK, LOOK_AROUND = 0.35, 3.5
"""Effort to look at one segment's samples, and to look at its clearance densely."""
DRAGGED = 0.7
"""Share of an effort that counts where drag is planned for: it couples thrust with velocity, which takes more steps."""
PATIENCE, HOPELESS = 3, 3.0
"""After so many times, a line that begins in motion and exceeds a limit by more than this ratio is given up."""


class Search:
    """The search for one line, with as much effort as may be made."""

    def __init__(self, store: Store, effort: int = EFFORT) -> None:
        self.room = store.room
        self.effort = float(effort)
        """Times segments, effort that is left."""
        self.settled = True
        """Whether the last improvement ended before it had made all its steps."""

    def improve(self, line: Vector, problem: Problem, parameters: Parameters, work: Work) -> bool:
        """`race_solver.improve` with what is left; False if nothing is, or the arithmetic failed."""
        if self.effort < len(line) - 1:
            return False
        cost = self._cost(line, problem)
        taken = improve(line, problem, parameters._replace(effort=int(self.effort / cost)), work)
        self.effort -= abs(taken) * cost
        self.settled = abs(taken) < STEP * parameters.steps
        return taken > 0

    def _cost(self, line: Vector, problem: Problem) -> float:
        """Of a unit of effort per segment."""
        among = CROWDED if problem.active[CLEARANCE] else 1.0
        return among * (DRAGGED if problem.drag else 1.0) * (len(line) - 1)

    def look(self, line: Vector, problem: Problem, work: Work, fine: int = FINE) -> tuple[Vector, Vector]:
        """(n, KINDS) how close ``line`` is to its limits, and the same at samples alone, as of `measure`."""
        worst, sampled = np.empty((2, len(line) - 1, KINDS))
        measure(line, problem, fine, work.ends, work.samples, worst, sampled)
        self.effort -= (LOOK * fine + LOOK_AROUND * problem.active[CLEARANCE]) * (len(line) - 1)
        return worst, sampled

    def slow_down(self, line: Vector, problem: Problem, work: Work, times: int = STRETCHES, fine: int = FINE) -> Vector:
        """Fly ``line``, which starts and ends at rest, as slowly as its limits want at ``fine`` times the samples.

        Returns (n, KINDS) as of `measure`, but for the clearance: that stays what it was.
        """
        active = problem.active.copy()
        active[CLEARANCE] = 0.0
        timed = problem._replace(active=active)
        for attempt in range(times + 1):
            worst, _ = self.look(line, timed, work, fine)
            if attempt == times or not worst[:, :TILT].max() > TOLERATED:
                break
            stretch(line, slowdown(worst) ** (1.0 + HASTE * attempt))
        return worst

    def _in_place(self, problem: Problem, work: Work) -> bool:
        """Whether gates are crossed as they should be, or nearly so."""
        crossed = [work.c[:, place].max() for k, place in enumerate((AREA, CROSSING), 1) if problem.active[KINDS + k]]
        return not crossed or bool(max(crossed) <= NEAR)

    def run(
        self,
        line: Vector,
        problem: Problem,
        whole: Vector,
        limits: Vector,
        least: Vector,
        first: Parameters,
        work: Work,
    ) -> Vector:
        """Make ``line`` (n + 1, 13) as fast as it may be; (n, KINDS) how close it is to its limits, as of `measure`.

        ``whole`` (n, KINDS) are the limits of each segment as of `limits_of`, which ``problem`` has as well, and
        ``limits`` those to begin with; they are drawn in on return, but not beyond ``least`` (n, KINDS), which is 0
        where there is no such bound.
        What a line from rest to rest exceeds them by is left to flying it slower, if that costs little.
        """
        calm, held = problem.smooth, np.asarray(least.any(axis=1))
        at_rest = not (line[0, 3:DURATION].any() or line[-1, 3:DURATION].any())
        drawn, begun = problem._replace(limits=coefficients(limits)), line.copy()
        before = self.effort
        going = self.improve(line, drawn, first, work)
        if at_rest and not self.settled and self.effort > ENOUGH * (before - self.effort):
            line[:] = begun
            going = self.improve(line, drawn, ELSE, work)
        for count in range(ROUNDS + 1):
            worst, sampled = self.look(line, problem, work)
            ratio = worst[:, :TILT].max()
            clear = worst[:, TILT:].max() <= NEAR and self._in_place(problem, work)
            if not going or (clear and ratio <= TOLERATED):
                break
            if clear and at_rest and slowdown(worst) < NEARLY:
                slower = line.copy()
                eased = self.slow_down(slower, problem, work, FEW)
                if eased[:, :TILT].max() <= TOLERATED:
                    line[:], worst[:, :CLEARANCE] = slower, eased[:, :CLEARANCE]
                    break
            if count == ROUNDS or (count >= PATIENCE and not ratio < HOPELESS and held.any()):
                break
            _draw_in(limits, whole, worst, sampled, least, held)
            calm *= CALMER
            going = self.improve(line, problem._replace(limits=coefficients(limits), smooth=calm), AGAIN, work)
        return worst


def _draw_in(
    limits: Vector, whole: Vector, worst: Vector, sampled: Vector, least: Vector, held: NDArray[np.bool_]
) -> None:
    """Draw in ``limits`` (n, KINDS) that are exceeded, those of segments ``held`` (n,) no farther than ``least``.

    What is ``sampled`` of the ``whole`` limit has to become less in the ratio by which the ``worst`` is to.
    """
    over = worst[:, :LEAST_FORCE] > 1.0
    now, s, w = limits[:, :LEAST_FORCE][over], sampled[:, :LEAST_FORCE][over], worst[:, :LEAST_FORCE][over]
    aim = np.minimum(now, whole[:, :LEAST_FORCE][over] * s) / (w + LEAST)
    limits[:, :LEAST_FORCE][over] = np.maximum(np.maximum(aim, now / MOST), least[:, :LEAST_FORCE][over])
    over = worst[:, LEAST_FORCE] > 1.0
    now, s, w = limits[over, LEAST_FORCE], sampled[over, LEAST_FORCE], worst[over, LEAST_FORCE]
    aim = np.maximum(now, whole[over, LEAST_FORCE] / s) * (w + LEAST)
    limits[over, LEAST_FORCE] = np.minimum(aim, now * MOST)
    limits[held, LEAST_FORCE] = np.minimum(limits, least)[held, LEAST_FORCE]
    over = (worst[:, TILT:] > 0.0) & ~held[:, None]
    now, s, w = limits[:, TILT:][over], sampled[:, TILT:][over], worst[:, TILT:][over]
    aim = np.maximum(now, whole[:, TILT:][over] - s) + w + LEAST
    limits[:, TILT:][over] = np.minimum(aim, now + FARTHEST)


def slowdown(worst: Vector) -> float:
    """About how many times slower a line must be flown that exceeds its limits by ``worst``."""
    speed, acceleration, force, rate, least = worst[:, :TILT].max(axis=0).tolist()
    return float(max(1.0 + 1e-4, speed, math.sqrt(acceleration), force, rate ** (1.0 / 3.0), math.sqrt(least)))


def stretch(line: Vector, factor: float) -> None:
    """Fly a ``line`` that starts and ends at rest ``factor`` times slower."""
    line[:-1, DURATION] *= factor
    line[:, :DURATION] /= np.repeat(factor ** np.arange(4), 3)
