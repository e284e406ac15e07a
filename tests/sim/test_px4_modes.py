"""Modes, arming and their refusals."""

import numpy as np
import pytest
from px4_bench import Px4Bench

from sim.px4.modes import Landed, NavState, Need, Result
from sim.px4.parameters import ACTING, Parameters

CHOOSABLE = [mode for mode in NavState if mode not in (NavState.DESCEND, NavState.TERMINATION)]


@pytest.mark.parametrize(
    ("mode", "main", "sub"),
    [
        (NavState.MANUAL, 1, 0),
        (NavState.ALTCTL, 2, 0),
        (NavState.POSCTL, 3, 0),
        (NavState.AUTO_TAKEOFF, 4, 2),
        (NavState.AUTO_LOITER, 4, 3),
        (NavState.AUTO_MISSION, 4, 4),
        (NavState.AUTO_RTL, 4, 5),
        (NavState.AUTO_LAND, 4, 6),
        (NavState.ACRO, 5, 0),
        (NavState.OFFBOARD, 6, 0),
        (NavState.STAB, 7, 0),
    ],
)
def test_modes_have_px4s_codes(mode, main, sub):
    assert mode.custom_mode == (main, sub)
    assert NavState.from_custom_mode(main, sub) is mode


def test_codes_that_px4_does_not_know_mean_no_mode():
    assert NavState.from_custom_mode(4, 99) is None
    assert NavState.from_custom_mode(0, 0) is None
    assert NavState.from_custom_mode(4, 0) is NavState.AUTO_MISSION
    assert NavState.from_custom_mode(6, 5) is NavState.OFFBOARD
    assert NavState.DESCEND.custom_mode == NavState.AUTO_LAND.custom_mode


def test_only_takeoff_offboard_and_land_can_be_had_indoors():
    bench = Px4Bench().hovering()
    bench.stream = (0.0, 0.0, 0.0, bench.hover)
    bench.run(0.1)
    accepted = set()
    for mode in CHOOSABLE:
        reply = bench.px4.set_mode(mode)
        assert reply.result in (Result.ACCEPTED, Result.TEMPORARILY_REJECTED)
        assert reply.accepted or reply.text.startswith(f"Switching to {mode.label} is currently not available: ")
        accepted |= {mode} if reply.accepted else set()
    assert accepted == {NavState.AUTO_TAKEOFF, NavState.AUTO_LAND, NavState.OFFBOARD}


def test_a_refused_mode_changes_nothing():
    bench = Px4Bench().hovering()
    assert "global position" in bench.px4.set_mode(NavState.AUTO_LOITER).text
    assert "manual control" in bench.px4.set_mode(NavState.POSCTL).text
    assert "No offboard signal" in bench.px4.set_mode(NavState.OFFBOARD).text
    assert bench.px4.nav_state is bench.px4.intention is NavState.AUTO_TAKEOFF


@pytest.mark.parametrize("mode", CHOOSABLE)
def test_disarmed_any_mode_may_be_intended(mode):
    bench = Px4Bench()
    assert bench.px4.set_mode(mode).accepted
    assert bench.px4.nav_state is mode


def test_it_boots_in_hold_which_cannot_be_armed_indoors():
    bench = Px4Bench().prepared()
    assert bench.px4.nav_state is NavState.AUTO_LOITER
    assert not bench.px4.armable
    reply = bench.px4.arm()
    assert reply.result is Result.TEMPORARILY_REJECTED
    assert "Arming denied: Resolve system health failures first" in reply.text
    assert "global position" in reply.text
    bench.run(0.02)
    assert "Arming denied: Resolve system health failures first" in bench.texts


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        (NavState.AUTO_LAND, "Mode not suitable for arming"),
        (NavState.OFFBOARD, "No offboard signal"),
        (NavState.POSCTL, "No manual control input"),
        (NavState.AUTO_MISSION, "No valid mission available"),
        (NavState.AUTO_RTL, "Home position not set"),
    ],
)
def test_modes_that_cannot_run_cannot_be_armed_in(mode, why):
    bench = Px4Bench().prepared()
    bench.px4.set_mode(mode)
    assert why in bench.px4.arm().text
    assert not bench.px4.armed


