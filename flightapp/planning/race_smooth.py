"""Smoothest lines, those with the least squared snap (`minimum`), and smooth changes of lines."""

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import lean_kernel
from flightapp.planning.hermite import SNAP, Order, segment_ends, segment_polynomial
from flightapp.planning.minimum import smoothest
from flightapp.planning.race_samples import DURATION, FALLING


def smoothen(line: Vector, begin: int) -> bool:
    """Give ``line`` (n + 1, 13) the smoothest motion from knot ``begin`` on; False where the arithmetic fails.

    Its positions and durations stay, and so does the motion at that knot and at the last one.
    """
    part = line[begin:]
    ends = np.array((part[0, 3:DURATION], part[-1, 3:DURATION])).reshape(2, 3, 3)
    times, points = np.ascontiguousarray(part[:-1, DURATION]), np.ascontiguousarray(part[:, :3])
    motions, factors, couplings = np.empty((3, len(points), 3, 3))
    smooth = smoothest(SNAP, times, points, ends, motions, factors, couplings)
    part[1:-1, 3:DURATION] = motions[1:-1].reshape(-1, 9)
    return smooth


def bend(line: Vector, anchors: NDArray[np.intp], moves: Vector, begun: Vector) -> None:
    """Move ``line`` at the knots ``anchors`` (m + 1,), its first and last among them, by ``moves`` (m + 1, 3) m.

    ``begun`` (3, 3) is what is added to velocity, acceleration and jerk at its start; those at the other anchors stay,
    so that the change between two of them is no greater than at the greater of them.
    """
    if moves.any() or begun.any():
        times = np.add.reduceat(line[:-1, DURATION], anchors[:-1])
        motions = np.zeros((len(anchors), 3, 3))
        motions[0] = begun
        _add_change(SNAP, line, anchors, times, moves, motions, np.empty((8, 3)), np.empty((8, 3)))


@lean_kernel
def _add_change(
    order: Order,
    line: Vector,
    anchors: NDArray[np.intp],
    times: Vector,
    moves: Vector,
    motions: Vector,
    y: Vector,
    c: Vector,
) -> None:
    """Add to all knots of ``line`` what ``moves`` and ``motions`` at the ``anchors`` are there; the rest is scratch."""
    for i in range(times.size):
        segment_ends(order, i, times[i], moves, motions, y)
        segment_polynomial(order, y, c)
        begun = 0.0
        for k in range(anchors[i], anchors[i + 1] + (i == times.size - 1)):
            u, scale = begun / times[i], 1.0
            for d in range(4):
                for axis in range(3):
                    total = 0.0
                    for m in range(7, d - 1, -1):
                        total = total * u + FALLING[d, m] * c[m, axis]
                    line[k, 3 * d + axis] += scale * total + (moves[i, axis] if d == 0 else 0.0)
                scale /= times[i]
            begun += line[k, DURATION]
