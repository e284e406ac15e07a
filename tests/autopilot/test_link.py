"""The real link over real MAVSDK on loopback, against a scripted peer."""

import asyncio
import math
import socket
from contextlib import asynccontextmanager

import mavlink_peer as px4
import numpy as np
import pytest

from flightapp.autopilot.commands import RefusedError, SilentError
from flightapp.autopilot.link import Px4Link
from flightapp.autopilot.parameter_store import ParameterMissingError
from flightapp.config import load_config
from flightapp.interfaces import AutopilotError
from flightapp.messages import FlightMode, PoseSample, RateCommand


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@asynccontextmanager
async def linked(system=1, connect=True, **settings):
    """A link and its peer; ``settings`` of the section link or external_vision as section__key."""
    port = free_port()
    values = {key.replace("__", "."): value for key, value in settings.items()}
    values |= {"link.connection": f"udpin://127.0.0.1:{port}"}
    values.setdefault("link.connect_timeout", 5.0)
    peer = px4.Peer(port, system)
    link = Px4Link(load_config(None, values))
    try:
        if connect:
            await link.connect()
        yield link, peer
    finally:
        await link.close()
        peer.close()


async def until(true, seconds=3.0):
    async with asyncio.timeout(seconds):
        while not true():  # noqa: ASYNC110  what is waited for is seen by another thread
            await asyncio.sleep(0.01)


def command(rates=(0.1, 0.2, 0.3), thrust=9.80665):
    return RateCommand(asyncio.get_running_loop().time(), np.array(rates), thrust)


async def test_setpoints_are_body_rates_in_frd_for_the_configured_vehicle():
    async with linked() as (link, peer):
        link.send(command())
        await until(lambda: peer.count("SET_ATTITUDE_TARGET"))
        seen = peer.last("SET_ATTITUDE_TARGET")
        assert (seen.target_system, seen.target_component, seen.type_mask) == (1, 1, 128)
        rates = (seen.body_roll_rate, seen.body_pitch_rate, seen.body_yaw_rate)
        assert rates == pytest.approx((0.1, -0.2, -0.3))
        assert seen.thrust == pytest.approx(0.25)
        assert seen.get_srcSystem() == 1
        assert seen.get_srcComponent() == 191


async def test_nothing_is_sent_again_by_itself():
    async with linked() as (link, peer):
        link.send(command())
        await asyncio.sleep(0.5)
        assert peer.count("SET_ATTITUDE_TARGET") == 1


async def test_poses_go_out_at_their_rate():
    async with linked(external_vision__rate=50.0) as (link, peer):
        begun = asyncio.get_running_loop().time()
        for _ in range(100):
            stamp = asyncio.get_running_loop().time()
            level = np.array((1.0, 0.0, 0.0, 0.0))
            position = np.array((1.0, 2.0, 3.0)) if peer.count("ODOMETRY") == 0 else np.array((1.25, 2.0, 3.0))
            link.send_pose(PoseSample(stamp, position, level, np.zeros(3), np.zeros(3), 3))
            await asyncio.sleep(0.005)
        seen = peer.last("ODOMETRY")
        assert (seen.x, seen.y, seen.z) == (0.25, 0.0, 0.0)  # from where the vehicle stood
        elapsed = asyncio.get_running_loop().time() - begun
        assert 20 <= peer.count("ODOMETRY") <= 1 + elapsed * 50.0 / 0.9


async def test_status_follows_heartbeats_of_our_vehicle_only():
    async with linked() as (link, peer):
        peer.mode, peer.armed = px4.POSITION, True
        await until(lambda: link.status.latest.mode is FlightMode.POSITION)
        assert link.status.latest.armed
        stranger = px4.mavlink.MAVLink(None, srcSystem=9, srcComponent=1)
        gimbal = px4.mavlink.MAVLink(None, srcSystem=1, srcComponent=154)
        for other in (stranger, gimbal):
            peer._socket.sendto(
                px4.mavlink.MAVLink_heartbeat_message(2, 12, 1, px4.LAND, 3, 3).pack(other), peer._remote
            )
        await asyncio.sleep(0.3)
        assert link.status.latest.mode is FlightMode.POSITION


async def test_the_autopilot_never_appears():
    async with linked(connect=False, link__connect_timeout=1.0) as (link, peer):
        peer.silent = True
        with pytest.raises(AutopilotError, match=r"no autopilot with system id 1 .* within 1 s; nothing at all"):
            await link.connect()


async def test_another_vehicle_is_not_taken_for_ours():
    async with linked(system=7, connect=False, link__connect_timeout=2.0) as (link, _):
        with pytest.raises(AutopilotError, match=r"no autopilot with system id 1 .*; heard there: system 7"):
            await link.connect()


async def test_a_refusal_says_why():
    async with linked() as (link, peer):
        peer.answers[400], peer.texts[400] = 1, "Arming denied: Resolve system health failures first"
        with pytest.raises(RefusedError, match="arming refused: Arming denied: Resolve system health failures first"):
            await link.arm()
        peer.texts.clear()
        await asyncio.sleep(1.5)
        with pytest.raises(RefusedError, match="arming refused: temporarily rejected"):
            await link.arm()


