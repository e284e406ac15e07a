import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.identification.lags import lagged

STAMPS = np.cumsum(np.full(60, 0.004)) + 1.0


@settings(max_examples=12)
@given(st.floats(0.0, 0.05), st.floats(0.005, 0.1), st.integers(0, 1000))
def test_it_is_the_answer_of_a_first_order_lag_behind_a_delay(delay, lag, seed):
    values = np.random.default_rng(seed).normal(size=STAMPS.size)
    at = np.linspace(STAMPS[0], STAMPS[-1] + 0.05, 40)
    fine = np.arange(STAMPS[0], at[-1] + 2e-5, 1e-5)
    acting = values[np.clip(np.searchsorted(STAMPS + delay, fine, side="right") - 1, 0, None)]
    answer = np.empty(fine.size)
    answer[0] = values[0]
    keep = np.exp(-1e-5 / lag)
    for k in range(1, fine.size):
        answer[k] = acting[k - 1] + (answer[k - 1] - acting[k - 1]) * keep
    np.testing.assert_allclose(lagged(STAMPS, values, delay, lag, at), np.interp(at, fine, answer), atol=1e-4 / lag)


def test_without_a_lag_it_is_the_command_that_acts():
    values = np.arange(60.0)
    at = STAMPS[10:] + 0.0101
    np.testing.assert_array_equal(lagged(STAMPS, values, 0.01, 0.0, at), values[10:])


def test_before_any_command_it_is_as_if_the_first_had_always_been_in_force():
    np.testing.assert_array_equal(lagged(STAMPS, np.full(60, 3.0), 0.1, 0.05, STAMPS[:20]), np.full(20, 3.0))
