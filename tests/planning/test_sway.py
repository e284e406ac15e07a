import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.interfaces import Limits, Motion
from flightapp.planning.splice import splice_fault
from flightapp.planning.sway import Sway, scaled, sway, within

PLACE = np.array((1.0, -2.0, 1.5))
REST = np.zeros(3)
tone = st.tuples(st.floats(0.0, 0.5), st.floats(0.2, 3.0))
tones = st.lists(tone, max_size=3)


@settings(max_examples=12)
@given(st.builds(Sway, st.floats(2.0, 5.0), tones, tones, tones, tones), st.floats(-3.0, 3.0))
def test_it_is_smooth_from_rest_to_rest_and_stays_within_its_amplitudes(way, yaw):
    line = sway(2.0, PLACE, yaw, way)
    assert splice_fault(line, Motion(PLACE, REST, REST, REST, yaw, 0.0)) == ""
    seen = line.sample(np.linspace(0.0, line.duration, 500))
    reach = [sum(a for a, _ in axis) for axis in (way.ahead, way.left, way.up, way.turn)]
    moved = seen.position - PLACE
    c, s = np.cos(yaw), np.sin(yaw)
    assert np.abs(c * moved[:, 0] + s * moved[:, 1]).max() <= reach[0] + 1e-3
    assert np.abs(c * moved[:, 1] - s * moved[:, 0]).max() <= reach[1] + 1e-3
    assert np.abs(moved[:, 2]).max() <= reach[2] + 1e-3
    assert np.abs(seen.yaw - yaw).max() <= reach[3] + 5e-3
    assert line.duration == pytest.approx(way.seconds)


def test_between_the_ramps_it_is_the_sine():
    line = sway(0.0, PLACE, 0.0, Sway(6.0, ahead=[(0.1, 1.3)]))
    times = np.linspace(1.0, 5.0, 50)
    w = 2.0 * np.pi * 1.3
    seen = line.sample(times)
    np.testing.assert_allclose(seen.position[:, 0] - PLACE[0], 0.1 * np.sin(w * times), atol=1e-5)
    np.testing.assert_allclose(seen.jerk[:, 0], -0.1 * w**3 * np.cos(w * times), atol=0.02)


def test_it_is_made_smaller_where_a_limit_asks_for_it():
    way = Sway(6.0, ahead=[(1.0, 0.5)], up=[(0.5, 0.5)], turn=[(1.0, 0.5)])
    wide = Limits(50.0, 50.0, 50.0)
    gentle = scaled(way, 0.3)
    assert within(gentle, wide, 100.0, 100.0) == gentle
    for limits, thrust, rate in ((Limits(1.0, 50.0, 50.0), 100.0, 100.0), (wide, 12.0, 100.0), (wide, 100.0, 1.0)):
        peaks = sway(0.0, PLACE, 0.0, within(way, limits, thrust, rate)).limits()
        assert peaks.speed <= 1.01 * limits.v_max
        assert peaks.specific_force <= 1.01 * thrust
        assert peaks.body_rate <= 1.01 * rate
    assert scaled(way, 0.5).ahead == [(0.5, 0.5)]


def test_too_short_a_time_is_refused():
    with pytest.raises(ValueError, match="at least 2 s"):
        sway(0.0, PLACE, 0.0, Sway(1.0))