async def test_a_clock_that_begins_anew_is_a_reboot():
    async with linked() as (link, peer):
        notices = []
        link.notices.tap(notices.append)
        await until(lambda: link.round_trip is not None)
        peer.ahead += 2.0  # set anew, but not from its beginning
        await asyncio.sleep(1.0)
        assert not notices
        asked = peer.count("COMMAND_LONG")
        peer.ahead = -3.0
        await until(lambda: notices)
        assert [notice.text for notice in notices] == ["the autopilot has rebooted"]
        await until(lambda: peer.count("COMMAND_LONG") >= asked + 3)
        assert peer.last("COMMAND_LONG").command == 511


async def test_arming_is_over_when_it_is_told():
    async with linked() as (link, _):
        await link.arm()
        assert link.status.latest.armed


async def test_a_silent_autopilot_is_told():
    async with linked() as (link, peer):
        peer.silent = True
        with pytest.raises(SilentError, match="arming: no answer"):
            await link.arm()


async def test_modes_wait_until_they_are_in_force():
    async with linked() as (link, _):
        await link.start_offboard()
        assert link.status.latest.mode is FlightMode.OFFBOARD
        await link.land()
        assert link.status.latest.mode is FlightMode.LAND


async def test_takeoff_sets_the_height_and_leaves_the_place_open():
    async with linked() as (link, peer):
        await link.takeoff(1.5)
        assert peer.last("PARAM_SET").param_id == "MIS_TAKEOFF_ALT"
        assert peer.last("PARAM_SET").param_value == 1.5
        sent = next(m for m in reversed(peer.seen["COMMAND_LONG"]) if m.command == 22)
        assert all(map(math.isnan, (sent.param5, sent.param6, sent.param7)))


async def test_kill_disarms_by_force():
    async with linked() as (link, peer):
        await link.kill()
        sent = next(m for m in reversed(peer.seen["COMMAND_LONG"]) if m.command == 400)
        assert (sent.param1, sent.param2) == (0.0, 21196.0)


async def test_time_is_asked_for_and_told_only_when_configured():
    for answers in (False, True):
        async with linked(external_vision__timesync=answers) as (link, peer):
            await until(lambda: link.round_trip is not None)
            assert link.round_trip.p50 < 0.1
            asked = px4.mavlink.MAVLink_timesync_message(0, 12345)
            peer.send(asked)
            await asyncio.sleep(0.2)
            told = [m for m in peer.seen["TIMESYNC"] if m.ts1 == 12345 and m.tc1 != 0]
            assert bool(told) is answers


async def test_a_takeoff_begins_at_the_origin_of_the_autopilots_frame_wherever_the_vehicle_stands():
    async with linked() as (link, peer):
        level, zeros = np.array((1.0, 0.0, 0.0, 0.0)), [0.0] * 21

        async def stand_at(*position):
            before = peer.count("ODOMETRY")
            stamp = asyncio.get_running_loop().time()
            link.send_pose(PoseSample(stamp, np.array(position), level, np.zeros(3), np.zeros(3), 3))
            await until(lambda: peer.count("ODOMETRY") > before)
            seen = peer.last("ODOMETRY")
            return (seen.x, seen.y, seen.z), seen.reset_counter

        assert await stand_at(1.0, 2.0, 0.5) == ((0.0, 0.0, 0.0), 0)
        await link.takeoff(1.5)
        await asyncio.sleep(0.05)
        (place, resets) = await stand_at(5.0, 2.0, 0.5)
        assert place == (4.0, 0.0, 0.0)
        await link.takeoff(1.5)
        assert await stand_at(5.0, 2.0, 0.5) == ((0.0, 0.0, 0.0), resets + 1)
        peer.send(
            px4.mavlink.MAVLink_odometry_message(1, 1, 1, 1.0, 0, -1.5, [1, 0, 0, 0], 0, 0, 0, 0, 0, 0, zeros, zeros)
        )
        await until(lambda: link.odometry.latest is not None)
        assert link.odometry.latest.position.tolist() == [6.0, 2.0, 2.0]


async def test_telemetry_that_is_not_a_number_is_refused():
    async with linked() as (link, peer):
        nan = math.nan
        zeros = [0.0] * 21
        peer.send(
            px4.mavlink.MAVLink_odometry_message(1, 1, 12, nan, 0, 0, [1, 0, 0, 0], 0, 0, 0, 0, 0, 0, zeros, zeros)
        )
        peer.send(px4.mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [65535] * 10, -1, -1, -1, -1))
        await asyncio.sleep(0.3)
        assert link.odometry.latest is None
        assert math.isnan(link.status.latest.voltage)


async def test_parameters():
    async with linked() as (link, peer):
        assert await link.parameters.read("MPC_THR_HOVER") == 2.5
        await link.parameters.write("MPC_THR_HOVER", 0.4)
        assert peer.last("PARAM_SET").param_value == pytest.approx(0.4)
        peer.silent = True
        with pytest.raises(ParameterMissingError, match="MPC_THR_HOVER"):
            await link.parameters.read("MPC_THR_HOVER")


async def test_before_connecting_nothing_is_sent():
    async with linked(connect=False) as (link, peer):
        link.send(command())
        with pytest.raises(AutopilotError, match="arming: not connected"):
            await link.arm()
        with pytest.raises(AutopilotError, match="not connected"):
            _ = link.parameters
        await asyncio.sleep(0.1)
        assert peer.count("SET_ATTITUDE_TARGET") == 0
