"""Ways around obstacles: points to add to a route so that its straight legs keep clear.

A leg between gates leaves the first one forwards and comes to the second one from the front. Where it has to go around
something, the openings of both are walls, so that it goes through neither of them once more.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.interfaces import PlanningError, PlanRequest
from flightapp.planning.bypass import bypass
from flightapp.planning.grid import MOVES
from flightapp.planning.legs import blocked_on, clear_legs, deepest, reaches
from flightapp.planning.obstacles import BOX, OWNER, WIDTH, Margins, names, packed
from flightapp.planning.request import Route
from flightapp.track import FRAME_THICKNESS

NEARBY = 4.0
"""m around a leg in which a way is searched first."""
ROOM, HEADROOM, FLOOR = 5.0, 3.0, 0.3
"""m beyond the points of a route, to the sides and upwards, and m above the ground, that may be used."""
STRAIGHT = (0.6, 0.45, 0.3)
"""m that a leg goes straight out of a gate and into the next one, the first that is clear."""
NOBODY = -1.0
"""The owner of an opening that is closed for a search."""
GREED = 1.5
"""Factor on the distance left in the search: with 1.1 it takes half as long again for ways shorter by 1 %."""
EFFORT = 6_000.0
"""That the search for all ways of a route may take, as `bypass` counts it."""
TOLL = 1e3
"""m of way per m that a point of the grid is too close: the last search finds narrow gaps, or what closes them."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A route with points added."""

    points: Vector
    """(n, 3) m."""
    inserted: NDArray[np.bool_]
    """(n,) which of them were added; they may be moved."""
    effort: float
    """That it took to find them."""


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """The points of a route and what they are."""

    points: Vector
    """(m, 3) m."""
    directions: Vector
    """(m, 3) unit vector of passage, zero where any will do."""
    names: tuple[str, ...]
    """(m,), such as "gate 3"."""
    openings: float = 0.0
    """m, side of the openings at the points that have a direction; 0 where there are no frames around them."""

    @classmethod
    def of(cls, route: Route, request: PlanRequest) -> "Places":
        """The points of ``route``, which answers ``request``."""
        last = len(route.points) - 1
        called = ["the start", *(f"waypoint {k - 1}" for k in range(1, last)), "the end"]
        for place, gate in zip(route.gate_places, request.gates, strict=False):
            called[place] = f"gate {gate.gate_id}"
        openings = request.shape.opening if request.shape else 0.0
        return cls(route.points, route.directions, tuple(called), openings)


@dataclass(frozen=True, slots=True, eq=False)
class Solids:
    """What is in the way, as `obstacles.packed` and `obstacles.names` give it."""

    rows: Vector
    names: tuple[str, ...]

    @classmethod
    def of(cls, request: PlanRequest, margins: Margins) -> "Solids":
        """The obstacles of ``request`` and the frames of its gates and of the others, if their shape is known."""
        gates = (*request.frames, *request.gates)
        return cls(packed(request.obstacles, gates, request.shape, margins), names(request.obstacles, gates))


def room(points: Vector) -> Vector:
    """(2, 3) m: the lowest and the highest corner of the box around ``points`` (m, 3) in which ways may lie."""
    low, high = points.min(axis=0), points.max(axis=0)
    aside = np.array([ROOM, ROOM, 0.0])
    floor = min(FLOOR, float(low[2]))
    return np.array([[*(low - aside)[:2], floor], [*(high + aside)[:2], high[2] + HEADROOM]])


def detour(places: Places, solids: Solids, bounds: Vector | None = None) -> Way:
    """The route of ``places`` with points added where a leg would come too close to one of ``solids``.

    Legs that are clear stay as they are. ``bounds`` (2, 3) m are the corners of the box in which ways may lie, `room`
    if None. What the start is too close to may be left. Raises `PlanningError` that names the leg and what blocks
    it, or the place that is inside something.
    """
    points, inserted, left = [places.points[0]], [False], EFFORT
    clear = np.ones(len(places.points) - 1, bool)
    if solids.rows.shape[0]:
        _check_places(places, solids)
        clear = clear_legs(places.points, places.directions, solids.rows, places.openings > 0.0)
    box = room(places.points) if bounds is None else bounds
    for k, straight in enumerate(clear):
        if not straight:
            around, left = _around(places, solids, k, box, left)
            points.extend(around)
            inserted.extend([True] * len(around))
        points.append(places.points[k + 1])
        inserted.append(False)
    return Way(np.array(points), np.array(inserted), EFFORT - left)


