import numpy as np
import pytest
from lag_plant import LagPlant, Lags, believing, lemniscate

from flightapp.control.parameters import parameters_of
from flightapp.control.prediction import ENTRY, HISTORY, lagged, predict, remainder
from flightapp.messages import RateCommand

LAGS = Lags()
P = parameters_of(believing(LAGS))


def flown(count=80, seed=3):
    """A plant flown blindly at random; its states at each ms, and the history of what it was told."""
    rng = np.random.default_rng(seed)
    plant, history, states = LagPlant(LAGS, np.zeros(3)), np.zeros((HISTORY, ENTRY)), []
    thrust = 9.80665
    for tick in range(count):
        stamp = 0.004 * tick
        told = np.append(rng.uniform(-4.0, 4.0, 3), rng.uniform(5.0, 20.0))
        plant.send(RateCommand(stamp, told[:3], told[3]))
        if tick:
            thrust = lagged(thrust, history[tick - 1, 4], remainder(0.004, P.motor_lag))
        history[tick] = (stamp + P.delay, *told, thrust)
        for _ in range(4):
            states.append(plant.state.copy())
            plant.advance(plant.time + 0.001)
    return np.array(states), history


def motion(x, thrust=9.80665):
    return tuple(x[0:3]), tuple(x[7:10]), tuple(x[3:7]), tuple(x[10:13]), thrust


@pytest.mark.parametrize("ahead", [0.001, 0.015, 0.033, 0.1])
def test_the_past_commands_explain_what_happens_next(ahead):
    states, history = flown()
    start = 0.2
    end = states[round((start + ahead) * 1000)]
    position, velocity, q, rates, thrust = predict(P, motion(states[200]), start, start + ahead, history, 80)
    moved = np.linalg.norm(end[0:3] - states[200, 0:3])
    assert np.linalg.norm(np.array(position) - end[0:3]) < 0.01 * moved + 1e-5
    assert velocity == pytest.approx(end[7:10], abs=0.03)
    assert q == pytest.approx(end[3:7], abs=0.01)
    assert rates == pytest.approx(end[10:13], abs=0.1)
    assert thrust == pytest.approx(end[13], abs=0.2)


def test_a_ring_that_has_gone_round_is_read_in_order():
    states, history = flown(60)
    turned = np.zeros_like(history)
    shift = 2 * HISTORY - 20
    for k in range(60):
        turned[(k + shift) % HISTORY] = history[k]
    straight = predict(P, motion(states[120]), 0.12, 0.2, history, 60)
    turned[(shift - 68 + np.arange(68)) % HISTORY, 0] = -1.0
    assert predict(P, motion(states[120]), 0.12, 0.2, turned, 60 + shift) == straight


def test_without_commands_rates_and_thrust_stay():
    start = motion(np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5]))
    _, _, q, rates, thrust = predict(P, start, 0.0, 0.1, np.zeros((HISTORY, ENTRY)), 0)
    assert rates == (0.0, 0.0, 0.5)
    assert thrust == 9.80665
    assert q == pytest.approx((np.cos(0.025), 0.0, 0.0, np.sin(0.025)), abs=1e-6)


def test_a_state_from_the_future_is_taken_as_it_is():
    start = motion(lemniscate(3.0).sample(1.0).position.repeat(5)[:14])
    assert predict(P, start, 1.0, 0.9, np.zeros((HISTORY, ENTRY)), 0) == start


def test_a_lag_of_zero_follows_at_once():
    assert lagged(1.0, 3.0, remainder(0.004, 0.0)) == 3.0
    assert lagged(1.0, 3.0, remainder(0.04, 0.04)) == pytest.approx(3.0 - 2.0 * np.exp(-1.0))
