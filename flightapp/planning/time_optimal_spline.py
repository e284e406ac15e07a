"""A flight as a spline of degree 7: what comes out of the search as a plan that can be flown."""

import math

import numpy as np

from flightapp.frames import GRAVITY, Vector, quat_to_matrix
from flightapp.planning.time_optimal_problem import Problem
from flightapp.planning.time_optimal_rotors import Airframe
from flightapp.planning.time_optimal_shooting import Flight
from flightapp.trajectory import ORDER

DENSE = 129
"""Samples of a segment where its peaks are looked for."""


def spline(problem: Problem, flight: Flight) -> Vector:
    """(n, 3, 8) coefficients of the segments between the n + 1 nodes of ``flight``, ascending powers of the time.

    Each has the flight's position, velocity, acceleration and jerk at both ends. Inputs are linear in between, so it
    follows the flight to the order of its degree.
    """
    axes = np.array([quat_to_matrix(q / np.linalg.norm(q)) for q in flight.states[:, 6:10]])
    axis, rates, thrust = axes[:, :, 2], flight.states[:, 10:12], flight.states[:, 12:]
    acceleration = thrust * axis - np.array([0.0, 0.0, GRAVITY])
    turn = rates[:, 1:] * axes[:, :, 0] - rates[:, :1] * axes[:, :, 1]
    jerk = thrust * turn + flight.inputs[:, :1] * axis
    motion = np.stack((flight.states[:, :3], flight.states[:, 3:6], acceleration, jerk), axis=1)
    motion[0], motion[-1] = problem.start, problem.end
    h = np.diff(flight.times)[:, None]
    powers = (h ** np.arange(4))[..., None]
    ends = np.concatenate((motion[:-1] * powers, motion[1:] * powers), axis=1)
    coefficients: Vector = np.einsum("cy,nya->nac", _FROM_ENDS, ends) / (h ** np.arange(ORDER))[:, None, :]
    return coefficients


def peaks_of(knots: Vector, coefficients: Vector, airframe: Airframe) -> Vector:
    """(n, 7) how close each segment comes to its bounds, in the order of `Bounds.row`, from dense samples.

    Both ends of a segment belong to it. The rotors' thrusts are those at the heading that asks most of one
    (differential flatness: D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for
    quadrotors", 2011).
    """
    h = np.diff(knots)[:, None]
    u = np.linspace(0.0, 1.0, DENSE)
    scaled = coefficients * (h ** np.arange(ORDER))[:, None, :]
    motion = []
    for d in range(1, 5):
        powers = np.array([_powers(value, d) for value in u])
        motion.append(np.einsum("nam,km->nka", scaled, powers) / (h**d)[:, None])
    velocity, acceleration, jerk, snap = motion
    force = acceleration + np.array([0.0, 0.0, GRAVITY])
    thrust = np.linalg.norm(force, axis=2)
    z = force / thrust[..., None]
    growth = np.sum(jerk * z, axis=2)[..., None]
    turn = (jerk - growth * z) / thrust[..., None]
    bend = (snap - 2.0 * growth * turn) / thrust[..., None]
    bend -= np.sum(bend * z, axis=2)[..., None] * z
    need = airframe.tilt_share * np.linalg.norm(bend, axis=2) + airframe.gyro_share * np.sum(turn**2, axis=2)
    greatest = (
        np.linalg.norm(velocity, axis=2),
        np.linalg.norm(acceleration, axis=2),
        np.linalg.norm(turn, axis=2),
        thrust,
        0.25 * thrust + need,
    )
    least = (thrust, 0.25 * thrust - need)
    return np.column_stack([*(values.max(axis=1) for values in greatest), *(values.min(axis=1) for values in least)])


def _powers(u: float, derivative: int) -> Vector:
    """(8,) derivative at ``u`` of each power of u."""
    return np.array([math.perm(m, derivative) * u ** max(m - derivative, 0) for m in range(ORDER)], float)


_FROM_ENDS = np.linalg.inv(np.array([_powers(u, d) for u in (0.0, 1.0) for d in range(4)]))
"""(8, 8) coefficients on the unit interval from position, velocity, acceleration, jerk at its ends."""
