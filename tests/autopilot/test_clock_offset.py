import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.clock import ClockOffset


def test_nothing_is_known_before_the_first_answer():
    clock = ClockOffset()
    assert clock.offset is None
    assert clock.to_ours(1.0) is None
    assert clock.round_trip is None


@given(
    offset=st.floats(-1e6, 1e6),
    delays=st.lists(st.tuples(st.floats(0.0, 0.02), st.floats(0.0, 0.02)), min_size=1, max_size=60),
)
def test_the_error_is_at_most_half_the_shortest_round_trip(offset, delays):
    clock = ClockOffset()
    for k, (there, back) in enumerate(delays):
        sent = 0.5 * k
        clock.add(sent, sent + there + offset, sent + there + back)
    shortest = min(sum(pair) for pair in delays[-40:])
    assert clock.offset == pytest.approx(offset, abs=0.5 * shortest + 1e-6)
    assert clock.to_ours(100.0 + clock.offset) == pytest.approx(100.0, abs=1e-6)
    assert clock.steps == 0


def test_a_clock_that_was_set_anew_is_followed():
    clock = ClockOffset()
    for k in range(30):
        clock.add(0.5 * k, 0.5 * k + 0.0005 + 100.0, 0.5 * k + 0.001)
    for k in range(30, 33):
        clock.add(0.5 * k, 0.5 * k + 0.0005 + 3.0, 0.5 * k + 0.001)
    assert clock.offset == pytest.approx(3.0, abs=1e-3)
    assert clock.steps == 1


def test_impossible_exchanges_are_left_out():
    clock = ClockOffset()
    clock.add(2.0, 50.0, 1.0)
    clock.add(2.0, 50.0, 9.0)
    clock.add(float("nan"), 50.0, 9.0)
    assert clock.offset is None


def test_round_trips_are_counted():
    clock = ClockOffset()
    for k, trip in enumerate((0.001, 0.002, 0.009)):
        clock.add(k, k + 0.5 * trip, k + trip)
    told = clock.round_trip
    assert (told.count, told.p50, told.longest) == (3, pytest.approx(0.002), pytest.approx(0.009))
