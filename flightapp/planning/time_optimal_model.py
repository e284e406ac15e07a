"""Two models of a quadrotor, and what has to hold in each, as symbols for a solver.

`THRUST_AND_RATES`: position, velocity and attitude, with the collective specific force and the rates of roll and
pitch as inputs. No plan that keeps to the same limits is faster. `FULL`: rates and collective thrust are states, and
change as fast as the four rotors can change them, each of which keeps to its bounds at any heading. Position to jerk
are continuous, so that a spline can follow the flight exactly. Neither turns about its thrust axis: the heading is of
no account. States are those of `time_optimal_problem.state_of`, without what is an input.

Inputs are linear between nodes. The dynamics are integrated by Runge and Kutta's fourth-order method in a few steps,
and the limits are looked at after each.
"""

import math
from enum import Enum
from itertools import pairwise
from typing import Any

import numpy as np

from flightapp.frames import GRAVITY, Vector
from flightapp.planning.time_optimal_problem import Problem, thrust_of

PARTS = 3
"""Of an interval: steps of the integration, after each of which the limits are looked at."""
ROTOR_TIME = 0.07
"""s in which a rotor goes from rest to full thrust at the fastest: twice the time constant of a racer's motor."""
STILL = 1.0
"""rad/s², angular acceleration below which the need of torque is rounded off."""
SLOW = 1e-2
"""m/s, speed below which the direction of passage is rounded off."""
UNIT = 100.0
"""m/s³ and rad/s², of the inputs of `FULL`, which makes unknowns alike in size."""
WEIGHT = (0.0, 0.0, GRAVITY)
Range = tuple[Any, float, float]
"""An expression, its least and its greatest value."""


class Model(Enum):
    """What is flown; the value is its number of states."""

    THRUST_AND_RATES = 10
    FULL = 13


def input_range(problem: Problem, model: Model) -> tuple[Vector, Vector]:
    """(3,) least and greatest inputs: of the thrust, or its change, and of the rates, or theirs."""
    bounds = problem.bounds
    if model is Model.THRUST_AND_RATES:
        rates = (bounds.rate, bounds.rate)
        return np.array([bounds.force_min, -bounds.rate, -bounds.rate]), np.array([bounds.force_max, *rates])
    slew = 4.0 * bounds.rotor_max / ROTOR_TIME
    spin_up = 0.5 * bounds.rotor_max / problem.airframe.tilt_share
    most = np.array([slew, spin_up, spin_up]) / UNIT
    return -most, most


def interval(ca: Any, problem: Problem, model: Model) -> Any:
    """What has to vanish and what has to be negative between two nodes.

    Of the states and inputs at both, the duration and the bounds (7,) as `Bounds.row` has them.
    """
    x, end = ca.SX.sym("x", model.value), ca.SX.sym("end", model.value)
    u, w, h, bounds = (ca.SX.sym(name, size) for name, size in (("u", 3), ("w", 3), ("h", 1), ("bounds", 7)))
    inputs = [u + (w - u) * k / PARTS for k in range(PARTS + 1)]
    state, limits = x, []
    for before, after in pairwise(inputs):
        limits += limits_at(ca, problem, model, state, before, bounds)
        state = _stepped(ca, model, state, before, after, h / PARTS)
    return ca.Function("interval", [x, end, u, w, h, bounds], [state - end, ca.vertcat(*limits)])


