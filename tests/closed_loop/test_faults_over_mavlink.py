"""Faults of the link, the vehicle, the tracker and the application itself, over real MAVSDK on the wall clock.

Each flight is judged by the world's truth; what the application did about it, by its log, its last words and its exit
status.
"""

import signal
import time

import numpy as np
import pytest
from outside import Flight

pytestmark = pytest.mark.wall_clock

OFFBOARD_LOSS = 0.5
"""s without a setpoint after which PX4 lands (COM_OF_LOSS_T)."""
ALLOWANCE = 0.5
"""s that a busy computer may add to a reaction."""
LOST_AFTER, HOLD, TICK = 1.0, 0.15, 0.004
"""s, of link.lost_after, guard.hold and control.rate."""
COAST, STATE_TIMEOUT = 0.5, 0.25
"""s, of estimation.coast and safety.state_timeout."""
STALL = """
await drone.hover(1.0)
begin = time.monotonic()
ctypes.PyDLL(None).usleep({microseconds})
say("stall", begin, time.monotonic())
await drone.hover(2.0)
"""
IN_HAND = """
from mavsdk.plugins.mavlink_direct import MavlinkDirect
await drone.hover(1.0)
hand_on = MavlinkDirect.send_message
def stopped(direct, message):
    if message.message_name == "SET_ATTITUDE_TARGET":
        MavlinkDirect.send_message = hand_on
        begin = time.monotonic()
        ctypes.PyDLL(None).usleep(1_200_000)
        say("stall", begin, time.monotonic())
    return hand_on(direct, message)
MavlinkDirect.send_message = stopped
await drone.hover(10.0)
"""
FAILING = """
def failing(controller, stamp, state, trajectory):
    {how}
FlatnessController.command = failing
say("failing", time.monotonic())
await drone.hover(10.0)
"""
RECOVERING = """
for how in ("raise", "nan", "late"):
    until = time.monotonic() + 0.05
    def failing(controller, stamp, state, trajectory):
        command = controlled(controller, stamp, state, trajectory)
        if time.monotonic() > until:
            return command
        if how == "raise":
            raise IndexError("out of range")
        if how == "late":
            time.sleep(0.12)
        if how == "nan":
            command.rates[:] = float("nan")
        return command
    FlatnessController.command = failing
    await drone.hover(1.0)
"""


# Before the flight.


def test_an_autopilot_that_never_appears(tmp_path):
    with Flight(tmp_path, settings=["link.connect_timeout=2.0"], faults=[(0.0, "silence", 300.0)]) as flight:
        assert flight.ended() == 1
        assert "PROCESS_FAILURE" in flight.text()
        assert "no autopilot with system id 1 on udpin://127.0.0.1:" in flight.text()
        assert "within 2 s; nothing at all was heard there" in flight.text()
        assert not flight.statistics().count


def test_arming_that_is_refused_is_reported_with_the_autopilots_reason(tmp_path):
    with Flight(tmp_path, faults=[(0.0, "refuse_arming", "Compass 0 missing")]) as flight:
        assert flight.ended() == 1
        assert "PROCESS_FAILURE: takeoff: " in flight.text()
        assert "arming refused: " in flight.text()
        assert "Compass 0 missing" in flight.text().split("PROCESS_FAILURE: takeoff: ")[-1]
        assert not any(moment.armed for moment in flight.moments)


def test_without_the_parameter_of_the_takeoff_height_there_is_no_takeoff(tmp_path):
    with Flight(tmp_path, faults=[(0.0, "missing", "MIS_TAKEOFF_ALT")]) as flight:
        assert flight.ended() == 1
        assert "PROCESS_FAILURE: takeoff: PROCESS_FAILURE: ParameterMissingError: " in flight.text()
        assert "parameter MIS_TAKEOFF_ALT could not be set to 1.0: the autopilot has none" in flight.text()
        assert not any(moment.armed for moment in flight.moments)


