import asyncio
import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from mavlink_cases import Rig
from pymavlink.dialects.v20 import development as dialect

from sim.mavlink.streams import Profile

SET_INTERVAL, GET_INTERVAL, REQUEST = 511, 510, 512
ODOMETRY, HEARTBEAT, CURRENT_MODE, SYS_STATUS = 331, 0, 436, 1


@pytest.fixture(autouse=True)
def quick_position(monkeypatch):
    """A position counts sooner than PX4 lets it."""
    monkeypatch.setattr("sim.px4.commander.PROBATION", 0.2)


async def rates(client, during):
    """Hz by name, over about ``during`` s."""
    before, start = len(client.received), asyncio.get_running_loop().time()
    await asyncio.sleep(during)
    elapsed = asyncio.get_running_loop().time() - start
    counts = Counter(message.get_type() for message in client.received[before:])
    return Counter({name: count / elapsed for name, count in counts.items()})


def about(rate, during):
    """``rate`` Hz over ``during`` s, give or take one message and a tenth."""
    return pytest.approx(rate, abs=0.1 * rate + 1.0 / during)


async def test_the_onboard_link_streams_what_px4_does():
    async with Rig() as rig:
        counts = await rates(rig.client, 0.8)
        expected = {"ATTITUDE": 100, "ATTITUDE_QUATERNION": 50, "HIGHRES_IMU": 50, "ODOMETRY": 30, "TIMESYNC": 10}
        expected |= {"SYS_STATUS": 5, "EXTENDED_SYS_STATE": 5, "HEARTBEAT": 1}
        for name, rate in expected.items():
            assert counts[name] == about(rate, 0.8), name
        assert counts["LOCAL_POSITION_NED"] == 0  # there is none yet
        sequences = [message.get_seq() for message in rig.client.received]
        assert all((b - a) % 256 == 1 for a, b in pairwise(sequences))


async def test_the_ground_stations_link_is_slower():
    async with Rig(Profile.GROUND) as rig:
        counts = await rates(rig.client, 0.5)
        assert counts["ATTITUDE"] == about(15.0, 0.5)
        assert counts["ODOMETRY"] == counts["HIGHRES_IMU"] == 0


async def test_an_interval_is_kept_up_to_what_px4_reaches():
    async with Rig() as rig:
        client = rig.client
        assert await client.command(SET_INTERVAL, ODOMETRY, 1e6 / 250.0) == 0
        counts = await rates(client, 0.5)
        assert counts["ODOMETRY"] == about(125.0, 0.5)  # at the default EKF2_PREDICT_US
        rig.px4.parameters.set("EKF2_PREDICT_US", 4000)
        assert await client.command(SET_INTERVAL, ODOMETRY, 1e6 / 250.0) == 0
        counts = await rates(client, 0.5)
        assert counts["ODOMETRY"] == about(250.0, 0.5)
        assert await client.command(SET_INTERVAL, ODOMETRY, -1.0) == 0
        await asyncio.sleep(0.05)
        assert (await rates(client, 0.2))["ODOMETRY"] == 0
        assert await client.command(SET_INTERVAL, ODOMETRY, 0.0) == 0
        assert (await rates(client, 0.5))["ODOMETRY"] == about(30.0, 0.5)


async def test_intervals_that_px4_refuses():
    async with Rig() as rig:
        client = rig.client
        assert await client.command(SET_INTERVAL, HEARTBEAT, 50000.0) == 4
        assert await client.command(SET_INTERVAL, 24, 50000.0) == 4  # nothing streams GPS_RAW_INT here
        assert await client.command(SET_INTERVAL, ODOMETRY, 50000.0, 1.0) == 4
        assert await client.command(SET_INTERVAL, math.nan, 50000.0) == 4


async def test_an_interval_can_be_asked_for():
    async with Rig() as rig:
        client = rig.client
        answer = asyncio.ensure_future(client.wait("MESSAGE_INTERVAL"))
        assert await client.command(GET_INTERVAL, ODOMETRY) == 0
        assert (await answer).interval_us == round(1e6 / 30.0)


