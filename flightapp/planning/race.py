"""The race planner: the fastest line through gates that have room, for what the vehicle can do.

Gates are areas, crossed within an angle of their direction of passage; between them the line is free. Speed,
acceleration, collective thrust, body rates, tilt, height and clearance are kept to. The line is a spline of degree 7
whose knots and durations are the variables; the duration is minimised by an interior-point method (`race_solver`). It
takes some milliseconds, and less for a plan that continues the one before. From rest, where that search fails, the line
stops at the corners of a way that is clear (`race_halting`).
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from flightapp.config import Config
from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import PlanningError, PlanRequest
from flightapp.planning.corridor import Places, Solids, detour
from flightapp.planning.facing import Heading
from flightapp.planning.obstacles import Margins
from flightapp.planning.race_bounds import (
    Targets,
    Vehicle,
    as_problem,
    beginning,
    gate_radius,
    leaving,
    limits_of,
)
from flightapp.planning.race_halting import RUNS, halting
from flightapp.planning.race_memory import Memory, continued
from flightapp.planning.race_problem import (
    AREA,
    CLEARANCE,
    CROSSING,
    FLOOR,
    KINDS,
    LEAST_FORCE,
    TILT,
    Problem,
    evaluate,
)
from flightapp.planning.race_samples import DURATION, polynomials
from flightapp.planning.race_search import FIRST, TOLERATED, WARM, Search
from flightapp.planning.race_smooth import smoothen
from flightapp.planning.race_solver import Parameters
from flightapp.planning.race_start import Layout, lay_out
from flightapp.planning.race_work import Store, Work
from flightapp.planning.request import SAME_POINT, Route, check_request, gate_route, point_route
from flightapp.trajectory import ORDER, Trajectory

REST = 0.2
"""s that a plan takes that stays where it is."""
SLOWER = (1.0, 1.7)
"""Times the time guessed that lines are begun with, in turn until one succeeds."""
EXCEEDED = 1.001
"""Ratio to a limit, densely sampled, up to which a plan is returned."""
MISSING = 0.006
"""m that may be missing to clearance and floor where it is looked at, or of a cosine to the greatest tilt."""
OUTSIDE = 0.02
"""Of dᵀ A d, how far outside a gate's area a plan may cross."""
UNEVEN = "the route is too uneven for the arithmetic: no finite trajectory was found; space its points evenly"
ASTRAY = (
    "no race line with this motion at its start was found but ones that go astray: start it slower, or farther away"
)
STOP = 50.0
"""Effort per point of a way past obstacles that is kept for lines which stop at each."""
LATE, GRACE = 1.5, 2.0
"""A line that starts in motion is astray if it takes so many times the least that one was begun with, and so many s."""
LIMITS = (
    "m/s of v_max",
    "m/s² of a_max",
    "m/s² of the greatest thrust",
    "rad/s of the body rate",
    "m/s² of the least thrust",
)
ASKEW = 0.05
"""Of the cosine of the angle to a gate's direction of passage, what may be missing."""