def test_a_failed_check_is_told_and_once_it_passes_the_vehicle_arms():
    bench = Px4Bench().prepared()
    bench.px4.takeoff()
    bench.px4.refuse_arming("Gyro 0 missing")
    assert "Gyro 0 missing" in bench.px4.arm().text
    bench.run(0.02)
    assert "Preflight Fail: Gyro 0 missing" in bench.texts
    bench.px4.refuse_arming(None)
    assert bench.px4.arm().accepted


def test_without_a_gps_fix_that_is_asked_for_it_does_not_arm():
    bench = Px4Bench(EKF2_GPS_CTRL=7, COM_ARM_WO_GPS=0).prepared()
    bench.px4.takeoff()
    assert "GPS fix too low" in bench.px4.arm().text
    bench.px4.parameters.set("COM_ARM_WO_GPS", 1)
    assert bench.px4.arm().accepted


def test_without_vision_there_is_no_takeoff():
    bench = Px4Bench()
    bench.seeing = False
    bench.run(5.0)
    assert not bench.px4.ready
    assert bench.px4.takeoff().accepted
    assert "local position" in bench.px4.arm().text


def test_it_is_ready_a_second_after_vision_begins():
    bench = Px4Bench()
    assert 1.0 < bench.wait(lambda: bench.px4.ready) < 1.25


def test_a_takeoff_climbs_to_its_height_and_stays_in_its_mode():
    bench = Px4Bench(MIS_TAKEOFF_ALT=1.4).prepared()
    assert bench.px4.takeoff().accepted
    bench.run(1.0)
    assert not bench.px4.armed
    assert bench.plant.on_ground
    assert bench.px4.arm().accepted
    assert bench.px4.landed is Landed.ON_GROUND
    bench.run(0.9)
    assert bench.plant.on_ground
    bench.run(5.0)
    assert bench.px4.nav_state is NavState.AUTO_TAKEOFF
    assert bench.px4.landed is Landed.TAKEOFF
    assert bench.plant.position[2] == pytest.approx(1.4, abs=0.2)
    bench.run(10.0)
    assert bench.px4.nav_state is NavState.AUTO_TAKEOFF
    assert np.linalg.norm(bench.plant.position - (0.0, 0.0, 1.4)) < 0.35
    assert {"Armed by external command", "Using default takeoff altitude: 1.4 m", "Takeoff detected"} <= set(
        bench.texts
    )


def test_without_a_global_position_a_takeoff_leads_over_the_local_origin():
    bench = Px4Bench(MIS_TAKEOFF_ALT=1.4)
    bench.offset[:] = (2.0, -1.0, 0.3)  # where the vehicle stands in the tracker's frame
    bench.prepared()
    assert bench.px4.takeoff().accepted
    assert bench.px4.arm().accepted
    bench.run(12.0)
    np.testing.assert_allclose(bench.plant.position + bench.offset, (0.0, 0.0, 1.4), atol=0.1)


def test_with_a_global_origin_a_takeoff_ends_in_hold():
    bench = Px4Bench().prepared()
    bench.px4.set_global_origin()
    bench.hovering()
    assert bench.px4.nav_state is NavState.AUTO_LOITER
    assert bench.px4.landed is Landed.IN_AIR


def test_landing_disarms_into_the_mode_before():
    bench = Px4Bench().hovering()
    assert bench.px4.land().accepted
    assert bench.px4.landed is Landed.LANDING
    bench.wait(lambda: bench.px4.on_ground)
    assert bench.px4.armed
    took = bench.wait(lambda: not bench.px4.armed)
    assert 0.9 < took < 1.1
    assert bench.px4.nav_state is NavState.AUTO_TAKEOFF
    assert bench.plant.on_ground
    assert {"Landing at current position", "Landing detected", "Disarmed by landing"} <= set(bench.texts)


