"""The polynomial planner: smooth, fast trajectories through gates or waypoints.

All plans are splines of degree 7 with continuous position, velocity, acceleration and jerk, among which the
one with the least squared acceleration, jerk or snap is taken (D. Mellinger and V. Kumar, 2011; C. Richter,
A. Bry and N. Roy, 2016), in the least time that the limits allow. They start with any motion, so that a plan
made in flight takes over without a step, and end at rest.
"""

import math

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import PlanningError, PlanRequest
from flightapp.planning.heading import heading_pieces
from flightapp.planning.hermite import polynomial_coefficients
from flightapp.planning.optimal import Spline, optimise, peaks
from flightapp.planning.request import Route, check_request, gate_route, point_route
from flightapp.trajectory import ORDER, Trajectory

ORDERS = {"acceleration": 2, "jerk": 3, "snap": 4}
SPEED_EXCESS, ACCELERATION_EXCESS = 1.1, 1.25
"""Ratios to the limits up to which a plan from a start that does not admit a better one is returned."""
FLOOR_BELOW = 0.3
"""m that a plan may sag below its lowest point."""
REST = 0.2
"""s that a plan takes that stays where it is."""


class PolynomialPlanner:
    """Plans through gates with free knots between them, and through waypoints without.

    Gates are crossed at their centres, within `planning.crossing_deg` of the direction of passage where that
    can be flown. Besides the request's limits a plan keeps (softly) to shares of the vehicle's thrust and
    body rates.
    """

    def __init__(self, config: Config) -> None:
        self._planning = config.planning
        self._order = ORDERS[config.planning.minimise]
        self._force = config.planning.thrust_share * config.vehicle.thrust_max
        self._rate = config.planning.rate_share * config.vehicle.rate_max

    def plan(self, request: PlanRequest) -> Trajectory:
        """A trajectory through the gates of ``request``; raises `PlanningError`."""
        check_request(request)
        return self._along(gate_route(request), request, self._planning.free_knots)

    def through(self, waypoints: Vector, request: PlanRequest) -> Trajectory:
        """A trajectory through ``waypoints`` (n, 3) m, heading along the path; raises `PlanningError`."""
        check_request(request)
        route = point_route(waypoints, request)
        return self._along(route, request, self._planning.free_knots if len(route.points) == 2 else 0)

    def _along(self, route: Route, request: PlanRequest, knots: int) -> Trajectory:
        start = request.start
        motion = np.array([start.velocity, start.acceleration, start.jerk], float)
        if len(route.points) == 2 and not motion.any() and np.ptp(route.points, axis=0).max() < 1e-3:
            times, coefficients, anchors = np.array([REST]), np.zeros((1, 3, ORDER)), np.arange(2)
            coefficients[0, :, 0] = route.points[0]
        else:
            limits = self._limits(route, motion, request)
            spline = optimise(route.points, route.directions, motion, limits, self._order, knots)
            _judge(spline, request)
            times, anchors = spline.times, spline.anchors
            coefficients = polynomial_coefficients(spline.times, spline.points, spline.derivatives)
        if not (np.all(np.isfinite(times)) and np.all(np.isfinite(coefficients))):
            raise PlanningError("the route is too uneven for the arithmetic: no finite trajectory was found")
        places = np.concatenate(([0.0], np.cumsum(times)))
        passages = [float(places[anchors[place]]) for place in route.gate_places]
        return self._facing(places, coefficients, passages, request)

    def _limits(self, route: Route, motion: Vector, request: PlanRequest) -> Vector:
        """(6,) for `objective`; a start at its limit does not count as exceeding it."""
        return np.array(
            [
                max(request.limits.v_max, float(np.linalg.norm(motion[0]))),
                max(request.limits.a_max, float(np.linalg.norm(motion[1]))),
                self._force,
                self._rate,
                float(route.points[:, 2].min()) - FLOOR_BELOW,
                math.cos(math.radians(self._planning.crossing_deg)),
            ]
        )

    def _facing(self, places: Vector, coefficients: Vector, passages: list[float], request: PlanRequest) -> Trajectory:
        gates = request.gates if passages else ()
        aims = np.array([gate.position for gate in gates], float).reshape(-1, 3)
        watch = np.full(3, np.nan) if request.look_at is None else np.array(request.look_at, float)
        yaw_knots, yaw_coefficients, used = heading_pieces(
            places,
            coefficients,
            float(request.start.yaw),
            float(request.start.yaw_rate),
            aims,
            np.array(passages),
            watch,
            float(request.limits.yaw_rate_max),
            self._planning.yaw_acceleration,
        )
        ids = tuple(gate.gate_id for gate in gates)
        return Trajectory(
            request.stamp, places, coefficients, yaw_knots[: used + 1], yaw_coefficients[:used], ids, tuple(passages)
        )


def _judge(spline: Spline, request: PlanRequest) -> None:
    """Refuse a plan that exceeds the limits by more than can be put up with."""
    peak = peaks(spline.times, spline.points, spline.derivatives)
    speed, acceleration = peak[0] / request.limits.v_max, peak[1] / request.limits.a_max
    if not (speed <= SPEED_EXCESS and acceleration <= ACCELERATION_EXCESS):
        raise PlanningError(
            f"no plan from this start keeps to the limits: the best reaches {peak[0]:.2f} m/s of"
            f" {request.limits.v_max:g} and {peak[1]:.2f} m/s² of {request.limits.a_max:g}"
        )