def _stepped(ca: Any, model: Model, x: Any, u: Any, w: Any, h: Any) -> Any:
    """The state a time ``h`` after ``x``, with inputs that go from ``u`` to ``w``."""

    def rate(x: Any, u: Any) -> Any:
        thrust, rates = (x[12], x[10:12]) if model is Model.FULL else (u[0], u[1:3])
        pull = thrust * _thrust_axis(ca, x) - ca.DM(WEIGHT)
        w, i, j, k = (x[6 + n] for n in range(4))
        p, q = rates[0], rates[1]
        turn = 0.5 * ca.vertcat(-i * p - j * q, w * p - k * q, w * q + k * p, i * q - j * p)
        change = [u[1:3] * UNIT, u[0] * UNIT] if model is Model.FULL else []
        return ca.vertcat(x[3:6], pull, turn, *change)

    half = 0.5 * (u + w)
    k1 = rate(x, u)
    k2 = rate(x + 0.5 * h * k1, half)
    k3 = rate(x + 0.5 * h * k2, half)
    k4 = rate(x + h * k3, w)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def limits_at(ca: Any, problem: Problem, model: Model, x: Any, u: Any, bounds: Any) -> list[Any]:
    """What has to be negative in a state with its inputs, for the ``bounds`` (7,)."""
    v_max, a_max, rate, force_max, rotor_max, force_min, rotor_min = (bounds[k] for k in range(7))
    full = model is Model.FULL
    thrust, rates = (x[12], x[10:12]) if full else (u[0], u[1:3])
    limits = [ca.sumsqr(rates) / rate**2 - 1.0]
    if math.isfinite(problem.bounds.v_max):
        limits.append(ca.sumsqr(x[3:6]) / v_max**2 - 1.0)
    if math.isfinite(problem.bounds.a_max):
        limits.append(ca.sumsqr(thrust * _thrust_axis(ca, x) - ca.DM(WEIGHT)) / a_max**2 - 1.0)
    if full:
        turning = UNIT**2 * ca.sumsqr(u[1:3]) + STILL**2
        need = problem.airframe.tilt_share * ca.sqrt(turning) + problem.airframe.gyro_share * ca.sumsqr(rates)
        limits += [(force_min - thrust) / GRAVITY, (thrust - force_max) / GRAVITY]
        limits += [(0.25 * thrust + need - rotor_max) / GRAVITY, (rotor_min + need - 0.25 * thrust) / GRAVITY]
    return limits


def passages(ca: Any, problem: Problem, X: Any, nodes: int) -> list[Range]:
    """What has to hold at the areas."""
    found: list[Range] = []
    areas = zip(problem.centres, problem.shapes, problem.directions, strict=True)
    for i, (centre, shape, direction) in enumerate(areas, start=1):
        x = X[:, i * nodes]
        found.append((ca.sumsqr(ca.DM(shape) @ (x[:3] - ca.DM(centre))), -math.inf, 1.0))
        if direction.any():
            speed = ca.sqrt(ca.sumsqr(x[3:6]) + SLOW**2)
            found.append((ca.dot(ca.DM(direction), x[3:6]) - problem.cosine * speed, 0.0, math.inf))
    return found


def arrival(ca: Any, problem: Problem, X: Any, model: Model) -> list[Range]:
    """Thrust axis and rates at the end, in two of three components: the third follows from the lengths."""
    thrust, axis = thrust_of(problem.end[2])
    across = ca.DM(np.linalg.svd(axis[None])[2][1:])
    z = _thrust_axis(ca, X[:, -1])
    found = [(across @ z, 0.0, 0.0), (ca.dot(ca.DM(axis), z), 0.0, math.inf)]
    if model is Model.FULL:
        x, y = _level_axes(ca, X[:, -1])
        turn = X[11, -1] * x - X[10, -1] * y
        found.append((across @ (turn - ca.DM(problem.end[3] / thrust)), 0.0, 0.0))
    return found


def _thrust_axis(ca: Any, x: Any) -> Any:
    """(3,) the body's z axis in the state ``x``."""
    w, i, j, k = (x[6 + n] for n in range(4))
    return ca.vertcat(2.0 * (i * k + w * j), 2.0 * (j * k - w * i), 1.0 - 2.0 * (i * i + j * j))


def _level_axes(ca: Any, x: Any) -> tuple[Any, Any]:
    """(3,) the body's x and y axes in the state ``x``."""
    w, i, j, k = (x[6 + n] for n in range(4))
    ahead = ca.vertcat(1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j + w * k), 2.0 * (i * k - w * j))
    return ahead, ca.vertcat(2.0 * (i * j - w * k), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k + w * i))
