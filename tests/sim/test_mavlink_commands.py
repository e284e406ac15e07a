import asyncio
import math

import pytest
from mavlink_cases import Rig
from pymavlink.dialects.v20 import development as dialect

from sim.px4 import model
from sim.px4.commander import Text
from sim.px4.modes import NavState

ARM, MODE, TAKEOFF, LAND, REBOOT = 400, 176, 22, 21, 246
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = range(4)
OFFBOARD, LOITER, TAKEOFF_MODE, LAND_MODE = (1.0, 6.0), (1.0, 4.0, 3.0), (1.0, 4.0, 2.0), (1.0, 4.0, 6.0)
KILL = 21196.0


@pytest.fixture(autouse=True)
def quick_position(monkeypatch):
    """A position counts sooner than PX4 lets it."""
    monkeypatch.setattr("sim.px4.commander.PROBATION", 0.2)


async def stream_setpoints(client):
    while True:
        client.setpoint(thrust=0.0)
        await asyncio.sleep(0.02)


async def test_arming_is_refused_with_a_text_that_says_why():
    async with Rig() as rig:
        text = asyncio.ensure_future(rig.client.wait("STATUSTEXT", lambda m: "Arming denied" in m.text))
        assert await rig.client.command(ARM, 1.0) == REJECTED
        assert (await text).severity == dialect.MAV_SEVERITY_CRITICAL
        assert not rig.px4.armed


async def test_offboard_flight_by_commands():
    async with Rig() as rig:
        client = rig.client
        await rig.position()
        # Disarmed it can be meant without setpoints, but not armed in.
        assert await client.command(MODE, *OFFBOARD) == ACCEPTED
        assert await client.command(ARM, 1.0) == REJECTED
        stream = asyncio.create_task(stream_setpoints(client))
        await asyncio.sleep(0.1)
        assert await client.command(MODE, *OFFBOARD) == ACCEPTED
        assert await client.command(ARM, 1.0) == ACCEPTED
        assert await client.command(ARM, 1.0, confirmation=1) == ACCEPTED  # a repetition changes nothing
        beat = await client.wait("HEARTBEAT", lambda m: m.base_mode & 128)
        assert beat.custom_mode == 6 << 16
        assert beat.base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        assert (beat.type, beat.autopilot) == (2, 12)
        # Armed, a mode that can't run is refused; indoors there is no global position to hold at.
        assert await client.command(MODE, *LOITER) == REJECTED
        assert rig.px4.nav_state is NavState.OFFBOARD
        assert await client.command(ARM, 0.0) == ACCEPTED
        assert not rig.px4.armed
        stream.cancel()


async def test_takeoff_then_arm_then_kill():
    async with Rig() as rig:
        client, nan = rig.client, math.nan
        await rig.position()
        assert await client.command(TAKEOFF, nan, 0.0, 0.0, nan, nan, nan, nan) == ACCEPTED
        assert await client.command(ARM, 1.0) == ACCEPTED
        await client.wait("EXTENDED_SYS_STATE", lambda m: m.landed_state == 3, patience=4.0)
        assert await client.command(ARM, 0.0) == REJECTED  # it flies
        assert await client.command(REBOOT, 1.0) == REJECTED
        assert await client.command(ARM, 0.0, KILL) == ACCEPTED
        assert not rig.px4.armed


async def test_commands_for_others_are_not_answered():
    async with Rig() as rig:
        for system, component in ((2, 1), (1, 100), (0, 1)):
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.15):
                    await rig.client.command(MODE, *TAKEOFF_MODE, system=system, component=component)
        assert rig.px4.intention is NavState.AUTO_LOITER
        assert await rig.client.command(MODE, *TAKEOFF_MODE, component=0) == ACCEPTED


async def test_what_px4_does_not_know():
    async with Rig() as rig:
        client = rig.client
        assert await client.command(31000) == UNSUPPORTED
        assert await client.command(ARM, 0.5) == UNSUPPORTED
        assert await client.command(MODE, 1.0, 9.0) == REJECTED
        assert await client.command(MODE, 0.0, 6.0) == REJECTED
        assert await client.command(MODE, math.nan, math.nan) == REJECTED


async def test_command_int_and_set_mode_do_the_same():
    async with Rig() as rig:
        client = rig.client
        answer = asyncio.ensure_future(client.wait("COMMAND_ACK", lambda m: m.command == MODE))
        await asyncio.sleep(0)
        client.send(dialect.MAVLink_command_int_message(1, 1, 0, MODE, 0, 0, *TAKEOFF_MODE, 0, 0, 0, 0))
        ack = await answer
        assert (ack.result, ack.target_system, ack.target_component) == (ACCEPTED, 1, 191)
        assert rig.px4.intention is NavState.AUTO_TAKEOFF
        answer = asyncio.ensure_future(client.wait("COMMAND_ACK", lambda m: m.command == MODE))
        await asyncio.sleep(0)
        client.send(dialect.MAVLink_set_mode_message(1, 1, 4 << 16 | 6 << 24))
        assert (await answer).result == ACCEPTED
        assert rig.px4.intention is NavState.AUTO_LAND


async def test_a_reboot_silences_and_forgets_the_rates(monkeypatch):
    monkeypatch.setattr(model, "BOOT", 0.6)
    async with Rig() as rig:
        client = rig.client
        assert await client.command(511, 331, 1e4) == ACCEPTED
        assert await client.command(REBOOT, 1.0) == ACCEPTED
        await asyncio.sleep(0.05)
        assert await client.nothing("ATTITUDE", 0.4)
        told = await client.wait("ODOMETRY", patience=5.0)
        assert told.time_usec < 1.5e6
        answer = asyncio.ensure_future(client.wait("MESSAGE_INTERVAL"))
        await client.command(510, 331)
        assert (await answer).interval_us == round(1e6 / 30.0)  # back to the default


async def test_long_texts_come_in_pieces():
    async with Rig() as rig:
        rig.px4.texts.append(Text(4, "x" * 60))
        first = await rig.client.wait("STATUSTEXT", lambda m: m.id != 0)
        second = next(m for m in rig.client.named("STATUSTEXT") if m.chunk_seq == 1)
        assert first.text + second.text == "x" * 60
        assert first.id == second.id
