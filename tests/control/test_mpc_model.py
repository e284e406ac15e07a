"""One step of the planned vehicle, and what it costs, against slower ways to the same numbers."""

import numpy as np
import pytest
from lag_plant import LagPlant, Lags
from planned import (
    GRID,
    NUMBERS,
    REST,
    P,
    a_state,
    at_hover,
    change_between,
    changed,
    cost_derivatives,
    cost_of,
    jacobian,
    stepped,
)

from flightapp.control.mpc_cost import REFERENCE
from flightapp.control.mpc_model import CHANGES, INPUTS, STATE, TANGENT, linearise, pull_back
from flightapp.control.mpc_work import STEPS, steps_of
from flightapp.control.parameters import unpacked
from flightapp.control.riccati import WIDE
from flightapp.frames import GRAVITY
from flightapp.jit import kernel

PUSH = (0.3, -0.2, 0.0)


@kernel
def derivatives(numbers, x, u, g, rows, out):
    j = np.zeros(CHANGES)
    linearise(unpacked(numbers), x, u, g, j)
    pull_back(j, g, rows, out)


@pytest.mark.parametrize(("k", "tolerance"), [(0, 1e-5), (12, 2e-4), (STEPS - 1, 5e-3)])
@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_a_step_are_those_of_differences(seed, k, tolerance):
    x, u = a_state(seed), np.array([1.0, -2.0, 0.5, 16.0])
    expected, found = jacobian(x, u, GRID[k]), np.zeros((TANGENT + INPUTS, WIDE))
    derivatives(NUMBERS, x, u, GRID[k], np.eye(TANGENT, WIDE).ravel(), found.ravel())
    found = found[:, :TANGENT].T
    assert found == pytest.approx(expected, abs=tolerance)


def test_a_change_leads_from_one_state_to_the_other():
    change = 1e-4 * np.random.default_rng(1).standard_normal(TANGENT)
    assert change_between(a_state(5), changed(a_state(5), change)) == pytest.approx(change, abs=1e-9)


def test_a_step_is_what_the_plant_does():
    plant = LagPlant(Lags(), REST.copy(), velocity=np.array([3.0, 0.0, 0.0]))
    x, u = np.zeros(STATE), np.array([2.0, -1.0, 0.5, 14.0])
    x[0:3], x[3:6], x[6:10], x[13] = plant.position, plant.velocity, plant.orientation, GRAVITY
    plant._command = u
    grid = steps_of(P, 0.002, 0.04)
    out = np.zeros(STATE)
    for g in grid:
        stepped(NUMBERS, x, u, g, out)
        x[:] = out
    plant.advance(0.04)
    # The push from outside is the only difference.
    x[0:3] -= 0.5 * 0.04**2 * np.array(PUSH)
    x[3:6] -= 0.04 * np.array(PUSH)
    flown = plant.state
    assert x[0:3] == pytest.approx(flown[0:3], abs=5e-4)
    assert x[3:6] == pytest.approx(flown[7:10], abs=2e-2)
    assert x[6:10] == pytest.approx(flown[3:7], abs=2e-3)
    assert x[10:14] == pytest.approx(flown[10:14], abs=1e-6)


@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("tilt", [0.2, 1.5])
def test_the_costs_slope_is_that_of_differences(last, tilt):
    x, r, h = a_state(2, tilt), np.zeros(REFERENCE), 1e-6
    r[:] = at_hover(x)
    r[13] = 0.7
    value, slope = np.zeros((TANGENT, WIDE)), np.zeros(TANGENT)
    cost_derivatives(NUMBERS, x, r, 0.02, last, value.ravel())
    for i in range(TANGENT):
        e = np.zeros(TANGENT)
        e[i] = h
        ends = [cost_of(NUMBERS, changed(x, sign * e), r, 0.02, last) for sign in (1.0, -1.0)]
        slope[i] = (ends[0] - ends[1]) / (2.0 * h)
    assert value[:, TANGENT] == pytest.approx(slope, rel=1e-4, abs=1e-5)
    assert np.linalg.eigvalsh(value[:, :TANGENT]).min() > -1e-9