class RacePlanner:
    """Plans race lines: through gates that have a shape anywhere within their openings, else through their centres.

    Waypoints are passed within `planning.waypoint_radius`. A plan from rest depends on its request alone; the search
    for one in flight begins with what is left of the plan before.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._margins = Margins.of(config)
        self._heading = Heading(config)
        self._vehicle = Vehicle.of(config)
        self._memory: Memory | None = None
        self._store = Store()

    def plan(self, request: PlanRequest) -> Trajectory:
        """A trajectory through the gates of ``request``; raises `PlanningError`."""
        check_request(request)
        route = gate_route(request)
        radii = np.zeros(len(route.points))
        for gate, place in zip(request.gates, route.gate_places, strict=True):
            radii[place] = gate_radius(gate, request.shape, self._config)
        return self._along(route, radii, request)

    def through(self, waypoints: Vector, request: PlanRequest) -> Trajectory:
        """A trajectory through ``waypoints`` (n, 3) m, heading along the path; raises `PlanningError`."""
        check_request(request)
        route = point_route(waypoints, request)
        return self._along(route, np.full(len(route.points), self._config.planning.waypoint_radius), request)

    def _along(self, route: Route, radii: Vector, request: PlanRequest) -> Trajectory:
        ends = np.zeros((2, 3, 3))
        ends[0] = request.start.velocity, request.start.acceleration, request.start.jerk
        if request.arrival is not None:
            ends[1] = request.arrival
        at_rest = not ends.any()
        if len(route.points) == 2 and at_rest and math.dist(*route.points) < SAME_POINT:
            return self._stay(route, request)
        if self._vehicle.force <= GRAVITY:
            raise PlanningError(
                f"the thrust that plans may use, {self._vehicle.force:.2f} m/s², does not lift the vehicle: raise"
                " planning.thrust_share or vehicle.thrust_to_weight"
            )
        targets = Targets(route.points, route.directions, radii)
        solids = Solids.of(request, self._margins)
        limits = limits_of(self._vehicle, request, targets)
        rows = leaving(solids.rows, route.points)
        why, begun, search = "", math.inf, Search(self._store)
        for layout, parameters in self._layouts(route, solids, request, ends, search):
            first = beginning(layout.line, at_rest)
            limits[:, FLOOR] = np.minimum(limits[:, FLOOR], layout.lowest)
            problem = as_problem(limits, first, targets, layout, rows, self._vehicle)
            begun = min(begun, float(layout.line[:-1, DURATION].sum()))
            why, drawn, work = _found(layout, problem, limits, first, parameters, search)
            if not (why or at_rest) and layout.line[:-1, DURATION].sum() > LATE * begun + GRACE:
                why = ASTRAY
            if not why:
                if parameters is None or len(route.points) != len(request.gates) + 2:
                    self._memory = None
                else:
                    self._memory = Memory(request, layout, drawn, np.array((work.slack, work.dual)))
                return self._complete(layout, route, request)
        raise PlanningError(why)

    def _layouts(
        self, route: Route, solids: Solids, request: PlanRequest, ends: Vector, search: Search
    ) -> Iterator[tuple[Layout, Parameters | None]]:
        """Lines to begin with, the most promising first, and how to search; None for one that is to be flown as is."""
        if self._memory is not None and ends[0].any() and len(route.points) == len(request.gates) + 2:
            layout = continued(self._memory, request, route.points, route.directions, ends)
            if layout is not None:
                yield layout, WARM
        way = detour(Places.of(route, request), solids)
        moving = bool(ends.any())
        kept = STOP * len(way.points) if len(solids.rows) and not moving else 0.0
        search.effort -= way.effort + kept
        lowest, directions = float(way.points[:, 2].min()), np.zeros_like(way.points)
        directions[~way.inserted] = route.directions
        for slower in SLOWER:
            if search.effort <= 0.0 and not moving:
                break  # a line that stops is found at once
            layout = lay_out(way.points, directions, ends, request.limits.v_max, slower)
            yield replace(layout, anchors=layout.anchors[~way.inserted], lowest=lowest), FIRST
        search.effort += kept
        for straight in () if moving else RUNS:
            layout = halting(way, directions, self._vehicle, request.limits, straight)
            yield replace(layout, lowest=lowest), None

    def _complete(self, layout: Layout, route: Route, request: PlanRequest) -> Trajectory:
        line, places = layout.line, layout.anchors[list(route.gate_places)]
        times = np.concatenate(([0.0], np.cumsum(line[:-1, DURATION])))
        return self._heading.complete(times, polynomials(line), times[places].tolist(), request)

    def _stay(self, route: Route, request: PlanRequest) -> Trajectory:
        still = np.zeros((1, 3, ORDER))
        still[0, :, 0] = route.points[0]
        return self._heading.complete(np.array([0.0, REST]), still, [0.0] * len(route.gate_places), request)


def _found(
    layout: Layout, problem: Problem, limits: Vector, first: Vector, parameters: Parameters | None, search: Search
) -> tuple[str, Vector, Work]:
    """Search from ``layout``, in place, if there are ``parameters``.

    Returns why there is no plan, empty if there is one, the shares of the limits that it keeps to at samples, and what
    the search has worked with.
    """
    line, work = layout.line, search.room(len(layout.line) - 1)
    if layout.duals is not None and parameters is not None:
        work.slack[:], work.dual[:] = layout.duals
        parameters = parameters._replace(barrier=-1.0)
    at_rest = not (line[0, 3:DURATION].any() or line[-1, 3:DURATION].any())
    base = np.where(first[:, None] != 0.0, limits[1], limits[0])
    drawn = np.where(first[:, None] != 0.0, base, base * layout.drawn)
    if layout.smooth < len(line) - 2:
        if not smoothen(line, layout.smooth):
            return UNEVEN, drawn, work
        if at_rest:
            search.slow_down(line, problem, work, fine=1)
    least = np.where(first[:, None] != 0.0, limits[2], 0.0)
    if parameters is not None:
        worst = search.run(line, problem, base, drawn, least, parameters, work)
    else:
        worst, _ = search.look(line, problem, work)
    if at_rest and worst[:, :TILT].max() > TOLERATED:
        worst[:, :CLEARANCE] = search.slow_down(line, problem, work)[:, :CLEARANCE]
    if not (np.isfinite(line).all() and np.isfinite(worst).all()):
        return UNEVEN, drawn, work
    shares = np.ones_like(drawn)
    np.divide(drawn, base, out=shares, where=np.isfinite(base) & (base != 0.0))
    return _beyond_limits(worst.max(axis=0), limits[0]) or _out_of_place(line, problem, layout, work), shares, work


def _beyond_limits(worst: Vector, limits: Vector) -> str:
    over = [
        f"{limit / ratio if kind == LEAST_FORCE else limit * ratio:.2f} {LIMITS[kind]} = {limit:.4g}"
        for kind, (ratio, limit) in enumerate(zip(worst[:TILT].tolist(), limits[:TILT].tolist(), strict=True))
        if ratio > EXCEEDED
    ]
    if worst[TILT] > MISSING:
        over.append("more tilt than planning.tilt_max_deg")
    if worst[FLOOR] > MISSING:
        over.append(f"{worst[FLOOR]:.2f} m less than its least height, {limits[FLOOR]:.2f} m")
    if worst[CLEARANCE] > MISSING:
        over.append(f"{worst[CLEARANCE]:.2f} m less than the clearance from an obstacle")
    if not over:
        return ""
    return f"no race line with this motion at its ends was found: the best has {', '.join(over)}"


def _out_of_place(line: Vector, problem: Problem, layout: Layout, work: Work) -> str:
    """Which gate is not crossed as it should be."""
    evaluate(line, problem, work.ends, work.samples, work.near, work.c)
    inner = layout.anchors[1:-1]
    outside = np.flatnonzero(work.c[inner, AREA] > OUTSIDE)
    if problem.active[KINDS + 1] and outside.size:
        return f"no race line was found that goes through point {outside[0] + 1} of the route within its area"
    speeds = np.sqrt((line[inner, 3:6] ** 2).sum(axis=1))
    askew = np.flatnonzero(work.c[inner, CROSSING] > ASKEW * speeds)
    if problem.active[KINDS + 2] and askew.size:
        return (
            f"no race line was found that crosses point {askew[0] + 1} of the route within planning.crossing_deg of its"
            " direction: lead up to it with waypoints, or move its neighbours"
        )
    return ""
