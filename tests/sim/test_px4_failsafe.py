"""Failsafes with their times, pilots, batteries, reboots."""

import numpy as np
import pytest
from px4_bench import Px4Bench

from sim.px4.modes import NavState


@pytest.mark.parametrize("patience", [0.3, 0.5, 1.0])
def test_losing_the_setpoints_lands_without_waiting(patience):
    bench = Px4Bench(COM_OF_LOSS_T=patience).offboard()
    bench.stream = None
    took = bench.wait(lambda: bench.px4.nav_state is not NavState.OFFBOARD)
    assert patience - 0.021 < took < patience + 0.13
    assert bench.px4.nav_state is NavState.AUTO_LAND
    assert bench.px4.intention is NavState.OFFBOARD
    assert bench.px4.failsafe
    assert "Failsafe activated" in bench.texts
    bench.wait(lambda: not bench.px4.armed)
    assert bench.plant.on_ground


def test_setpoints_that_return_are_followed_again():
    bench = Px4Bench().offboard()
    bench.stream = None
    bench.wait(lambda: bench.px4.nav_state is NavState.AUTO_LAND)
    bench.stream = (0.0, 0.0, 0.0, bench.hover)
    assert bench.wait(lambda: bench.px4.nav_state is NavState.OFFBOARD) < 0.05
    assert not bench.px4.failsafe


def test_a_mode_chosen_during_a_failsafe_stays():
    bench = Px4Bench().offboard()
    bench.stream = None
    bench.wait(lambda: bench.px4.nav_state is NavState.AUTO_LAND)
    assert bench.px4.set_mode(NavState.AUTO_TAKEOFF).accepted
    bench.run(0.5)
    assert bench.px4.nav_state is NavState.AUTO_TAKEOFF
    assert not bench.px4.failsafe


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, NavState.AUTO_LAND), (3, NavState.AUTO_LAND), (4, NavState.AUTO_LAND), (5, NavState.AUTO_LAND)],
)
def test_what_cannot_run_falls_through_to_land(action, mode):
    bench = Px4Bench(COM_OBL_RC_ACT=action).offboard()
    bench.stream = None
    bench.run(0.8)
    assert bench.px4.nav_state is mode


def test_offboard_loss_may_hold_disarm_or_terminate():
    for action, origin in ((5, True), (7, False), (6, False)):
        bench = Px4Bench(COM_OBL_RC_ACT=action).offboard()
        if origin:
            bench.px4.set_global_origin()
        bench.stream = None
        bench.run(0.8)
        assert bench.px4.armed == (action == 5)
        assert (bench.px4.nav_state is NavState.AUTO_LOITER) == (action == 5)
    assert bench.px4.nav_state is NavState.TERMINATION
    assert not bench.px4.set_mode(NavState.AUTO_TAKEOFF).accepted


def test_losing_vision_in_takeoff_ends_in_a_descent():
    bench = Px4Bench().hovering()
    bench.seeing = False
    took = bench.wait(lambda: bench.px4.nav_state is not NavState.AUTO_TAKEOFF)
    assert 5.35 < took < 5.6
    assert bench.px4.nav_state is NavState.DESCEND
    assert not bench.px4.ready
    bench.wait(lambda: not bench.px4.armed)
    assert bench.plant.on_ground


def test_without_any_height_a_descent_comes_down_but_never_notices():
    bench = Px4Bench(EKF2_BARO_CTRL=0).hovering()
    bench.seeing = False
    bench.wait(lambda: bench.px4.nav_state is NavState.DESCEND)
    falling = 0.0
    while not bench.plant.on_ground:
        falling = bench.plant.velocity[2]
        bench.run(0.02)
    assert -2.0 < falling < -0.3
    bench.run(5.0)
    assert bench.px4.armed
    assert bench.px4.kill().accepted


def test_offboard_with_body_rates_outlives_the_position():
    bench = Px4Bench().offboard()
    bench.seeing = False
    bench.wait(lambda: not bench.px4.ready)
    assert bench.px4.nav_state is NavState.OFFBOARD
    bench.stream = None
    bench.run(0.8)
    assert bench.px4.nav_state is NavState.DESCEND


def test_without_any_height_only_lasting_low_thrust_counts_as_landed():
    bench = Px4Bench(COM_DISARM_PRFLT=3.0, EKF2_BARO_CTRL=0)
    bench.seeing = False
    bench.px4.set_mode(NavState.OFFBOARD)
    bench.stream = (0.0, 0.0, 0.0, 0.5 * bench.hover)
    bench.run(0.2)
    assert bench.px4.arm().accepted
    bench.run(5.0)
    assert not bench.px4.on_ground
    bench.stream = (0.0, 0.0, 0.0, 0.0)
    # Three looks that must last, of which there are ten in a second while setpoints are followed.
    assert bench.wait(lambda: bench.px4.on_ground) == pytest.approx(8.0 + 2.0 / 3.0, abs=0.3)
    assert bench.wait(lambda: not bench.px4.armed) == pytest.approx(1.0, abs=0.15)


