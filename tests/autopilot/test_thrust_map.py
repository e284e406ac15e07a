import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import load_config
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


@given(hovers, curves, st.floats(allow_nan=True, allow_infinity=True))
def test_never_nan(hover, curve, force):
    assert 0.0 <= ThrustMap(hover, curve).throttle(force) <= 1.0


@given(curves, st.floats(12.0, 20.0))
def test_thrust_goes_with_the_square_of_the_voltage(curve, voltage):
    thrust = ThrustMap(0.4, curve, hover_voltage=16.0)
    at_reference = thrust.specific_force(0.4)
    thrust.observe_voltage(voltage, 1.0)
    assert thrust.specific_force(0.4) == pytest.approx(at_reference * (voltage / 16.0) ** 2)
    assert thrust.throttle(thrust.specific_force(0.3)) == pytest.approx(0.3)


@pytest.mark.parametrize("voltage", [math.nan, math.inf, -16.0, 0.0, 11.9, 20.1, 65.535])
def test_a_voltage_that_no_battery_has_changes_nothing(voltage):
    thrust, never = ThrustMap(0.4, hover_voltage=16.0), ThrustMap(0.4, hover_voltage=16.0)
    never.observe_voltage(voltage, 1.0)
    assert never.battery_factor == 1.0
    thrust.observe_voltage(14.0, 0.0)
    before = thrust.throttle(GRAVITY)
    thrust.observe_voltage(voltage, 10.0)
    thrust.observe_voltage(15.0, math.nan)
    assert thrust.throttle(GRAVITY) == before > 0.4


def test_the_voltage_is_smoothed():
    thrust = ThrustMap(0.4, hover_voltage=16.0)
    thrust.observe_voltage(16.0, 0.0)
    thrust.observe_voltage(14.0, 0.5)
    assert 0.9 < thrust.battery_factor < 0.97
    for tick in range(2, 60):
        thrust.observe_voltage(14.0, 0.5 * tick)
    assert thrust.battery_factor == pytest.approx((14.0 / 16.0) ** 2, rel=1e-3)
    settled = thrust.battery_factor
    thrust.observe_voltage(16.0, 3.0)  # a stamp that goes back
    assert thrust.battery_factor == settled


def test_without_a_reference_the_voltage_is_not_followed():
    thrust = ThrustMap(0.4)
    thrust.observe_voltage(12.0, 0.0)
    assert thrust.battery_factor == 1.0


@given(hovers, curves, hovers)
def test_what_was_learnt_replaces_what_was_configured(hover, curve, real):
    thrust = ThrustMap(hover, curve, hover_voltage=16.0)
    thrust.learn(real)
    assert thrust.throttle(GRAVITY) == pytest.approx(real)
    assert thrust.configured_force(hover) == pytest.approx(GRAVITY)
    thrust.observe_voltage(15.0, 0.0)
    assert thrust.specific_force(real) == pytest.approx(GRAVITY * (15.0 / 16.0) ** 2)


@pytest.mark.parametrize("nonsense", [math.nan, math.inf, 0.0, -1.0, 1.1])
def test_nonsense_is_not_learnt(nonsense):
    thrust = ThrustMap(0.4)
    thrust.learn(nonsense)
    assert thrust.hover_thrust == 0.4
    assert thrust.throttle(GRAVITY) == pytest.approx(0.4)


def test_the_configured_vehicles_map():
    vehicle = load_config(None, {"vehicle.hover_thrust": 0.3, "vehicle.hover_voltage": 11.0}).vehicle
    thrust = ThrustMap.of(vehicle)
    thrust.observe_voltage(10.0, 0.0)
    assert thrust.throttle(GRAVITY) == pytest.approx(0.3)
    thrust = ThrustMap.of(vehicle.model_copy(update={"battery_scale": True}))
    thrust.observe_voltage(10.0, 0.0)
    assert thrust.throttle(GRAVITY) == pytest.approx(0.3 * 1.21)


@pytest.mark.parametrize("voltage", [0.0, -1.0, math.nan, math.inf])
def test_a_reference_voltage_that_is_none_is_refused(voltage):
    with pytest.raises(ValueError, match="hover voltage must be"):
        ThrustMap(0.4, hover_voltage=voltage)