async def test_messages_on_request():
    async with Rig() as rig:
        client = rig.client
        version = asyncio.ensure_future(client.wait("AUTOPILOT_VERSION"))
        assert await client.command(REQUEST, 148) == 0
        told = await version
        assert [told.flight_sw_version >> shift & 0xFF for shift in (24, 16, 8, 0)] == [1, 16, 1, 255]
        assert told.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        assert not told.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        assert await client.command(520, 1.0, system=0, component=0) == 0  # may be asked of everybody
        assert await client.command(REQUEST, 242) == 2  # no home without a global position
        assert await client.command(REQUEST, 77) == 2


async def test_odometry_is_the_estimate_in_ned():
    async with Rig() as rig:
        rig.offset = (1.0, 2.0, 0.5)
        await rig.position()
        told = await rig.client.wait("ODOMETRY")
        assert (told.frame_id, told.child_frame_id) == (1, 1)
        # The estimate errs by some centimetres of its own.
        assert (told.x, told.y, told.z) == pytest.approx((1.0, -2.0, -0.5), abs=0.2)
        assert np.linalg.norm(told.q) == pytest.approx(1.0, abs=1e-5)
        assert math.isnan(told.pose_covariance[1])
        assert told.pose_covariance[0] > 0.0
        assert abs(told.time_usec - 1e6 * (rig.world.plant.time - rig.px4.boot_time)) < 1e5


async def test_local_position_is_sent_only_while_there_is_one():
    async with Rig() as rig:
        assert await rig.client.nothing("LOCAL_POSITION_NED")
        rig.feed_vision()
        await rig.client.wait("LOCAL_POSITION_NED")
        answer = asyncio.ensure_future(rig.client.wait("ESTIMATOR_STATUS"))
        assert await rig.client.command(REQUEST, 230) == 0
        told = await answer
        assert told.flags & dialect.ESTIMATOR_POS_HORIZ_REL
        assert told.flags & dialect.ESTIMATOR_ATTITUDE


async def test_current_mode_follows_a_change_at_once():
    async with Rig() as rig:
        client = rig.client
        assert await client.command(SET_INTERVAL, CURRENT_MODE, 20000.0) == 0
        counts = await rates(client, 0.9)
        assert counts["CURRENT_MODE"] == about(2.0, 0.9)  # PX4 has nothing new to tell more often
        changed = asyncio.ensure_future(client.wait("CURRENT_MODE", lambda m: m.custom_mode == 4 << 16 | 2 << 24, 0.3))
        await asyncio.sleep(0)
        assert await client.command(176, 1.0, 4.0, 2.0) == 0
        assert (await changed).intended_custom_mode == 4 << 16 | 2 << 24


async def test_battery_and_status():
    async with Rig() as rig:
        status = await rig.client.wait("SYS_STATUS")
        assert status.voltage_battery == pytest.approx(1e3 * rig.px4.voltage, abs=30)
        gps, prearm = dialect.MAV_SYS_STATUS_SENSOR_GPS, dialect.MAV_SYS_STATUS_PREARM_CHECK
        assert not status.onboard_control_sensors_present & gps
        assert not status.onboard_control_sensors_health & prearm  # the boot mode needs a global position
        answer = asyncio.ensure_future(rig.client.wait("BATTERY_STATUS"))
        assert await rig.client.command(REQUEST, 147) == 0
        battery = await answer
        assert battery.voltages[0] == pytest.approx(1e3 * rig.px4.voltage, abs=30)
        assert battery.voltages[1] == 65535
        assert battery.battery_remaining == 100


async def test_timesync_tells_the_vehicles_own_time():
    async with Rig() as rig:
        client, loop = rig.client, asyncio.get_running_loop()
        answer = asyncio.ensure_future(client.wait("TIMESYNC", lambda m: m.tc1 != 0))
        await asyncio.sleep(0)
        sent = loop.time()
        client.send(dialect.MAVLink_timesync_message(0, 12345))
        told = await answer
        assert told.ts1 == 12345
        assert sent - 1e-3 <= 1e-9 * told.tc1 + rig.px4.boot_time <= loop.time()


async def test_a_ping_is_returned():
    async with Rig() as rig:
        client = rig.client
        answer = asyncio.ensure_future(client.wait("PING", lambda m: m.target_system == 1))
        await asyncio.sleep(0)
        client.send(dialect.MAVLink_ping_message(77, 5, 0, 0))
        told = await answer
        assert (told.time_usec, told.seq, told.target_component) == (77, 5, 191)
