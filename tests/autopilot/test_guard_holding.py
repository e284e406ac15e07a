"""What the guard does while sound commands are missing."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.guard import SETTLE, CommandGuard, GuardTrippedError, Refusal
from flightapp.autopilot.holding import Patience, holding_thrust
from flightapp.config import Config
from flightapp.frames import GRAVITY, quat_from_euler
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand, VehicleState

CONFIG = Config()
GUARD, VEHICLE = CONFIG.guard, CONFIG.vehicle
FLYING = AutopilotStatus(0.0, FlightMode.OFFBOARD, True, False, True, 16.0, 0.9)
TICK = 1.0 / CONFIG.control.rate
REST = np.zeros(3)
AS_LONG = int(GUARD.hold / TICK)
"""Ticks that the patience lasts."""


def state(stamp=0.0, roll=0.0, pitch=0.0):
    return VehicleState(stamp, REST, quat_from_euler(roll, pitch, 0.3), REST, REST, np.eye(9))


def sound(stamp):
    return RateCommand(stamp, np.zeros(3), GRAVITY)


class Sender:
    """Ticks of a sender whose controller fails when told."""

    def __init__(self, **status):
        self.guard, self.now = CommandGuard(CONFIG), 0.0
        self.status = replace(FLYING, **status)
        self.attitude = state()

    def tick(self, good, after=TICK, heard=True):
        """What is sent at the next tick; the autopilot is ``heard`` of just then."""
        self.now += after
        if heard and self.status is not None:
            self.status = replace(self.status, stamp=self.now)
        try:
            if not good:
                raise self.guard.refused(Refusal.NO_COMMAND, "ValueError: test")
            return self.guard.check(sound(self.now), self.now, self.status)
        except GuardTrippedError as error:
            held = replace(self.attitude, stamp=self.now)
            return self.guard.hold(error, self.now, self.status, held)

    def ticks(self, good, times, **options):
        return [self.tick(good, **options) for _ in range(times)]


def ending(sender, good=False, **options):
    with pytest.raises(GuardTrippedError) as caught:
        sender.tick(good, **options)
    return caught.value.refusal


def test_in_flight_the_attitude_is_held_and_then_the_autopilot_takes_over():
    sender = Sender()
    sender.ticks(True, 10)
    sent = sender.ticks(False, AS_LONG)
    assert all((command.rates == 0.0).all() and command.thrust == pytest.approx(GRAVITY) for command in sent)
    assert [command.stamp for command in sent] == pytest.approx(0.04 + TICK * np.arange(1, AS_LONG + 1))
    assert ending(sender) is Refusal.HANDED_OVER
    assert sender.guard.handed_over
    assert not sender.guard.taken_over
    assert (sender.guard.counts.held, sender.guard.counts.refused) == (AS_LONG, AS_LONG + 1)


def test_once_handed_over_nothing_passes_until_a_new_mission():
    sender = Sender()
    with pytest.raises(GuardTrippedError):
        sender.ticks(False, AS_LONG + 1)
    assert ending(sender, good=True) is Refusal.HANDED_OVER
    assert ending(sender, good=False) is Refusal.HANDED_OVER
    sender.guard.release()
    assert sender.tick(True).thrust == GRAVITY
    assert sender.tick(False).thrust == pytest.approx(GRAVITY)


def test_sound_commands_that_come_back_are_flown_and_one_line_tells():
    sender = Sender()
    sender.ticks(True, 5)
    sender.ticks(False, 3)
    reports = []
    for _ in range(100):
        assert sender.tick(True).stamp == sender.now
        reports.append(sender.guard.take_report())
    told = [report for report in reports if report]
    assert len(told) == 1
    assert told[0].startswith("3 commands refused within 0.008 s")
    assert "ValueError: test" in told[0]
    assert (sender.guard.counts.recovered, sender.guard.counts.held) == (1, 3)


def test_a_controller_that_fails_every_other_time_is_not_trusted_for_long():
    sender = Sender()
    with pytest.raises(GuardTrippedError) as caught:
        for tick in range(round(4.0 * GUARD.hold / TICK)):
            sender.tick(tick % 2 == 0)
    assert caught.value.refusal is Refusal.HANDED_OVER
    assert sender.now > 1.5 * GUARD.hold


def test_a_command_missing_now_and_then_is_no_reason_to_land():
    sender = Sender()
    for _ in range(200):
        sender.ticks(True, 24)
        sender.tick(False)
    assert not sender.guard.handed_over


@pytest.mark.parametrize("status", [{"landed": True}, {"armed": False}, {"mode": FlightMode.TAKEOFF}])
def test_where_the_autopilot_needs_no_help_nothing_is_sent_instead(status):
    sender = Sender(**status)
    assert sender.ticks(False, AS_LONG) == [None] * AS_LONG
    assert sender.guard.counts.held == 0
    assert ending(sender) is Refusal.HANDED_OVER


def test_before_any_status_nothing_is_sent():
    sender = Sender()
    sender.status = None
    assert sender.tick(True) is None
    assert sender.guard.counts.reasons == {Refusal.NO_STATUS: 1}


@pytest.mark.parametrize("good", [True, False])
def test_a_takeover_ends_all_at_once_also_while_holding(good):
    sender = Sender()
    sender.tick(True)
    sender.tick(False)
    sender.status = replace(sender.status, mode=FlightMode.POSITION)
    assert ending(sender, good) is Refusal.TAKEN_OVER
    assert sender.guard.taken_over
    sender.status = FLYING
    assert ending(sender, True) is Refusal.TAKEN_OVER


def test_a_silent_autopilot_is_held_for_and_then_left_alone():
    sender = Sender()
    sender.tick(True)
    passed = 0
    while (command := sender.tick(True, heard=False)).stamp == sender.now and not sender.guard.counts.held:
        passed += 1
        assert passed < 1000
    assert passed * TICK == pytest.approx(CONFIG.link.lost_after, abs=2.0 * TICK)
    assert command.thrust == pytest.approx(GRAVITY)
    sender.ticks(True, AS_LONG - 1, heard=False)
    assert ending(sender, True, heard=False) is Refusal.HANDED_OVER
    assert sender.guard.counts.reasons[Refusal.LINK_LOST] == AS_LONG + 1


def test_an_autopilot_heard_again_in_time_is_flown_on():
    sender = Sender()
    sender.ticks(True, round(CONFIG.link.lost_after / TICK) + 10, heard=False)
    assert sender.guard.counts.held
    assert sender.tick(True).thrust == GRAVITY


def test_after_a_stall_nothing_is_sent_before_the_mode_is_known_again():
    sender = Sender()
    sender.tick(True)
    assert sender.tick(True, after=0.4, heard=False) is None
    assert sender.tick(True) is None
    waiting = [sender.tick(True) for _ in range(round(SETTLE / TICK) - 2)]
    assert waiting == [None] * len(waiting)
    assert sender.ticks(True, 2)[-1].stamp == sender.now


def test_an_autopilot_that_left_offboard_during_a_stall_is_not_called_back():
    sender = Sender()
    sender.tick(True)
    assert sender.tick(True, after=0.4, heard=False) is None
    sender.status = replace(FLYING, mode=FlightMode.LAND)
    assert ending(sender, True) is Refusal.TAKEN_OVER


@pytest.mark.parametrize("mode", [FlightMode.OFFBOARD, FlightMode.LAND])
def test_after_a_stall_longer_than_offboard_lasts_the_autopilot_shall_land_at_once(mode):
    """Even where its failsafe has it land: a command that was on its way as the process stopped undoes that."""
    sender = Sender()
    sender.tick(True)
    sender.status = replace(FLYING, mode=mode)
    assert ending(sender, True, after=GUARD.stall + TICK) is Refusal.HANDED_OVER
    assert ending(sender, True) is Refusal.HANDED_OVER
    assert sender.guard.handed_over
    assert not sender.guard.taken_over
    sender.guard.release()
    sender.status = FLYING
    assert sender.tick(True).thrust == GRAVITY


def test_who_took_over_while_the_sender_stalled_keeps_the_vehicle():
    sender = Sender()
    sender.tick(True)
    sender.status = replace(FLYING, mode=FlightMode.POSITION)
    assert ending(sender, True, after=2.0 * GUARD.stall) is Refusal.TAKEN_OVER


def test_a_pause_in_which_nothing_was_wanted_is_no_stall():
    sender = Sender()
    sender.tick(True)
    sender.guard.rest()
    assert sender.tick(True, after=2.0 * GUARD.stall).thrust == GRAVITY


def test_a_stall_while_holding_is_the_end_of_the_patience():
    sender = Sender()
    sender.ticks(False, 2)
    assert ending(sender, after=0.4) is Refusal.HANDED_OVER


def test_when_no_commands_are_wanted_none_is_missing():
    sender = Sender()
    sender.ticks(False, AS_LONG)
    sender.guard.rest()
    assert sender.guard.take_report()
    sender.ticks(False, AS_LONG)
    assert not sender.guard.handed_over


def test_what_is_held_changes_no_faster_than_the_slew_limits():
    sender = Sender()
    sender.guard.check(RateCommand(0.0, np.array((6.0, -6.0, 3.0)), 30.0), 0.0, FLYING)
    held = sender.tick(False)
    turn = TICK * GUARD.rate_slew
    assert held.rates == pytest.approx((6.0 - turn, -6.0 + turn, 3.0 - turn))
    assert held.thrust == pytest.approx(30.0 - TICK * GUARD.thrust_slew)
    back = sender.guard.check(RateCommand(sender.now, np.array((6.0, -6.0, 3.0)), 30.0), sender.now, sender.status)
    assert back.rates == pytest.approx(held.rates)
    assert sender.tick(False).rates == pytest.approx((6.0 - 2.0 * turn, -6.0 + 2.0 * turn, 0.0))


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.5, 0.0), (0.0, -0.9), (0.6, 0.6)])
def test_the_thrust_held_keeps_the_height(roll, pitch):
    thrust = holding_thrust(state(0.0, roll, pitch), 0.0, 0.4, 30.0)
    assert thrust * math.cos(roll) * math.cos(pitch) == pytest.approx(GRAVITY)


@pytest.mark.parametrize(
    ("orientation", "thrust"),
    [
        (quat_from_euler(1.2, 0.0, 0.0), 20.0),
        (quat_from_euler(1.4, 0.0, 0.0), 0.0),
        (quat_from_euler(3.0, 0.0, 0.0), 0.0),
        (np.full(4, np.nan), GRAVITY),
        (np.array((np.inf, 0.0, 0.0, 0.0)), GRAVITY),
        (np.zeros(4), GRAVITY),
    ],
    ids=["steep", "steeper", "upside down", "nan", "infinite", "none"],
)
def test_what_is_held_in_an_attitude_that_is_no_good(orientation, thrust):
    held = replace(state(), orientation=orientation)
    assert holding_thrust(held, 0.0, 0.4, 20.0) == pytest.approx(thrust)


@pytest.mark.parametrize("stamp", [-0.41, 0.41, np.nan])
def test_a_stale_attitude_is_not_trusted(stamp):
    assert holding_thrust(state(stamp, roll=0.8), 0.0, 0.4, 30.0) == GRAVITY


def test_without_a_state_level_flight_is_held():
    assert holding_thrust(None, 0.0, 0.4, 30.0) == GRAVITY


@given(st.lists(st.booleans(), min_size=1, max_size=400))
def test_patience_lasts_no_longer_than_told_and_is_never_lost_on_sound_commands(sounds):
    patience, in_a_row = Patience(GUARD.hold, TICK), 0
    for tick, good in enumerate(sounds):
        now = tick * TICK
        if good:
            patience.sound(now)
            in_a_row = 0
            continue
        in_a_row += 1
        over = patience.refused(now, "test")
        if in_a_row * TICK > GUARD.hold + 1e-9:
            assert over
        if over:
            assert (tick + 1 - sum(sounds[: tick + 1])) * TICK > GUARD.hold - 1e-9
            return


@given(
    st.lists(
        st.tuples(st.booleans(), st.floats(-3.2, 3.2), st.floats(-1.5, 1.5), st.sampled_from((0.0, TICK, 0.1))),
        max_size=80,
    )
)
def test_whatever_is_held_is_finite_and_bounded(stream):
    sender = Sender()
    for good, roll, pitch, after in stream:
        sender.attitude = state(0.0, roll, pitch)
        try:
            command = sender.tick(good, after=after)
        except GuardTrippedError:
            return
        assert np.isfinite(command.rates).all()
        assert GUARD.thrust_min <= command.thrust <= VEHICLE.thrust_max