def test_vision_that_returns_ends_the_descent():
    bench = Px4Bench().hovering()
    bench.px4.plant._state[2] = 8.0
    bench.run(3.0)
    bench.seeing = False
    bench.wait(lambda: bench.px4.nav_state is NavState.DESCEND)
    bench.seeing = True
    assert 1.0 < bench.wait(lambda: bench.px4.nav_state is NavState.AUTO_TAKEOFF) < 1.3


def test_a_pilot_takes_over_and_setpoints_do_nothing():
    bench = Px4Bench().offboard()
    assert bench.px4.pilot(NavState.POSCTL).accepted
    assert bench.px4.nav_state is NavState.POSCTL
    bench.stream = (3.0, 0.0, 0.0, bench.hover)
    bench.run(3.0)
    assert bench.px4.nav_state is NavState.POSCTL
    assert np.linalg.norm(bench.plant.velocity) < 0.3


@pytest.mark.parametrize("mode", [NavState.ALTCTL, NavState.STAB, NavState.MANUAL, NavState.ACRO, NavState.AUTO_LAND])
def test_a_pilot_may_have_any_mode_that_runs(mode):
    bench = Px4Bench().offboard()
    assert bench.px4.pilot(mode).accepted
    height = bench.plant.position[2]
    bench.run(1.0)
    assert bench.px4.nav_state is mode
    assert bench.px4.armed
    lowest = -0.9 if mode is NavState.AUTO_LAND else -0.4
    assert lowest < bench.plant.position[2] - height < 0.5


def test_a_pilot_who_is_lost_matters_only_with_sticks_enabled():
    for sticks, mode in ((4, NavState.POSCTL), (0, NavState.AUTO_LAND)):
        bench = Px4Bench(COM_RC_IN_MODE=sticks, NAV_RCL_ACT=3).hovering()
        bench.px4.pilot(NavState.POSCTL)
        bench.run(0.5)
        bench.px4.lose_pilot()
        bench.run(0.5)
        assert bench.px4.nav_state is mode


@pytest.mark.parametrize(
    ("setting", "mode"), [(0, NavState.OFFBOARD), (2, NavState.AUTO_LAND), (3, NavState.AUTO_LAND)]
)
def test_a_critical_battery_warns_or_lands(setting, mode):
    bench = Px4Bench(COM_LOW_BAT_ACT=setting).offboard()
    bench.px4.fail_battery()
    bench.run(0.3)
    assert bench.px4.battery < 0.07
    assert bench.px4.failsafe
    assert bench.px4.nav_state is mode
    assert {"Critical battery", "Failsafe activated"} <= set(bench.texts)


def test_where_hold_can_run_a_battery_failsafe_waits_in_it():
    bench = Px4Bench(COM_LOW_BAT_ACT=2, COM_FAIL_ACT_T=3.0).offboard()
    bench.px4.set_global_origin()
    bench.run(0.2)
    bench.px4.fail_battery()
    bench.run(0.3)
    assert bench.px4.nav_state is NavState.AUTO_LOITER
    assert bench.wait(lambda: bench.px4.nav_state is NavState.AUTO_LAND) == pytest.approx(2.8, abs=0.3)
    assert any(text.startswith("Failsafe activated, entering Hold for 3 seconds") for text in bench.texts)


def test_the_user_may_take_over_from_a_battery_failsafe():
    bench = Px4Bench(COM_LOW_BAT_ACT=2).offboard()
    bench.px4.fail_battery()
    bench.wait(lambda: bench.px4.nav_state is NavState.AUTO_LAND)
    assert bench.px4.set_mode(NavState.OFFBOARD).accepted
    bench.run(0.3)
    assert bench.px4.nav_state is NavState.OFFBOARD
    assert bench.px4.failsafe


def test_an_empty_battery_is_not_armed_with():
    bench = Px4Bench().prepared()
    bench.px4.fail_battery()
    bench.run(0.2)
    bench.px4.takeoff()
    assert "Critical battery" in bench.px4.arm().text


def test_a_reboot_in_flight_drops_everything_but_parameters():
    bench = Px4Bench(COM_OF_LOSS_T=0.7).offboard()
    bench.px4.reboot()
    assert bench.px4.booting
    assert not bench.px4.armed
    assert not bench.px4.arm().accepted
    bench.run(2.9)
    assert bench.px4.booting
    assert not bench.px4.ready
    assert np.all(bench.plant.rotor_speeds == 0.0)
    assert bench.wait(lambda: not bench.px4.booting) < 0.2
    assert bench.px4.nav_state is NavState.AUTO_LOITER
    assert bench.px4.parameters["COM_OF_LOSS_T"] == 0.7
    assert 1.0 < bench.wait(lambda: bench.px4.ready) < 1.3
    bench.stream = None
    bench.hovering()


def test_a_crash_is_for_good():
    bench = Px4Bench().hovering()
    bench.px4.crash()
    bench.px4.refuse_arming(None)
    bench.run(2.0)
    assert bench.plant.on_ground
    assert "motor failure" in bench.px4.arm().text


def test_two_flights_with_one_seed_are_the_same():
    ends = [Px4Bench(seed=4).offboard().plant.state_at(7.0) for _ in range(2)]
    assert np.array_equal(ends[0], ends[1])