def _check_places(places: Places, solids: Solids) -> None:
    """A gate may have something near its centre, as it is wide, but other points must be free, the start excepted.

    They may be as close to something as the start is: a flight that ends beside a frame may be told to stay there.
    """
    margins = reaches(places.points[0], places.points[0], solids.rows, 0.0)
    for place in range(1, len(places.points)):
        gate = bool(places.directions[place].any())
        i, depth = deepest(places.points[place], solids.rows, np.zeros(len(margins)) if gate else margins, np.empty(3))
        if i < 0:
            continue
        name = f"the centre of {places.names[place]}" if gate else places.names[place]
        other, wanted = solids.names[int(solids.rows[i, OWNER])], 0.0 if gate else margins[i]
        if depth >= wanted:
            raise PlanningError(f"{name} is inside {other}; move one of them")
        raise PlanningError(
            f"{name} is {wanted - depth:.2f} m from {other}, {wanted:.2f} m with the vehicle's radius are wanted"
        )


def _around(places: Places, solids: Solids, k: int, bounds: Vector, effort: float) -> tuple[Vector, float]:
    """(n, 3) the points between place ``k`` and the next of a way around what blocks the leg; what effort is left."""
    (a, out), (b, into) = _run(places, solids, k, 1.0), _run(places, solids, k + 1, -1.0)
    low, high = np.minimum(bounds[0], np.minimum(a, b)), np.maximum(bounds[1], np.maximum(a, b))
    everything = np.vstack([solids.rows, _openings(places, k)])
    nearby = np.maximum(low, np.minimum(a, b) - NEARBY), np.minimum(high, np.maximum(a, b) + NEARBY)
    for box, toll in ((nearby, math.inf), ((low, high), TOLL)):
        way, blocked, taken = bypass(a, b, everything, *box, toll, GREED, MOVES, effort)
        effort -= taken
        if len(way) and not len(blocked):
            return way[int(not out) : len(way) - int(not into)], effort
    leg = f"the way from {places.names[k]} to {places.names[k + 1]}"
    if effort <= 0.0:
        raise PlanningError(f"{leg} was not found in the time there is: too much is in the way of the legs up to there")
    owners = dict.fromkeys(int(owner) for owner in blocked[:, OWNER])
    what = " and ".join("the gate itself" if owner == NOBODY else solids.names[owner] for owner in owners)
    extent = ", ".join(f"{axis} {low[j]:.1f} .. {high[j]:.1f} m" for j, axis in enumerate("xyz"))
    raise PlanningError(f"{leg} is blocked by {what}: there is no other within {extent}")


def _run(places: Places, solids: Solids, place: int, sign: float) -> tuple[Vector, bool]:
    """Where a search begins (``sign`` 1) or ends (-1), straight behind or before a gate; whether it is off it."""
    point, direction = places.points[place], places.directions[place]
    if places.openings == 0.0 or not direction.any():
        return point, False
    reach = reaches(point, point, solids.rows, 0.0)
    for run in STRAIGHT:
        end = point + sign * run * direction
        blocked = blocked_on(point, end, solids.rows, reach)
        if blocked < 0:
            return end, True
    other = solids.names[int(solids.rows[blocked, OWNER])]
    side = "behind" if sign > 0.0 else "before"
    raise PlanningError(f"{other} is less than {STRAIGHT[-1]} m {side} {places.names[place]}; move one of them")


def _openings(places: Places, k: int) -> Vector:
    """Rows for the openings of the gates at both ends of leg ``k``."""
    rows = []
    half, thick = 0.5 * places.openings, 0.5 * FRAME_THICKNESS
    for place in (k, k + 1):
        c, s, _ = places.directions[place]
        if half > 0.0 and (c or s):
            ball = math.hypot(thick, half, half)
            rows.append((BOX, *places.points[place], ball, c, s, thick, half, half, NOBODY, 0.0))
    return np.array(rows, float).reshape(-1, WIDTH)
