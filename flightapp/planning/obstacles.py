"""What a plan must keep clear of, as rows of numbers for kernels: boxes, upright cylinders and the frames of gates.

Each row is one convex solid, so that its distance outside is convex and continuously differentiable; a gate's frame
is four rows, its bars. The distance is the exact Euclidean one. Outside, its gradient is a unit vector that
turns continuously; its second derivative jumps where the nearest point changes between face, edge and corner.
Inside, the distance is minus the depth under the nearest face, and the gradient jumps where two faces are
equally near.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.jit import lean_kernel
from flightapp.messages import GateEstimate
from flightapp.planning.course import horizontal_sigma
from flightapp.track import FRAME_THICKNESS, Box, Cylinder, GateShape

KIND, CENTRE, BALL, COS, SIN, HALF, OWNER, MARGIN, WIDTH = 0, 1, 4, 5, 6, 7, 10, 11, 12
"""Columns of a row: its kind; centre (3) m; radius of the ball around it, m; cosine and sine of its yaw; half sizes (3)
m along, across and up, for a cylinder its radius, nothing and half its height; index of what it belongs to among
`names`; m that the vehicle's middle is to keep from its surface. Last, how many columns there are."""
BOX, CYLINDER = 0.0, 1.0
BARS = 4
"""Rows of a frame."""
WIDEST = 0.3
"""m by which a frame counts as wider at the most, however little is known of its place."""


@dataclass(frozen=True, slots=True)
class Margins:
    """How far the vehicle, a ball, is to keep from surfaces."""

    radius: float
    """m, of the vehicle."""
    obstacle: float
    """m beyond it, from boxes and cylinders."""
    frame: float
    """m beyond it, from the frames of gates."""
    sigmas: float = 0.0
    """Standard deviations of a gate's place by which its frame counts as wider on the outside; on the inside the
    targets of plans see to it."""

    @classmethod
    def of(cls, config: Config) -> "Margins":
        """What ``config`` says."""
        planning = config.planning
        return cls(config.vehicle.radius, planning.clearance, planning.frame_clearance, planning.pace_sigmas)


def packed(
    obstacles: Sequence[Box | Cylinder], gates: Sequence[GateEstimate], shape: GateShape | None, margins: Margins
) -> Vector:
    """Rows (k, `WIDTH`): one for each of ``obstacles``, then four for the frame of each of ``gates``.

    Without a ``shape`` gates have no frame. A gate that is listed twice is one.
    """
    solids = [_solid(obstacle, owner, margins.radius + margins.obstacle) for owner, obstacle in enumerate(obstacles)]
    framed = _distinct(gates) if shape is not None else []
    rows = np.empty((len(solids) + BARS * len(framed), WIDTH))
    if solids:
        rows[: len(solids)] = solids
    if framed and shape is not None:
        bars = rows[len(solids) :]
        places = np.array([(*gate.position.tolist(), gate.yaw) for gate in framed], float)
        borders = np.array([shape.border + min(margins.sigmas * horizontal_sigma(gate), WIDEST) for gate in framed])
        _put_frames(places, float(shape.opening), borders, bars)
        bars[:, OWNER] = np.repeat(np.arange(len(solids), len(solids) + len(framed)), BARS)
        bars[:, MARGIN] = margins.radius + margins.frame
    return rows


def names(obstacles: Sequence[Box | Cylinder], gates: Sequence[GateEstimate]) -> tuple[str, ...]:
    """What the rows of `packed` belong to, in words, by the index in their column `OWNER`."""
    return (
        *(f"'{obstacle.name}'" for obstacle in obstacles),
        *(f"the frame of gate {gate.gate_id}" for gate in _distinct(gates)),
    )


def _distinct(gates: Sequence[GateEstimate]) -> list[GateEstimate]:
    return list({gate.gate_id: gate for gate in gates}.values())


def _solid(obstacle: Box | Cylinder, owner: int, margin: float) -> tuple[float, ...]:
    if isinstance(obstacle, Box):
        half = tuple(0.5 * side for side in obstacle.size)
        return BOX, *obstacle.centre, math.hypot(*half), 1.0, 0.0, *half, owner, margin
    x, y, z = obstacle.base
    up, r = 0.5 * obstacle.height, obstacle.radius
    return CYLINDER, x, y, z + up, math.hypot(r, up), 1.0, 0.0, r, 0.0, up, owner, margin


