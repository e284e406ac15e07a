from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.guard import SETTLE, CommandGuard, GuardTrippedError, Refusal
from flightapp.config import Config
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand, VehicleState

CONFIG = Config()
VEHICLE, GUARD, LINK = CONFIG.vehicle, CONFIG.guard, CONFIG.link
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
    late = guard.check(command((5.0, -5.0, 0.0), 25.0, stamp=0.2), 0.2, FLYING)
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


@pytest.mark.parametrize("stamp", [np.nan, np.inf, -np.inf, -LINK.lost_after - 0.01, LINK.lost_after + 0.01])
def test_a_status_that_is_old_or_of_no_time_is_no_status(stamp):
    guard = CommandGuard(CONFIG)
    assert refusal(guard, command(), 0.0, replace(FLYING, stamp=stamp)) is Refusal.LINK_LOST
    assert guard.counts.reasons == {Refusal.LINK_LOST: 1}


def test_a_takeover_told_by_an_old_status_is_a_takeover():
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, FLYING)
    assert refusal(guard, command(stamp=2.0), 2.0, replace(WAITING, stamp=0.1)) is Refusal.TAKEN_OVER


@pytest.mark.parametrize("stamp", [np.nan, -CONFIG.safety.state_timeout - 0.01, CONFIG.safety.state_timeout + 0.01])
def test_an_old_state_is_no_ground_for_a_command(stamp):
    guard = CommandGuard(CONFIG)
    state = VehicleState(stamp, np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3), np.zeros(3), np.eye(9))
    with pytest.raises(GuardTrippedError) as caught:
        guard.check_state(state, 0.0)
    assert caught.value.refusal is Refusal.STATE_OLD
    assert guard.counts.reasons == {Refusal.STATE_OLD: 1}
    guard.check_state(replace(state, stamp=0.0), 0.2)


def test_after_a_stall_the_autopilot_must_be_heard_anew():
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, FLYING)
    during = replace(FLYING, stamp=0.39)
    assert refusal(guard, command(stamp=0.4), 0.4, during) is Refusal.STALLED
    waited = replace(FLYING, stamp=0.4 + 0.5 * SETTLE)
    assert refusal(guard, command(stamp=0.404), 0.404, waited) is Refusal.STALLED
    anew = replace(FLYING, stamp=0.4 + SETTLE)
    assert guard.check(command(stamp=0.43), 0.43, anew).stamp == 0.43


def test_a_short_stall_needs_no_new_status():
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, FLYING)
    pause = 0.9 * (GUARD.late + GUARD.hold)
    assert guard.check(command(stamp=pause), pause, FLYING).stamp == pause


def test_what_pauses_before_offboard_is_no_stall():
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, WAITING)
    assert guard.check(command(stamp=0.9), 0.9, WAITING).stamp == 0.9


def test_a_stall_at_the_beginning_of_offboard_is_one():
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, WAITING)
    assert refusal(guard, command(stamp=0.7), 0.7, replace(FLYING, stamp=0.01)) is Refusal.STALLED


def test_refusals_are_counted_by_reason():
    guard = CommandGuard(CONFIG)
    for bad in (command((np.nan,) * 3), command(thrust=np.nan), command(stamp=-1.0)):
        refusal(guard, bad, 0.0, FLYING)
    assert guard.counts.reasons == {Refusal.NOT_FINITE: 2, Refusal.STALE: 1}
    assert guard.counts.refused == 3


def test_a_takeover_is_noticed_even_with_a_bad_command():
    guard = CommandGuard(CONFIG)
    guard.check(command(), 0.0, FLYING)
    assert refusal(guard, command((np.nan,) * 3), 0.0, WAITING) is Refusal.TAKEN_OVER
    assert guard.taken_over
