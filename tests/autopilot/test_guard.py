from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.guard import CommandGuard, GuardTrippedError, Refusal
from flightapp.config import Config
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand

CONFIG = Config()
VEHICLE, GUARD = CONFIG.vehicle, CONFIG.guard
FLYING = AutopilotStatus(0.0, FlightMode.OFFBOARD, True, False, True, 16.0, 0.9)
WAITING = replace(FLYING, mode=FlightMode.HOLD)
anything = st.floats(allow_nan=True, allow_infinity=True)


def command(rates=(0.0, 0.0, 0.0), thrust=9.8, stamp=0.0):
    return RateCommand(stamp, np.array(rates, float), thrust)


def refusal(guard, *args):
    with pytest.raises(GuardTrippedError) as caught:
        guard.check(*args)
    return caught.value.refusal


def test_a_good_command_passes_untouched():
    guard, good = CommandGuard(CONFIG), command((1.0, -1.0, 0.5))
    assert guard.check(good, 0.001, FLYING) is good
    assert (guard.counts.passed, guard.counts.clipped, guard.counts.refused) == (1, 0, 0)


@given(st.lists(st.tuples(st.tuples(anything, anything, anything), anything, anything, st.floats(0.0, 10.0))))
def test_whatever_comes_in_what_goes_out_is_finite_and_bounded(stream):
    guard, sent = CommandGuard(CONFIG), 0
    for rates, thrust, stamp, now in stream:
        try:
            out = guard.check(RateCommand(stamp, np.array(rates), thrust), now, FLYING)
        except GuardTrippedError:
            continue
        sent += 1
        assert np.isfinite(out.rates).all()
        assert (np.abs(out.rates) <= (VEHICLE.rate_max, VEHICLE.rate_max, VEHICLE.yaw_rate_max)).all()
        assert GUARD.thrust_min <= out.thrust <= VEHICLE.thrust_max
        assert now - out.stamp <= GUARD.late
    assert guard.counts.passed == sent
    assert guard.counts.refused == len(stream) - sent


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (command((np.nan, 0.0, 0.0)), Refusal.NOT_FINITE),
        (command(thrust=np.inf), Refusal.NOT_FINITE),
        (command(stamp=np.nan), Refusal.NOT_FINITE),
        (command(stamp=-GUARD.late - 0.01), Refusal.STALE),
        (command(stamp=GUARD.late + 0.01), Refusal.STALE),
        (command((0.0, 0.0)), Refusal.MALFORMED),
        (RateCommand(0.0, None, 9.8), Refusal.MALFORMED),
        (RateCommand(0.0, np.zeros((3, 2)), 9.8), Refusal.MALFORMED),
    ],
)
def test_what_cannot_be_made_safe_is_refused_with_the_reason(bad, reason):
    guard = CommandGuard(CONFIG)
    assert refusal(guard, bad, 0.0, FLYING) is reason
    assert guard.counts.refused == 1
    assert guard.check(command(), 0.0, FLYING).thrust == 9.8


def test_bounds_hold_and_are_counted():
    guard = CommandGuard(CONFIG)
    out = guard.check(command((99.0, -99.0, 99.0), 999.0), 0.0, FLYING)
    assert tuple(out.rates) == (VEHICLE.rate_max, -VEHICLE.rate_max, VEHICLE.yaw_rate_max)
    assert out.thrust == VEHICLE.thrust_max
    assert guard.counts.clipped == 1


@pytest.mark.parametrize(("status", "least"), [(FLYING, GUARD.thrust_min), (replace(FLYING, landed=True), 0.0)])
def test_thrust_is_never_cut_in_flight(status, least):
    assert CommandGuard(CONFIG).check(command(thrust=-5.0), 0.0, status).thrust == least


def test_commands_change_no_faster_than_the_slew_limits():
    guard = CommandGuard(CONFIG)
    guard.check(command(thrust=5.0), 0.0, FLYING)
    out = guard.check(command((5.0, -5.0, 0.0), 25.0, stamp=0.004), 0.004, FLYING)
    assert out.rates == pytest.approx((0.004 * GUARD.rate_slew, -0.004 * GUARD.rate_slew, 0.0))
    assert out.thrust == pytest.approx(5.0 + 0.004 * GUARD.thrust_slew)
    late = guard.check(command((5.0, -5.0, 0.0), 25.0, stamp=1.0), 1.0, FLYING)
    assert (tuple(late.rates), late.thrust) == ((5.0, -5.0, 0.0), 25.0)


def test_commands_pass_before_offboard_but_not_without_knowing_the_mode():
    guard = CommandGuard(CONFIG)
    assert guard.check(command(), 0.0, WAITING).thrust == 9.8
    assert refusal(guard, command(), 0.0, None) is Refusal.NO_STATUS
    assert not guard.taken_over


@pytest.mark.parametrize(
    "after", [*(replace(FLYING, mode=mode) for mode in FlightMode if mode is not FlightMode.OFFBOARD)], ids=str
)
def test_once_another_hand_took_over_nothing_passes_until_a_new_mission(after):
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, FLYING)
    assert refusal(guard, command(), 0.0, after) is Refusal.TAKEN_OVER
    assert refusal(guard, command(), 0.0, FLYING) is Refusal.TAKEN_OVER
    assert guard.taken_over
    guard.release()
    assert not guard.taken_over
    assert guard.check(command(), 0.0, after).thrust == 9.8


def test_disarming_in_flight_is_a_takeover_but_offboard_before_arming_is_not():
    guard, disarmed = CommandGuard(CONFIG), replace(FLYING, armed=False)
    guard.check(command(), 0.0, disarmed)
    guard.check(command(), 0.0, FLYING)
    assert refusal(guard, command(), 0.0, disarmed) is Refusal.TAKEN_OVER


def test_a_takeover_is_noticed_even_with_a_bad_command():
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, FLYING)
    assert refusal(guard, command((np.nan,) * 3), 0.0, WAITING) is Refusal.TAKEN_OVER
    assert guard.taken_over
