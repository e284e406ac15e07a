"""The polynomial planner: smooth, fast trajectories exactly through the centres of gates, or through waypoints.

Of all splines through the points the one with the least squared acceleration, jerk or snap is taken (D. Mellinger
and V. Kumar, 2011; C. Richter, A. Bry and N. Roy, 2016), in the least time that the limits and the vehicle allow. Its
first and last segment are bent so that acceleration and jerk at both ends are those that are asked for.
"""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.config import Config
from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import Limits, PlanningError, PlanRequest
from flightapp.planning.descent import search
from flightapp.planning.facing import Heading
from flightapp.planning.hermite import ACCELERATION, JERK, SNAP, Order
from flightapp.planning.optimal import EXCEEDED, FOUND, UNEVEN, optimise
from flightapp.planning.request import SAME_POINT, Route, check_request, gate_route, point_route
from flightapp.planning.spline import Spline, spline
from flightapp.trajectory import ORDER, Trajectory

ORDERS: dict[str, Order] = {"acceleration": ACCELERATION, "jerk": JERK, "snap": SNAP}
RAMP, LEAST_RAMP = 0.4, 0.25
"""s at the greatest speed: the way on which a route gathers speed, if it takes that long, and the least that is worth a
point of its own."""
REST = 0.2
"""s that a plan takes that stays where it is."""
LEAST_FORCE = 1e-3
"""m/s², below which there is no direction of thrust."""
ASKEW, REFUSED = math.cos(math.radians(35.0)), math.cos(math.radians(65.0))
"""Cosines of the angle to a gate's direction beyond which runs straight through it are tried, and of the greatest."""
RUN = (0.3, 1.5)
"""m, bounds of that run."""
SHARES = (0.4, 0.8, 0.2)
"""Of the shorter of the legs that meet in a gate, the runs that are tried in turn."""
ROUNDS = 6
"""Of plans with such runs, until none of the gates would be refused."""


@dataclass(frozen=True, slots=True, eq=False)
class _Last:
    """What is remembered of a plan, to begin the search for the next one with."""

    stamp: float
    points: Vector
    times: Vector


_NOTHING = _Last(0.0, np.empty((0, 3)), np.empty(0))


class PolynomialPlanner:
    """Plans through gates and waypoints, which it meets exactly.

    Besides the request's limits a plan keeps to shares of the vehicle's thrust and body rates. A plan from rest
    depends on its request alone; one in flight is sought from the times of the plan before, which it resembles.
    """

    def __init__(self, config: Config) -> None:
        planning = config.planning
        self._heading = Heading(config)
        self._order = ORDERS[planning.minimise]
        self._vehicle = (
            planning.thrust_share * config.vehicle.thrust_max,
            max(config.guard.thrust_min, LEAST_FORCE),
            planning.rate_share * config.vehicle.rate_max,
        )
        self._last = _NOTHING

    def plan(self, request: PlanRequest) -> Trajectory:
        """A trajectory through the gates of ``request``; raises `PlanningError`."""
        check_request(request)
        route = gate_route(request)
        trajectory, cosines = self._along(route, request)
        if cosines and min(cosines.values()) < ASKEW:
            trajectory, cosines = self._straighter(route, request, trajectory, cosines)
        if cosines and min(cosines.values()) < REFUSED:
            worst = min(cosines, key=lambda k: cosines[k])
            raise PlanningError(
                f"gate {request.gates[worst].gate_id} would be crossed at"
                f" {math.degrees(math.acos(cosines[worst])):.0f}° to its direction of passage: lead up to it with"
                " waypoints, or move its neighbours"
            )
        return trajectory

    def through(self, waypoints: Vector, request: PlanRequest) -> Trajectory:
        """A trajectory through ``waypoints`` (n, 3) m, heading along the path; raises `PlanningError`."""
        check_request(request)
        return self._along(point_route(waypoints, request), request)[0]

    def _with_ramps(self, route: Route, limits: Limits, ends: Vector) -> Route:
        """``route`` with a point where it has gathered speed, and one where it begins to slow down.

        Only on legs that are long enough, and beside ends without motion (``ends`` (2, 3, 3)) unless it is one leg.
        """
        v, lift = limits.v_max, math.sqrt(max(self._vehicle[0] ** 2 - GRAVITY**2, 0.0))
        shortest = v * v / max(min(limits.a_max, lift), LEAST_FORCE)
        way, least = max(shortest, RAMP * v), max(shortest, LEAST_RAMP * v)
        points, n, one = route.points, len(route.points), len(route.points) == 2
        away = points[1] - points[0], points[-2] - points[-1]
        thirds = [math.hypot(*leg.tolist()) / 3.0 for leg in away]
        first, last = (thirds[k] >= least and (one or not np.count_nonzero(ends[k])) for k in (0, 1))
        if not (first or last):
            return route
        rows, directions = np.zeros((2, n + first + last, 3))
        for old, new in ((0, 0), (slice(1, -1), slice(1 + first, n - 1 + first)), (-1, -1)):
            rows[new], directions[new] = points[old], route.directions[old]
        if first:
            rows[1] = points[0] + min(way / thirds[0], 1.0) / 3.0 * away[0]
        if last:
            rows[-2] = points[-1] + min(way / thirds[1], 1.0) / 3.0 * away[1]
        places = [k + (k > 0) * first + (k == n - 1) * last for k in route.gate_places]
        return Route(rows, directions, tuple(places))

    def _straighter(
        self, route: Route, request: PlanRequest, trajectory: Trajectory, cosines: dict[int, float]
    ) -> tuple[Trajectory, dict[int, float]]:
        """The best of ``trajectory`` and ones that are led straight through the gates crossed askew.

        Runs through some gates may bend the way through others: these get theirs in turn, and one that is still
        crossed askew a longer or shorter one.
        """
        best, runs = (trajectory, cosines), dict.fromkeys(_askew(route, cosines), 0)
        for _ in range(ROUNDS):
            try:
                trajectory, cosines = self._along(_with_runs(route, runs), request)
            except PlanningError:
                break
            if min(cosines.values()) > min(best[1].values()):
                best = trajectory, cosines
            askew = _askew(route, cosines)
            if not askew or min(cosines.values()) >= REFUSED:
                break
            for place in askew:
                runs[place] = (runs[place] + 1) % len(SHARES) if place in runs else 0
        return best

    def _along(self, route: Route, request: PlanRequest) -> tuple[Trajectory, dict[int, float]]:
        """The trajectory, and the cosines of the angles at which it crosses gates, by their index."""
        start, ends = request.start, np.zeros((2, 3, 3))
        ends[0, 0], ends[0, 1], ends[0, 2] = start.velocity, start.acceleration, start.jerk
        if request.arrival is not None:
            ends[1] = request.arrival
        route = self._with_ramps(route, request.limits, ends)
        n = len(route.points) - 1
        knots, coefficients = np.empty(n + 3), np.empty((n + 2, 3, ORDER))
        cosines: dict[int, float] = {}
        moving = bool(np.count_nonzero(ends))
        if n == 1 and not moving and math.dist(route.points[0], route.points[1]) < SAME_POINT:
            knots[:] = 0.0, 0.25 * REST, 0.75 * REST, REST
            coefficients[:] = 0.0
            coefficients[:, :, 0] = route.points[0]
        else:
            s = spline(route.points, ends)
            self._optimise(s, request, moving, knots, coefficients)
            cosines = _cosines(s, route)
        passages = [float(knots[place + (place > 0) + (place == n)]) for place in route.gate_places]
        return self._heading.complete(knots, coefficients, passages, request), cosines

    def _optimise(self, s: Spline, request: PlanRequest, moving: bool, knots: Vector, coefficients: Vector) -> None:
        limits = np.empty((4, 5))
        limits[0] = request.limits.v_max, request.limits.a_max, *self._vehicle
        if limits[0, 2] <= GRAVITY:
            raise PlanningError(
                f"the thrust that plans may use, {limits[0, 2]:.2f} m/s², does not lift the vehicle: raise"
                " planning.thrust_share or vehicle.thrust_to_weight"
            )
        outcome = EXCEEDED
        for last in (self._last, _NOTHING) if moving and self._last.times.size else (_NOTHING,):
            memory = (last.points, last.times, request.stamp - last.stamp)
            outcome = optimise(self._order, s, search(s.times.size), limits, memory, moving, knots, coefficients)
            if outcome == FOUND:
                break
        if outcome != FOUND:
            raise PlanningError(_refusal(outcome, limits[3], request.limits, self._vehicle))
        self._last = _Last(request.stamp, s.points, s.times)


