"""Obstacles as outlines, for drawings."""

import math

import numpy as np

from flightapp.frames import Vector
from flightapp.track import Box, Cylinder

ROUND = 24
"""Corners of a drawn cylinder."""
RECTANGLE = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)], float)


def outline(obstacle: Box | Cylinder, axes: tuple[int, int] = (0, 1)) -> Vector:
    """(n, 2) m, closed: the outline of ``obstacle`` over two of the world's axes, from above or from a side."""
    chosen = list(axes)
    if isinstance(obstacle, Box):
        centre, half = np.array(obstacle.centre), 0.5 * np.array(obstacle.size)
    else:
        r, up = obstacle.radius, 0.5 * obstacle.height
        centre, half = np.array(obstacle.base) + np.array((0.0, 0.0, up)), np.array((r, r, up))
        if axes == (0, 1):
            angle = np.linspace(0.0, 2.0 * math.pi, ROUND + 1)
            ring: Vector = centre[chosen] + r * np.column_stack((np.cos(angle), np.sin(angle)))
            return ring
    corners: Vector = centre[chosen] + half[chosen] * RECTANGLE
    return corners
