"""Smoothest lines and smoothest changes of lines: those with the least squared jerk."""

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.planning.race_blocks import factorise, solve
from flightapp.planning.race_problem import KINDS, Problem
from flightapp.planning.race_samples import DURATION, KNOT
from flightapp.planning.race_system import assemble
from flightapp.planning.race_work import room


def smoothen(line: Vector, fixed: Vector) -> bool:
    """Let ``line`` (n + 1, 13) be as smooth as it can where ``fixed`` (n + 1, 13) is 0; False where arithmetic fails.

    Durations must be fixed.
    """
    n = len(line) - 1
    nowhere, none, areas = np.zeros((n + 1, 3)), np.zeros((n, KINDS)), np.zeros((n + 1, 3, 3))
    problem = Problem(
        np.zeros(KINDS + 3), none, np.ones(n), 0.0, 1.0, fixed, nowhere, areas, nowhere, nowhere, np.empty((0, 13)), 0.0
    )
    work = room(n)
    assemble(line, problem, 0.0, work)
    free = 1.0 - fixed
    diagonal = work.diagonal * (free[:, :, None] * free[:, None, :]) + fixed[:, :, None] * np.eye(KNOT)
    below = work.below * (free[1:, :, None] * free[:-1, None, :])
    step = work.right * free
    if not factorise(diagonal, below):
        return False
    solve(diagonal, below, step)
    line += step
    return True


def bend(line: Vector, anchors: NDArray[np.intp], moves: Vector) -> bool:
    """Move ``line`` at the knots ``anchors`` (m + 1,), its first and last among them, by ``moves`` (m + 1, 3) m.

    The motion at both ends stays, and the change between them is the smoothest. False where the arithmetic fails.
    """
    change, fixed = np.zeros((len(line), KNOT)), np.zeros((len(line), KNOT))
    change[:, DURATION] = line[:, DURATION]
    change[anchors, 0:3] = moves
    fixed[anchors, 0:3] = fixed[:, DURATION] = 1.0
    fixed[0] = fixed[-1] = 1.0
    if moves.any():
        if not smoothen(change, fixed):
            return False
        line[:, :DURATION] += change[:, :DURATION]
    return True
