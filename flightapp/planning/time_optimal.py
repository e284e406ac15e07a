"""The time-optimal planner, for use before a flight: it takes seconds to minutes.

Every rotor, the collective thrust, body rates, speed and acceleration keep to their limits; gates are areas. The
flight of a simpler model is found first, by multiple shooting from a straight line; the full model's follows from it
and becomes a spline of degree 7 with a continuous jerk. What the spline exceeds between its knots, by dense
samples, is taken off the bounds until nothing is left. The solver, IPOPT, comes with casadi, which is an extra.
"""

from dataclasses import dataclass

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import PlanningError, PlanRequest
from flightapp.planning.clearance import touched
from flightapp.planning.facing import Heading
from flightapp.planning.obstacles import Margins
from flightapp.planning.race_bounds import gate_radius
from flightapp.planning.request import Route, check_request, gate_route, point_route
from flightapp.planning.time_optimal_model import Model
from flightapp.planning.time_optimal_problem import GREATEST, Problem, as_problem
from flightapp.planning.time_optimal_shooting import Flight, Shooter
from flightapp.planning.time_optimal_spline import peaks_of, spline
from flightapp.trajectory import Trajectory

NODES, FEWEST, MOST = 96, 8, 24
"""Intervals of a flight about, and of a leg at least and at most."""
TOLERATED = 1e-3
"""Share of a limit by which it may be exceeded."""
ROUNDS = 10
"""Flights at most, each with tighter bounds than the last."""
AMPLE = 1.3
"""Times what an interval exceeds a bound by, which is taken off it."""
STILL = 1e-3
"""m, shorter than which there is nothing to fly."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeOptimalPlan:
    """A plan and what it is measured by."""

    trajectory: Trajectory
    """It keeps to all limits, those of single rotors included."""
    yardstick: Flight
    """The fastest flight of a quadrotor whose rotors change their thrust at once: no plan is faster."""
    flight: Flight
    """The full model's, which the trajectory follows."""


class OptimalPlanner:
    """Finds time-optimal plans: through gates that have a shape anywhere within their openings, else their centres.

    Waypoints are passed within `planning.waypoint_radius`. Obstacles are not gone around: a plan that would touch one
    is refused.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._heading = Heading(config)

    def plan(self, request: PlanRequest) -> Trajectory:
        """A trajectory through the gates of ``request``; raises `PlanningError`."""
        return self.solve(request).trajectory

    def through(self, waypoints: Vector, request: PlanRequest) -> Trajectory:
        """A trajectory through ``waypoints`` (n, 3) m, heading along the path; raises `PlanningError`."""
        return self.solve(request, waypoints).trajectory

    def solve(self, request: PlanRequest, waypoints: Vector | None = None) -> TimeOptimalPlan:
        """The plan through the gates of ``request``, or through ``waypoints`` (n, 3) m, and what it is measured by.

        Raises `PlanningError`.
        """
        problem, route = self._problem(request, waypoints)
        yardstick = _yardstick(problem)
        trajectory, flight = self._within(problem, route, yardstick, request)
        gates = request.gates if route.gate_places else ()
        touch = touched(trajectory, gates, request.shape, request.obstacles, Margins.of(self._config))
        if touch is not None:
            raise PlanningError(f"the time-optimal plan {touch}, and this planner goes around nothing: use 'race'")
        return TimeOptimalPlan(trajectory, yardstick, flight)

    def yardstick(self, request: PlanRequest, waypoints: Vector | None = None) -> Flight:
        """What `solve` would measure its plan by, in a fraction of the time; raises `PlanningError`."""
        problem, _ = self._problem(request, waypoints)
        return _yardstick(problem)

    def _problem(self, request: PlanRequest, waypoints: Vector | None) -> tuple[Problem, Route]:
        check_request(request)
        if waypoints is None:
            route = gate_route(request)
            radii = np.zeros(len(route.points))
            for gate, place in zip(request.gates, route.gate_places, strict=True):
                radii[place] = gate_radius(gate, request.shape, self._config)
        else:
            route = point_route(waypoints, request)
            radii = np.full(len(route.points), self._config.planning.waypoint_radius)
        if np.ptp(route.points, axis=0).max() < STILL:
            raise PlanningError("there is nothing to fly: start, gates and end are at the same point")
        return as_problem(route, radii, request, self._config), route

    def _within(
        self, problem: Problem, route: Route, flight: Flight, request: PlanRequest
    ) -> tuple[Trajectory, Flight]:
        """The trajectory of the full model near ``flight``, and its flight."""
        shooter, bounds = Shooter(problem, Model.FULL, flight.nodes), problem.bounds.row()
        tight = np.tile(bounds, (len(flight.times) - 1, 1))
        units = np.append(bounds[:GREATEST], bounds[3:GREATEST])
        worst = 0.0
        for _ in range(ROUNDS):
            flight = shooter.fly(tight, flight)
            coefficients = spline(problem, flight)
            peaks = peaks_of(flight.times, coefficients, problem.airframe)
            excess = np.maximum(peaks - bounds, 0.0)
            excess[:, GREATEST:] = np.maximum(bounds - peaks, 0.0)[:, GREATEST:]
            worst = float((excess / units).max())
            if worst <= TOLERATED:
                ends = np.concatenate(([0.0], np.cumsum(flight.legs)))
                passages = [float(ends[place]) for place in route.gate_places]
                return self._heading.complete(flight.times, coefficients, passages, request), flight
            excess[1:] = np.maximum(excess[1:], excess[:-1])  # the end of an interval is the start of the next
            tight[:, :GREATEST] -= AMPLE * excess[:, :GREATEST]
            tight[:, GREATEST:] += AMPLE * excess[:, GREATEST:]
        raise PlanningError(f"no time-optimal plan keeps to the limits: the best exceeds one by {100.0 * worst:.1f} %")


def _yardstick(problem: Problem) -> Flight:
    nodes = min(max(round(NODES / (len(problem.centres) + 1)), FEWEST), MOST)
    return Shooter(problem, Model.THRUST_AND_RATES, nodes).fly(
        np.tile(problem.bounds.row(), (nodes * (len(problem.centres) + 1), 1))
    )