@pytest.mark.soak
def test_a_reboot_on_the_ground_is_waited_for(tmp_path):
    with Flight(tmp_path, "await drone.hover(1.0)", prelude="import asyncio\nawait asyncio.sleep(5.5)") as flight:
        flight.until(lambda: flight.statistics().messages.get("ODOMETRY", 0) > 40)
        flight.fault("reboot")
        assert flight.ended() == 0, flight.text()
        assert "the autopilot has rebooted" in flight.events()
        flight.assert_safe()


# The link and the vehicle.


def test_a_link_that_is_lost_and_comes_back(tmp_path):
    with Flight(tmp_path) as flight:
        lost = flight.flying().fault("silence", 1.5)
        asked = flight.statistics().messages["COMMAND_LONG"]
        assert flight.until_event("link lost") - lost < LOST_AFTER + ALLOWANCE
        assert flight.ended() == 1
        flight.assert_safe()
        assert flight.mode_since("AUTO_LAND", lost) < OFFBOARD_LOSS + ALLOWANCE
        assert flight.mode_since("OFFBOARD", lost + OFFBOARD_LOSS + ALLOWANCE) == np.inf, "the landing is not undone"
        seen = flight.statistics()
        assert seen.last - lost < LOST_AFTER + HOLD + ALLOWANCE
        assert seen.messages["COMMAND_LONG"] > asked, "the landing is asked for"
        assert "link lost is over" in flight.events()
        assert "PROCESS_FAILURE: link lost: nothing heard of the autopilot" in flight.text()


def test_a_pilot_who_takes_over_is_left_alone(tmp_path):
    with Flight(tmp_path) as flight:
        taken = flight.flying().fault("pilot", "Position")
        flight.until_event("taken over")
        before = flight.statistics()
        time.sleep(2.0)
        assert flight.process.poll() is None, "it goes on recording"
        flight.fault("pilot", "Land")
        assert flight.ended() == 1
        flight.assert_safe()
        seen = flight.statistics()
        assert seen.last - taken < 0.15
        assert seen.count == before.count
        assert seen.messages["COMMAND_LONG"] == before.messages["COMMAND_LONG"], "nothing is asked for"
        assert seen.messages["ODOMETRY"] > before.messages["ODOMETRY"] + 40, "the pilot's position mode needs it"
        assert {m.mode for m in flight.moments if taken + 0.1 < m.stamp} == {"POSCTL", "AUTO_LAND"}
        assert "PROCESS_FAILURE: pilot takeover: the vehicle was taken over: mode position" in flight.text()


@pytest.mark.soak
def test_a_pilot_who_takes_over_in_the_climb_is_left_alone(tmp_path):
    with Flight(tmp_path) as flight:
        flight.until(lambda: flight.now.height > 0.4)
        before = flight.statistics()
        taken = flight.fault("pilot", "Position")
        flight.until_event("a pilot flies: mode position")
        time.sleep(1.0)
        flight.fault("pilot", "Land")
        assert flight.ended() == 1
        flight.assert_safe()
        seen = flight.statistics()
        assert seen.messages["COMMAND_LONG"] == before.messages["COMMAND_LONG"]
        assert not seen.count
        assert {m.mode for m in flight.moments if taken + 0.1 < m.stamp} == {"POSCTL", "AUTO_LAND"}
        assert "WRONG_PROGRESS: takeoff: WRONG_PROGRESS: the autopilot left the climb" in flight.text()


def test_an_autopilot_that_reboots_in_flight_gets_no_more_commands(tmp_path):
    with Flight(tmp_path) as flight:
        rebooted = flight.flying().fault("reboot")
        assert flight.ended() == 1
        assert not flight.now.armed
        assert flight.now.height < 0.1, "it has fallen"
        assert flight.statistics().last - rebooted < LOST_AFTER + HOLD + ALLOWANCE
        assert "the autopilot has rebooted" in flight.events()
        assert "PROCESS_FAILURE: link lost: nothing heard of the autopilot" in flight.text()