@pytest.mark.parametrize(("patience", "expected"), [(3.0, 3.0), (0.5, 0.5)])
def test_armed_on_the_ground_it_disarms_by_itself(patience, expected):
    bench = Px4Bench(COM_DISARM_PRFLT=patience).prepared()
    bench.px4.set_mode(NavState.OFFBOARD)
    bench.stream = (0.0, 0.0, 0.0, 0.0)
    bench.run(0.2)
    assert bench.px4.arm().accepted
    assert bench.wait(lambda: not bench.px4.armed) == pytest.approx(expected, abs=0.15)
    assert "Disarmed by auto preflight disarming" in bench.texts


def test_it_disarms_in_flight_only_when_forced():
    bench = Px4Bench().hovering()
    reply = bench.px4.disarm()
    assert reply.result is Result.TEMPORARILY_REJECTED
    assert reply.text == "Disarming denied: not landed"
    assert bench.px4.armed
    assert bench.px4.kill().accepted
    assert not bench.px4.armed
    bench.run(2.0)
    assert bench.plant.on_ground
    assert np.all(bench.plant.rotor_speeds == 0.0)


def test_a_setpoint_acts_after_the_delay_and_only_in_offboard():
    bench = Px4Bench(name="limits").hovering()
    bench.stream = (3.0, 0.0, 0.0, bench.hover)
    bench.run(0.3)
    assert abs(bench.plant.angular_velocity[0]) < 0.5
    bench.stream = (0.0, 0.0, 0.0, bench.hover)
    bench.px4.set_mode(NavState.OFFBOARD)
    bench.run(0.2)
    sent = bench.now
    bench.stream = (3.0, 0.0, 0.0, bench.hover)
    bench.run(0.1)
    quiet = abs(bench.plant.state_at(sent)[11])
    delay = bench.plant.vehicle.delay
    assert abs(bench.plant.state_at(sent + delay - 0.002)[11]) < quiet + 0.05
    assert bench.plant.state_at(sent + delay + 0.03)[11] > quiet + 0.5


def test_an_attitude_setpoint_is_followed():
    bench = Px4Bench().offboard()
    bench.stream = None
    tilted = np.array((np.cos(0.1), 0.0, np.sin(0.1), 0.0))
    for _ in range(40):
        bench.px4.attitude_setpoint(tilted, bench.hover)
        bench.run(0.02)
    assert bench.px4.nav_state is NavState.OFFBOARD
    assert abs(bench.plant.orientation @ tilted) == pytest.approx(1.0, abs=2e-3)


def test_one_setpoint_is_enough_to_enter_offboard_at_once():
    bench = Px4Bench().hovering()
    bench.px4.attitude_target((0.0, 0.0, 0.0), bench.hover)
    assert bench.px4.set_mode(NavState.OFFBOARD).accepted


def test_parameters_keep_their_types():
    parameters = Parameters({"MAV_SYS_ID": 1})
    with pytest.raises(TypeError, match="COM_OF_LOSS_T is float"):
        parameters.set("COM_OF_LOSS_T", 1)
    with pytest.raises(TypeError, match="MAV_SYS_ID is int"):
        parameters.set("MAV_SYS_ID", 1.0)
    with pytest.raises(KeyError):
        parameters.set("NO_SUCH", 1)
    parameters.set("MAV_SYS_ID", 2)
    assert parameters["MAV_SYS_ID"] == 2
    assert parameters.version == 1
    parameters.add({"MAV_SYS_ID": 7, "MAV_TYPE": 2})
    assert (parameters["MAV_SYS_ID"], parameters["MAV_TYPE"]) == (2, 2)
    assert set(ACTING) < set(parameters)


def test_every_mode_says_what_it_needs():
    assert NavState.AUTO_TAKEOFF.needs == Need.LOCAL_POSITION | Need.LOCAL_ALTITUDE
    assert NavState.OFFBOARD.needs == Need.OFFBOARD_SIGNAL
    assert Need.GLOBAL_POSITION in NavState.AUTO_LOITER.needs
    assert Need.MANUAL_CONTROL in NavState.STAB.needs
    assert NavState.DESCEND.needs == Need.NO_ARMING