def _refusal(outcome: int, ratios: Vector, limits: Limits, vehicle: tuple[float, float, float]) -> str:
    """Why there is no plan; ``ratios`` (5,) are those of the best one to the limits."""
    if outcome == UNEVEN:
        return "the route is too uneven for the arithmetic: no finite trajectory was found; space its points evenly"
    bounds = (limits.v_max, limits.a_max, *vehicle)
    names = (
        "m/s of v_max",
        "m/s² of a_max",
        "m/s² of the greatest thrust",
        "m/s² of the least thrust",
        "rad/s of the body rate",
    )
    over = [
        f"{bound / ratio if k == 3 else bound * ratio:.2f} {name} = {bound:.4g}"
        for k, (ratio, bound, name) in enumerate(zip(ratios.tolist(), bounds, names, strict=True))
        if ratio > 1.0
    ]
    return f"no plan with this motion at its ends keeps to the limits: the best has {', '.join(over)}"


def _cosines(s: Spline, route: Route) -> dict[int, float]:
    """Cosines of the angles between the velocity in gates and their directions, by the gate's index."""
    cosines = {}
    for k, place in enumerate(route.gate_places):
        velocity, direction = s.derivatives[place, 0].tolist(), route.directions[place].tolist()
        if place > 0 and any(direction):
            along = sum(v * d for v, d in zip(velocity, direction, strict=True))
            cosines[k] = max(along / max(math.hypot(*velocity), 1e-9), -1.0)
    return cosines


def _askew(route: Route, cosines: dict[int, float]) -> list[int]:
    """Places in ``route`` of the gates that are crossed askew."""
    return [route.gate_places[k] for k, cosine in cosines.items() if cosine < ASKEW]


def _with_runs(route: Route, runs: dict[int, int]) -> Route:
    """``route`` with a point before and one behind each of the gates at the places of ``runs``, by its `SHARES`."""
    points, directions, where, plain = [], [], [], np.zeros(3)
    legs = np.linalg.norm(np.diff(route.points, axis=0), axis=1)
    for place, (point, direction) in enumerate(zip(route.points, route.directions, strict=True)):
        if place in runs:
            share = SHARES[runs[place]]
            run = min(max(share * min(legs[place - 1], legs[place]), RUN[0]), RUN[1]) * direction
            points += [point - run, point, point + run]
            directions += [plain, direction, plain]
            where.append(len(points) - 2)
        else:
            points.append(point)
            directions.append(direction)
            where.append(len(points) - 1)
    return Route(np.array(points), np.array(directions), tuple(where[place] for place in route.gate_places))