@pytest.mark.soak
def test_telemetry_that_is_not_finite_and_parameters_that_are_missing_do_not_end_a_flight(tmp_path):
    missing = (0.0, "missing", "EKF2_EV_CTRL,COM_OF_LOSS_T,MPC_THR_HOVER,COM_OBL_RC_ACT")
    with Flight(tmp_path, "await drone.goto(1.0, 0.0, 1.0)\nawait drone.hover(1.0)", faults=[missing]) as flight:
        flight.flying().fault("telemetry_nan")
        assert flight.ended() == 0, flight.text()
        flight.assert_safe()
        assert "GOAL_ACHIEVED: mission complete" in flight.text()


# The application itself.


@pytest.mark.parametrize(
    ("how", "why"),
    [
        pytest.param(
            "raise IndexError('out of range')",
            "the controller failed: IndexError: out of range",
            marks=pytest.mark.soak,
        ),
        pytest.param(
            "c = controlled(controller, stamp, state, trajectory); c.rates[1] = float('nan'); return c",
            "not finite",
            marks=pytest.mark.soak,
        ),
        ("time.sleep(0.12); return controlled(controller, stamp, state, trajectory)", "stale: 0.1"),
    ],
    ids=["raises", "nan", "slow"],
)
def test_a_controller_that_fails_for_good_is_replaced_by_a_landing(tmp_path, how, why):
    with Flight(tmp_path, FAILING.format(how=how)) as flight:
        assert flight.ended() == 1
        flight.assert_safe()
        (failed,) = flight.said("failing")
        assert flight.mode_since("AUTO_LAND", failed) < 0.3 + ALLOWANCE
        assert f"PROCESS_FAILURE: no command: no sound command for too long: {why}" in flight.text()


def test_a_controller_that_fails_for_a_moment_is_flown_through(tmp_path):
    with Flight(tmp_path, RECOVERING) as flight:
        assert flight.ended() == 0, flight.text()
        flight.assert_safe()
        bridged = [text for text in flight.events() if "commands refused within" in text]
        assert len(bridged) == 3
        for text, why in zip(bridged, ("the controller failed: IndexError", "not finite", "stale"), strict=True):
            assert why in text


def test_a_short_stall_of_the_process_is_flown_through(tmp_path):
    with Flight(tmp_path, STALL.format(microseconds=200_000)) as flight:
        assert flight.ended() == 0, flight.text()
        flight.assert_safe()
        began, ended = flight.said("stall")
        assert flight.mode_since("AUTO_LAND", began) > 2.0
        assert flight.statistics().longest > ended - began - 2 * TICK


def test_a_long_stall_ends_in_a_landing_that_the_application_does_not_disturb(tmp_path):
    with Flight(tmp_path, STALL.format(microseconds=700_000)) as flight:
        assert flight.ended() == 1
        flight.assert_safe()
        began, ended = flight.said("stall")
        assert ended - began >= 0.7
        assert flight.statistics().last - began < 0.1
        assert flight.mode_since("AUTO_LAND", began) < OFFBOARD_LOSS + ALLOWANCE
        assert flight.mode_since("OFFBOARD", ended + 0.1) == np.inf
        assert "PROCESS_FAILURE: " in flight.text()


def test_a_command_that_was_on_its_way_brings_offboard_back_only_for_a_moment(tmp_path):
    with Flight(tmp_path, IN_HAND) as flight:
        assert flight.ended() == 1
        flight.assert_safe()
        began, ended = flight.said("stall")
        assert flight.mode_since("AUTO_LAND", began) < OFFBOARD_LOSS + ALLOWANCE
        back = flight.mode_since("OFFBOARD", ended)
        assert back < 0.1
        assert flight.mode_since("AUTO_LAND", ended + back) < 0.5 * OFFBOARD_LOSS
        assert flight.mode_since("OFFBOARD", ended + OFFBOARD_LOSS) == np.inf
        assert "no command: no sound command for too long: the sender stalled" in flight.text()


