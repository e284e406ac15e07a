"""What a plan must keep clear of, as rows of numbers for kernels: boxes, upright cylinders and the frames of gates.

Each row is one convex solid, so that its distance outside is convex and continuously differentiable; a gate's frame
is four rows, its bars. The distance is the exact Euclidean one. Outside, its gradient is a unit vector that
turns continuously; its second derivative jumps where the nearest point changes between face, edge and corner.
Inside, the distance is minus the depth under the nearest face, and the gradient jumps where two faces are
equally near.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.jit import lean_kernel
from flightapp.messages import GateEstimate
from flightapp.track import FRAME_THICKNESS, Box, Cylinder, GateShape

KIND, CENTRE, BALL, COS, SIN, HALF, OWNER, MARGIN, WIDTH = 0, 1, 4, 5, 6, 7, 10, 11, 12
"""Columns of a row: its kind; centre (3) m; radius of the ball around it, m; cosine and sine of its yaw; half sizes (3)
m along, across and up, for a cylinder its radius, nothing and half its height; index of what it belongs to among
`names`; m that the vehicle's middle is to keep from its surface. Last, how many columns there are."""
BOX, CYLINDER = 0.0, 1.0


@dataclass(frozen=True, slots=True)
class Margins:
    """How far the vehicle, a ball, is to keep from surfaces."""

    radius: float
    """m, of the vehicle."""
    obstacle: float
    """m beyond it, from boxes and cylinders."""
    frame: float
    """m beyond it, from the frames of gates."""

    @classmethod
    def of(cls, config: Config) -> "Margins":
        """What ``config`` says."""
        return cls(config.vehicle.radius, config.planning.clearance, config.planning.frame_clearance)


def packed(
    obstacles: Sequence[Box | Cylinder], gates: Sequence[GateEstimate], shape: GateShape | None, margins: Margins
) -> Vector:
    """Rows (k, `WIDTH`): one for each of ``obstacles``, then four for the frame of each of ``gates``.

    Without a ``shape`` gates have no frame. A gate that is listed twice is one.
    """
    rows = [_solid(obstacle, owner, margins.radius + margins.obstacle) for owner, obstacle in enumerate(obstacles)]
    if shape is not None:
        for owner, gate in enumerate(_distinct(gates), len(obstacles)):
            rows += _bars(gate, shape, owner, margins.radius + margins.frame)
    return np.array(rows, float).reshape(-1, WIDTH)


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


def _bars(gate: GateEstimate, shape: GateShape, owner: int, margin: float) -> Iterator[tuple[float, ...]]:
    """Top and bottom over the whole width, left and right between them."""
    x, y, z = (float(value) for value in gate.position)
    c, s = math.cos(gate.yaw), math.sin(gate.yaw)
    inner, bar, thick = 0.5 * shape.opening, 0.5 * shape.border, 0.5 * FRAME_THICKNESS
    middle, outer = inner + bar, inner + shape.border
    for side in (-middle, middle):
        for centre, half in (
            ((x, y, z + side), (thick, outer, bar)),
            ((x - s * side, y + c * side, z), (thick, bar, inner)),
        ):
            yield BOX, *centre, math.hypot(*half), c, s, *half, owner, margin


@lean_kernel
def beyond(p: Vector, rows: Vector, i: int, reach: float) -> bool:
    """Whether point ``p`` (3,) m is surely farther than ``reach`` m from row ``i``, as it is from its ball."""
    x, y, z = p[0] - rows[i, CENTRE], p[1] - rows[i, CENTRE + 1], p[2] - rows[i, CENTRE + 2]
    far: float = reach + rows[i, BALL]
    return far < 0.0 or bool(x * x + y * y + z * z > far * far)


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
