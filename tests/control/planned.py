"""States, small changes of them, and slow ways to a step's derivatives, for the tests of planned controllers."""

import numpy as np
from lag_plant import Lags, believing

from flightapp.control.mpc_cost import add_state_cost, input_weights, state_cost
from flightapp.control.mpc_model import INPUTS, STATE, TANGENT, difference, step
from flightapp.control.mpc_work import steps_of
from flightapp.control.parameters import parameters_of, unpacked
from flightapp.frames import GRAVITY, quat_from_rotvec, quat_multiply
from flightapp.jit import kernel
from flightapp.messages import VehicleState

CONFIG = believing(Lags())
P = parameters_of(CONFIG)
NUMBERS = np.array(P)
CALM = (0.0, 0.0, 0.0)
GRID = steps_of(P, 0.004, 0.6)
REST = np.array([0.0, 0.0, 1.5])


@kernel
def stepped(numbers, x, u, g, out):
    step(unpacked(numbers), x, u, g, (0.3, -0.2, 0.0), out)


@kernel
def between(x, y, out):
    difference(x, y, out)


@kernel
def cost_of(numbers, x, r, duration, last):
    return state_cost(unpacked(numbers), x, r, duration, last)


@kernel
def cost_derivatives(numbers, x, r, duration, last, value):
    add_state_cost(unpacked(numbers), x, r, duration, last, value)


@kernel
def weights_of(numbers, r):
    return input_weights(unpacked(numbers), r)


def a_state(seed, tilt=0.6):
    rng = np.random.default_rng(seed)
    q = quat_from_rotvec(tilt * rng.standard_normal(3))
    return np.concatenate((rng.standard_normal(3), 4.0 * rng.standard_normal(3), q, rng.standard_normal(3), [14.0]))


def changed(x, change):
    """``x`` changed by a small ``change`` (13,)."""
    y = x + np.concatenate((change[:6], np.zeros(4), change[9:]))
    y[6:10] = quat_multiply(x[6:10], quat_from_rotvec(change[6:9]))
    return y


def after(x, u, g):
    out = np.zeros(STATE)
    stepped(NUMBERS, x, u, g, out)
    return out


def change_between(x, y):
    out = np.zeros(TANGENT)
    between(x, y, out)
    return out


def jacobian(x, u, g, h=1e-6):
    """(13, 17) derivatives of a step by state and input, from differences."""
    columns = []
    for i in range(TANGENT + INPUTS):
        ends = []
        for sign in (-h, h):
            e = np.zeros(TANGENT + INPUTS)
            e[i] = sign
            ends.append(after(changed(x, e[:TANGENT]), u + e[TANGENT:], g))
        columns.append(change_between(*ends) / (2.0 * h))
    return np.array(columns).T


def at_hover(x):
    """A reference row: to rest, level, at ``REST``."""
    return np.concatenate((REST, np.zeros(3), [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [GRAVITY, 1.0]))


def state(stamp=0.0, position=REST, velocity=(0.0, 0.0, 0.0), q=(1.0, 0.0, 0.0, 0.0)):
    return VehicleState(stamp, np.array(position), np.array(q), np.array(velocity), np.zeros(3), np.zeros((9, 9)))