def test_when_the_process_is_killed_px4_lands(tmp_path):
    with Flight(tmp_path) as flight:
        killed = flight.flying().signal(signal.SIGKILL)
        flight.until_down()
        flight.assert_safe()
        assert flight.statistics().last - killed < 0.1
        assert flight.mode_since("AUTO_LAND", killed) < OFFBOARD_LOSS + ALLOWANCE


def test_a_process_that_was_stopped_does_not_disturb_the_landing_when_it_wakes(tmp_path):
    with Flight(tmp_path) as flight:
        stopped = flight.flying().signal(signal.SIGSTOP)
        flight.until(lambda: flight.now.mode == "AUTO_LAND")
        time.sleep(1.0)
        assert flight.now.armed
        asleep = flight.statistics()
        assert asleep.last - stopped < 0.1
        woken = flight.signal(signal.SIGCONT)
        assert flight.ended() == 1
        flight.assert_safe()
        awake = flight.statistics()
        # A command that MAVSDK had in hand when the process was stopped can't be recalled.
        late = awake.count - asleep.count
        assert late <= 1
        assert awake.setpoint.stamp - stopped < 0.1
        assert flight.mode_since("AUTO_LAND", stopped) < OFFBOARD_LOSS + ALLOWANCE
        assert late or flight.mode_since("OFFBOARD", woken) == np.inf
        assert flight.mode_since("OFFBOARD", woken + OFFBOARD_LOSS + ALLOWANCE) == np.inf


def test_a_signal_in_flight_lands_first_and_a_second_one_changes_nothing(tmp_path):
    with Flight(tmp_path) as flight:
        told = flight.flying().signal(signal.SIGTERM)
        time.sleep(0.7)
        flight.signal(signal.SIGINT)
        assert flight.ended() == 1
        flight.assert_safe()
        assert flight.mode_since("AUTO_LAND", told) < ALLOWANCE
        assert "INTERRUPTED: interrupted by SIGTERM" in flight.text()
        assert flight.summary()["outcome"] == "INTERRUPTED"


def test_a_signal_at_the_moment_of_arming_does_not_leave_a_vehicle_that_climbs(tmp_path):
    with Flight(tmp_path) as flight:
        flight.until(lambda: flight.now.armed)
        flight.signal(signal.SIGTERM)
        assert flight.ended() == 1
        flight.assert_safe()
        assert "INTERRUPTED: interrupted by SIGTERM" in flight.text()


# The tracker.


def test_a_tracker_that_falls_silent_ends_in_a_landing(tmp_path):
    with Flight(tmp_path) as flight:
        flight.flying().tracking = False
        lost = time.monotonic()
        assert flight.ended() == 1
        flight.assert_safe()
        assert (
            min(flight.mode_since(mode, lost) for mode in ("AUTO_LAND", "DESCEND"))
            < COAST + STATE_TIMEOUT + HOLD + ALLOWANCE
        )
        assert "PROCESS_FAILURE: " in flight.text()
        assert "state lost" in flight.text() or "the state is too old" in flight.text()


TOLD = """
for word in ("first", "second"):
    await drone.hover(4.0)
    estimate = drone._context.autopilot.odometry.latest.position
    say(word, *estimate, *drone.position)
"""


def test_a_tracker_that_relocalises_does_not_move_the_vehicle(tmp_path):
    """Whatever its confidence; the autopilot's own estimator, which flies in the tracker's frame, follows it."""
    with Flight(tmp_path, TOLD) as flight:
        place = flight.flying().now.position
        for word, moved, confidence in (("first", 3.0, None), ("second", 0.0, 1)):
            flight.confidence, flight.shift = confidence, np.array((moved, 0.0, 0.0))
            flight.until(lambda word=word: flight.said(word))
            theirs, ours = np.reshape(flight.said(word), (2, 3))
            assert flight.now.position == pytest.approx(place, abs=0.25)
            assert ours == pytest.approx(place, abs=0.25)
            assert theirs == pytest.approx(place + moved * np.array((1.0, 0.0, 0.0)), abs=0.25)
        assert flight.ended() == 0, flight.text()
        flight.assert_safe()