@lean_kernel
def _put_frames(places: Vector, opening: float, borders: Vector, rows: Vector) -> None:
    """Fill ``rows`` (4 m, `WIDTH`) but for owner and margin: for each of ``places`` (m, 4), x, y, z and yaw, four bars.

    They are below, right, above and left of the opening, ``borders`` (m,) thick; those below and above are as long as
    the frame is wide.
    """
    inner, thick = 0.5 * opening, 0.5 * FRAME_THICKNESS
    for i in range(rows.shape[0]):
        row, place, border, k = rows[i], places[i // BARS], borders[i // BARS], i % BARS
        bar = 0.5 * border
        c, s = math.cos(place[3]), math.sin(place[3])
        side = (inner + bar) * (1.0 if k > 1 else -1.0)
        aside, up, across, high = (0.0, side, inner + border, bar) if k % 2 == 0 else (side, 0.0, bar, inner)
        row[KIND], row[COS], row[SIN] = BOX, c, s
        row[CENTRE], row[CENTRE + 1], row[CENTRE + 2] = place[0] - s * aside, place[1] + c * aside, place[2] + up
        row[HALF], row[HALF + 1], row[HALF + 2] = thick, across, high
        row[BALL] = math.sqrt(thick * thick + across * across + high * high)


@lean_kernel
def beyond(p: Vector, rows: Vector, i: int, reach: float) -> bool:
    """Whether point ``p`` (3,) m is surely farther than ``reach`` m from row ``i``, as it is from its ball."""
    x, y, z = p[0] - rows[i, CENTRE], p[1] - rows[i, CENTRE + 1], p[2] - rows[i, CENTRE + 2]
    far: float = reach + rows[i, BALL]
    return far < 0.0 or bool(x * x + y * y + z * z > far * far)


@lean_kernel
def farther(p: Vector, rows: Vector, i: int, reach: float) -> bool:
    """Whether point ``p`` (3,) m is farther than ``reach`` m from row ``i``, unless that is less than 0.

    It takes no roots and divisions, unlike `distance`.
    """
    x, y, z = p[0] - rows[i, CENTRE], p[1] - rows[i, CENTRE + 1], p[2] - rows[i, CENTRE + 2]
    up = max(abs(z) - rows[i, HALF + 2], 0.0)
    if reach < 0.0 or up > reach:
        return reach >= 0.0
    if rows[i, KIND] == CYLINDER:
        r = rows[i, HALF] + math.sqrt(reach * reach - up * up)
        return bool(x * x + y * y > r * r)
    c, s = rows[i, COS], rows[i, SIN]
    along = max(abs(c * x + s * y) - rows[i, HALF], 0.0)
    across = max(abs(c * y - s * x) - rows[i, HALF + 1], 0.0)
    return bool(along * along + across * across + up * up > reach * reach)


@lean_kernel
def distance(p: Vector, rows: Vector, i: int, gradient: Vector) -> float:
    """Signed distance in m of point ``p`` (3,) m from the surface of row ``i``, negative inside.

    Its derivative with respect to ``p`` goes to ``gradient`` (3,), world frame: a unit vector, outwards.
    """
    x, y, z = p[0] - rows[i, CENTRE], p[1] - rows[i, CENTRE + 1], p[2] - rows[i, CENTRE + 2]
    c, s = rows[i, COS], rows[i, SIN]
    up = abs(z) - rows[i, HALF + 2]
    if rows[i, KIND] == CYLINDER:
        # The axis has no radial direction: any will do.
        r = math.sqrt(x * x + y * y)
        c, s = (x / r, y / r) if r > 0.0 else (1.0, 0.0)
        along, across = r - rows[i, HALF], -math.inf
        side_along = side_across = 1.0
    else:
        a, b = c * x + s * y, c * y - s * x
        along, across = abs(a) - rows[i, HALF], abs(b) - rows[i, HALF + 1]
        side_along, side_across = math.copysign(1.0, a), math.copysign(1.0, b)
    ga, gb, gc = max(along, 0.0), max(across, 0.0), max(up, 0.0)
    d = math.sqrt(ga * ga + gb * gb + gc * gc)
    if d > 0.0:
        ga, gb, gc = ga / d, gb / d, gc / d
    else:
        d = max(along, across, up)
        ga = 1.0 if d == along else 0.0
        gb = 1.0 if d == across and ga == 0.0 else 0.0
        gc = 1.0 - ga - gb
    ga, gb = side_along * ga, side_across * gb
    gradient[0] = c * ga - s * gb
    gradient[1] = s * ga + c * gb
    gradient[2] = math.copysign(gc, z)
    return d
