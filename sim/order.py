"""Which of two quads hides the other."""

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from sim.scene import Quads


def quad_vertices(quads: Quads) -> Vector:
    """(n, 4, 3) m, world: the vertices of each quad."""
    s = quads.bounds[:, [0, 1, 1, 0]][..., None]
    t = quads.bounds[:, [2, 2, 3, 3]][..., None]
    vertices: Vector = quads.origin[:, None] + s * quads.along[:, None] + t * quads.up[:, None]
    return vertices


def quad_spheres(vertices: Vector) -> Vector:
    """(n, 4) m: centre and radius of the ball around each quad of ``vertices`` (n, 4, 3)."""
    centre = vertices.mean(axis=1)
    radius = np.linalg.norm(vertices - centre[:, None], axis=2).max(axis=1, initial=0.0)
    return np.column_stack([centre, radius])


def quad_normals(quads: Quads) -> Vector:
    """(n, 3) unit, world: away from who looks at the front."""
    return np.cross(quads.along, quads.up)


@kernel
def _beyond(point: Vector, normal: Vector, vertices: Vector, eye: Vector, sign: float) -> bool:
    """Whether all ``vertices`` lie on the far (sign +1) or near (−1) side of a plane, as seen from ``eye``."""
    height = 0.0
    for j in range(3):
        height += (eye[j] - point[j]) * normal[j]
    for i in range(len(vertices)):
        level = 0.0
        for j in range(3):
            level += (vertices[i, j] - point[j]) * normal[j]
        if level * height * sign > 1e-9:
            return False
    return True


@kernel
def far_to_near(vertices: Vector, normals: Vector, eye: Vector) -> NDArray[np.int64]:
    """(n,) quads so that each comes before all that may hide it from ``eye`` (3,) m.

    The tests are those of M. Newell, R. Newell and T. Sancha, "A solution to the hidden surface problem" (1972):
    a quad is behind another if it lies wholly beyond its plane, or the other wholly before its own.
    Quads that hide each other in a circle, which gates do not, come by the distance of their middles.
    """
    n = len(vertices)
    distance = np.empty(n)
    for i in range(n):
        distance[i] = 0.0
        for j in range(3):
            distance[i] += (0.5 * (vertices[i, 0, j] + vertices[i, 2, j]) - eye[j]) ** 2
    left = np.argsort(-distance)
    order = np.empty(n, np.int64)
    for done in range(n):
        remaining = n - done
        pick = 0
        for i in range(remaining):
            a = left[i]
            free = True
            for other in range(remaining):
                b = left[other]
                if a == b:
                    continue
                a_behind = _beyond(vertices[b, 0], normals[b], vertices[a], eye, 1.0)
                a_behind = a_behind or _beyond(vertices[a, 0], normals[a], vertices[b], eye, -1.0)
                b_behind = _beyond(vertices[a, 0], normals[a], vertices[b], eye, 1.0)
                b_behind = b_behind or _beyond(vertices[b, 0], normals[b], vertices[a], eye, -1.0)
                if b_behind and not a_behind:
                    free = False
                    break
            if free:
                pick = i
                break
        order[done] = left[pick]
        for i in range(pick, remaining - 1):
            left[i] = left[i + 1]
    return order
