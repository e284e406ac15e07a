import numpy as np
import pytest

from flightapp.config import Config
from flightapp.control.flatness import FlatnessController
from flightapp.evaluation.control_trials import LOST, Mismatch, Trial, draws, score
from flightapp.trajectory import hover
from sim.trials import blur, fly

CONFIG = Config()
LINE = hover(0.0, np.array([0.0, 0.0, 1.5]), 0.0, duration=1.0)


def test_a_vehicle_that_cannot_fly_has_crashed():
    assert fly(CONFIG, FlatnessController(CONFIG), LINE, Mismatch(thrust=0.2)).crashed


@pytest.mark.parametrize("delay", [-0.01, 0.01])
def test_a_delay_that_is_not_known_costs_little_in_hover_and_the_same_flight_repeats(delay):
    controller = FlatnessController(CONFIG)
    first, second = (fly(CONFIG, controller, LINE, Mismatch(seed=3, delay=delay, gust=0.5)) for _ in range(2))
    assert first == second
    assert 0.0 < first.rmse < 0.05


def test_draws_stay_within_what_is_told_and_differ():
    drawn = list(draws(200, 0))
    assert len({mismatch.mass for mismatch in drawn}) == 200
    assert all(0.9 <= m.mass <= 1.1 and 0.9 <= m.thrust <= 1.1 and 0.5 <= m.drag <= 2.0 for m in drawn)
    assert all(0.7 <= m.motor <= 1.3 and abs(m.delay) <= 0.01 for m in drawn)
    assert max(m.delay for m in drawn) > 0.008
    assert min(m.drag for m in drawn) < 0.55


def test_crashes_are_counted_and_left_out_of_the_errors():
    result = score([Trial(0.02, 0.05, False), Trial(0.04, 0.08, False), Trial(9.0, 9.0, True)])
    assert (result.runs, result.crashes) == (3, 1)
    assert (result.rmse, result.worst, result.error) == pytest.approx((0.03, 0.04, 0.08))
    assert result.cost == pytest.approx(0.5 * ((0.02 + 0.04 + LOST) / 3.0 + LOST))
    assert score([Trial(9.0, 9.0, True)]).worst is None


def test_noise_is_seen_by_the_controller_and_costs_little():
    controller = FlatnessController(CONFIG)
    clean, noisy = (fly(CONFIG, controller, LINE, Mismatch(noise=noise)) for noise in (0.0, 1.0))
    assert clean.rmse < noisy.rmse < 0.03


def test_noise_of_the_attitude_turns_it_by_as_much():
    row, noise = np.zeros(17), np.zeros(12)
    row[4], noise[3:6], noise[0] = 1.0, (1e-3, -2e-3, 3e-3), 0.5
    blur(row, noise)
    np.testing.assert_allclose(row[4:8], (1.0, 5e-4, -1e-3, 1.5e-3), atol=1e-5)
    assert row[1] == 0.5
