import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.thrust import ThrustMap
from flightapp.frames import GRAVITY

hovers = st.floats(0.1, 0.9)
curves = st.floats(0.0, 1.0)


@given(hovers, curves)
def test_hover_thrust_gives_one_g(hover, curve):
    thrust = ThrustMap(hover, curve)
    assert thrust.specific_force(hover) == pytest.approx(GRAVITY)
    assert thrust.throttle(GRAVITY) == pytest.approx(hover)


@given(hovers, curves, st.floats(0.001, 1.0))
def test_round_trip(hover, curve, throttle):
    thrust = ThrustMap(hover, curve)
    assert thrust.throttle(thrust.specific_force(throttle)) == pytest.approx(throttle, rel=1e-9)


@given(hovers, curves, st.floats(-50.0, 200.0))
def test_throttle_stays_in_range(hover, curve, force):
    assert 0.0 <= ThrustMap(hover, curve).throttle(force) <= 1.0


def test_the_curve_is_px4s():
    thrust = ThrustMap(0.5, 0.3)
    ratio = thrust.specific_force(0.8) / thrust.specific_force(0.5)
    assert ratio == pytest.approx((0.3 * 0.8**2 + 0.7 * 0.8) / (0.3 * 0.5**2 + 0.7 * 0.5))


@pytest.mark.parametrize(("hover", "curve"), [(0.0, 0.0), (1.1, 0.0), (0.5, -0.1), (0.5, 1.1), (float("nan"), 0.0)])
def test_nonsense_is_refused(hover, curve):
    with pytest.raises(ValueError, match="hover thrust must be"):
        ThrustMap(hover, curve)
