"""Time-optimal flights by direct multiple shooting.

Each leg between two areas has its own free duration (after P. Foehn, A. Romero and D. Scaramuzza, "Time-optimal
planning for quadrotor waypoint flight", Science Robotics 2021, with the areas' places in the grid fixed). The
nodes of a leg lie closer at its ends, where a slow vehicle turns. Whether a quadrotor is flown whose thrust and rates
change at once, or one with four rotors, is up to the `Model`.
"""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import PlanningError
from flightapp.planning.time_optimal_model import (
    UNIT,
    Model,
    arrival,
    input_range,
    interval,
    limits_at,
    passages,
)
from flightapp.planning.time_optimal_problem import Problem, casadi, state_of

EVENNESS = 0.4
"""Share of even spacing in the spacing of the nodes; the rest is a cosine's."""
RESTLESSNESS = {Model.THRUST_AND_RATES: (1e-4, 1e-3, 1e-2), Model.FULL: (3e-3, 1e-2, 1e-1)}
"""s, weight of the mean squared rates, or of the inputs of `FULL`, which decides what the duration leaves open.

The others are for when the solver does not settle with the first.
"""
LONGEST_LEG = 1000.0
"""s."""
CRUISE = 6.0
"""m/s at most, speed of the flight that the search starts from."""
OPTIONS = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    "ipopt.max_iter": 150,
    "ipopt.tol": 1e-5,
    "ipopt.constr_viol_tol": 1e-9,
}
BARRIER = 0.1, 1e-4
"""First weight of the solver's barrier: from a straight line, and from a flight."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A flight at its k nodes."""

    legs: Vector
    """(m + 1,) s, duration of each leg."""
    states: Vector
    """(k, 13) position, velocity, attitude q_wb, rates of roll and pitch (rad/s), collective specific force (m/s²)."""
    inputs: Vector
    """(k, 3) m/s³ and rad/s², changes of the specific force and of both rates."""

    @property
    def nodes(self) -> int:
        """Intervals a leg."""
        return (len(self.states) - 1) // len(self.legs)

    @property
    def times(self) -> Vector:
        """(k,) s since the start."""
        return leg_times(self.legs, self.nodes)

    @property
    def duration(self) -> float:
        """s."""
        return float(self.legs.sum())


class Shooter:
    """Flies one problem; its bounds may be tightened from flight to flight."""

    def __init__(self, problem: Problem, model: Model, nodes: int) -> None:
        ca = casadi()
        self._problem, self._model, self._nodes = problem, model, nodes
        legs = len(problem.centres) + 1
        count = legs * nodes
        X = ca.MX.sym("X", model.value, count + 1)
        U, T = ca.MX.sym("U", 3, count + 1), ca.MX.sym("T", legs)
        bounds, weight = ca.MX.sym("bounds", 7, count), ca.MX.sym("weight")
        steps = ca.reshape(ca.DM(np.diff(leg_grid(nodes))) @ T.T, 1, count)
        intervals = interval(ca, problem, model).map(count)
        gaps, limits = intervals(X[:, :-1], X[:, 1:], U[:, :-1], U[:, 1:], steps, bounds)
        ends = [*passages(ca, problem, X, nodes), *arrival(ca, problem, X, model)]
        last = limits_at(ca, problem, model, X[:, -1], U[:, -1], bounds[:, -1])
        limits = ca.vertcat(ca.vec(limits), *last)
        self._ranges = [(0.0, 0.0, gaps.numel()), (-math.inf, 0.0, limits.numel())]
        self._ranges += [(low, high, expression.numel()) for expression, low, high in ends]
        restless = weight * ca.sumsqr(U if model is Model.FULL else U[1:, :]) / count
        self._solver = ca.nlpsol(
            "flight",
            "ipopt",
            {
                "x": ca.vertcat(ca.vec(X), ca.vec(U), T),
                "p": ca.vertcat(ca.vec(bounds), weight),
                "f": ca.sum1(T) + restless,
                "g": ca.vertcat(ca.vec(gaps), limits, *(expression for expression, _, _ in ends)),
            },
            {**OPTIONS, "ipopt.mu_init": BARRIER[model is Model.FULL]},
        )

    def fly(self, bounds: Vector, guess: Flight | None = None) -> Flight:
        """The fastest flight near ``guess``; raises `PlanningError`.

        In each interval it keeps to its ``bounds`` (n, 7), as `Bounds.row` has them, and everywhere to the problem's.
        """
        guess = guess or straight(self._problem, self._nodes)
        low, high = self._box(len(guess.states), len(guess.legs))
        for weight in RESTLESSNESS[self._model]:
            found = self._solver(
                x0=self._unknowns(guess),
                p=np.append(np.where(np.isfinite(bounds), bounds, 1.0).ravel(), weight),
                lbx=low,
                ubx=high,
                lbg=np.concatenate([np.full(count, least) for least, _, count in self._ranges]),
                ubg=np.concatenate([np.full(count, most) for _, most, count in self._ranges]),
            )
            status = self._solver.stats()
            if status["success"]:
                return self._flight(np.array(found["x"]).ravel(), len(guess.legs))
        raise PlanningError(f"no time-optimal flight was found: the solver says {status['return_status']}")

    def _box(self, count: int, legs: int) -> tuple[Vector, Vector]:
        """Least and greatest values of the unknowns; the start is given, and where and how fast to arrive."""
        problem, bounds, size = self._problem, self._problem.bounds, self._model.value
        high = np.full((count, size), math.inf)
        low = -high
        low[:, 2] = problem.floor
        start, end = state_of(problem.start), state_of(problem.end)
        low[0] = high[0] = start[:size]
        low[-1, :6] = high[-1, :6] = end[:6]
        if self._model is Model.FULL:
            low[1:, 10:12], high[1:, 10:12] = -bounds.rate, bounds.rate
            low[1:-1, 12], high[1:-1, 12] = bounds.force_min, bounds.force_max
            low[-1, 12] = high[-1, 12] = end[12]
        inputs_low, inputs = (np.tile(row, (count, 1)) for row in input_range(problem, self._model))
        if self._model is Model.FULL:
            inputs_low[[0, -1], 0] = inputs[[0, -1], 0] = [start[13] / UNIT, end[13] / UNIT]
        lowest = np.concatenate((low.ravel(), inputs_low.ravel(), np.full(legs, 1e-3)))
        return lowest, np.concatenate((high.ravel(), inputs.ravel(), np.full(legs, LONGEST_LEG)))

    def _unknowns(self, flight: Flight) -> Vector:
        if self._model is Model.FULL:
            states, inputs = flight.states, flight.inputs / UNIT
        else:
            states, inputs = flight.states[:, :10], flight.states[:, [12, 10, 11]]
        return np.concatenate((states.ravel(), inputs.ravel(), flight.legs))

    def _flight(self, unknowns: Vector, legs: int) -> Flight:
        count, size = legs * self._nodes + 1, self._model.value
        states = unknowns[: size * count].reshape(count, size)
        inputs = unknowns[size * count : -legs].reshape(count, 3)
        if self._model is Model.FULL:
            return Flight(unknowns[-legs:], states, inputs * UNIT)
        changes = np.asarray(np.gradient(inputs, leg_times(unknowns[-legs:], self._nodes), axis=0))
        return Flight(unknowns[-legs:], np.column_stack((states, inputs[:, 1:], inputs[:, 0])), changes)


def leg_grid(nodes: int) -> Vector:
    """(nodes + 1,) places of a leg's nodes, from 0 to 1."""
    even = np.linspace(0.0, 1.0, nodes + 1)
    grid: Vector = EVENNESS * even + (1.0 - EVENNESS) * 0.5 * (1.0 - np.cos(math.pi * even))
    return grid


def leg_times(legs: Vector, nodes: int) -> Vector:
    """(k,) s since the start, of all nodes of ``legs`` (m + 1,) s."""
    return np.concatenate(([0.0], np.cumsum(np.outer(legs, np.diff(leg_grid(nodes))).ravel())))


def straight(problem: Problem, nodes: int) -> Flight:
    """Straight from centre to centre, level, at a steady speed: not a flight, but a start for the search."""
    ways = np.diff(problem.places, axis=0)
    speed = min(0.7 * problem.bounds.v_max, CRUISE)
    durations = np.maximum(np.linalg.norm(ways, axis=1) / speed, 0.1)
    count = len(durations) * nodes + 1
    states = np.zeros((count, 13))
    states[:, 6], states[:, 12] = 1.0, GRAVITY
    for i, (place, way, duration) in enumerate(zip(problem.places, ways, durations, strict=False)):
        rows = slice(i * nodes, (i + 1) * nodes + 1)
        states[rows, :3], states[rows, 3:6] = place + leg_grid(nodes)[:, None] * way, way / duration
    return Flight(durations, states, np.zeros((count, 3)))
