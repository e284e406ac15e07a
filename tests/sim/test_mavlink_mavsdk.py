"""Real MAVSDK against the simulated vehicle, over loopback."""

import asyncio
import contextlib
import json
import socket

import mavsdk.logging
import pytest
from mavlink_cases import Rig, until
from mavsdk.asyncio import Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionError
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from sim.px4.modes import NavState

pytestmark = pytest.mark.wall_clock


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.asynccontextmanager
async def flown():
    """A vehicle and the system that MAVSDK has found; commands come from its companion computer.

    End each subscription inside: MAVSDK 4.1 crashes where one is ended while the library is being destroyed.
    """
    mavsdk.logging.log_subscribe(lambda *_: True)
    port = free_port()
    library = Mavsdk(Configuration.create_manual(1, 191, True))
    async with Rig(remote=("127.0.0.1", port)) as rig:
        try:
            await library.add_any_connection(f"udpin://127.0.0.1:{port}")
            system = await library.first_autopilot(timeout_s=5.0)
            assert system is not None
            yield rig, system
        finally:
            await asyncio.to_thread(library.destroy)


async def listen(stream, told):
    """Append to ``told`` what ``stream`` brings."""
    async for item in stream:
        told += [item]


async def test_mavsdk_finds_reads_and_sets_up_the_vehicle():
    async with flown() as (rig, system):
        version = await InfoAsync(system).get_version()
        assert (version.flight_sw_major, version.flight_sw_minor, version.flight_sw_patch) == (1, 16, 1)
        parameters = ParamAsync(system)
        assert await parameters.get_param_int("EKF2_EV_CTRL") == 15
        assert await parameters.get_param_float("COM_OF_LOSS_T") == 0.5
        await parameters.set_param_float("MIS_TAKEOFF_ALT", 1.5)
        await parameters.set_param_int("NAV_DLL_ACT", 1)
        assert (rig.px4.parameters["MIS_TAKEOFF_ALT"], rig.px4.parameters["NAV_DLL_ACT"]) == (1.5, 1)
        everything = await parameters.get_all_params()
        assert len(everything.int_params) + len(everything.float_params) == len(rig.px4.parameters)
        telemetry = TelemetryAsync(system)
        await telemetry.set_rate_odometry(100.0)
        times = []
        async with contextlib.aclosing(telemetry.subscribe_odometry()) as stream:
            async for told in stream:
                times.append(told.time_usec)
                if len(times) == 30:
                    break
        assert (times[-1] - times[0]) / 29 == pytest.approx(1e4, rel=0.15)


async def test_health_refused_arming_and_offboard_by_direct_messages():
    async with flown() as (rig, system):
        texts, healths, positions = [], [], []

        async def stream():
            direct = MavlinkDirectAsync(system)
            fields = {"target_system": 1, "target_component": 1, "type_mask": 128, "q": [1, 0, 0, 0], "thrust": 0.1}
            fields |= {"time_boot_ms": 0, "body_roll_rate": 0.5, "body_pitch_rate": 0, "body_yaw_rate": -0.25}
            message = MavlinkMessage("SET_ATTITUDE_TARGET", 0, 0, 1, 1, json.dumps(fields))
            while True:
                await direct.send_message(message)
                await asyncio.sleep(0.02)

        action, telemetry = ActionAsync(system), TelemetryAsync(system)
        told = {
            telemetry.subscribe_status_text(): texts,
            telemetry.subscribe_health(): healths,
            telemetry.subscribe_position_velocity_ned(): positions,
        }
        tasks = [asyncio.create_task(listen(*pair)) for pair in told.items()]
        with pytest.raises(ActionError, match="DENIED"):
            await action.arm()
        await until(lambda: any("Arming denied" in text.text for text in texts), 1.0)
        await until(lambda: healths, 2.0)
        # Not is_local_position_ok, which MAVSDK takes back at each SYS_STATUS and reports once a second.
        assert not positions
        rig.feed_inside()
        await until(lambda: rig.px4.ready and positions, 4.0)
        assert not healths[-1].is_global_position_ok
        assert not healths[-1].is_armable  # the mode that it boots in needs a global position
        tasks.append(asyncio.create_task(stream()))
        await until(lambda: rig.endpoint.watch.statistics().count > 5, 2.0)
        assert rig.px4.set_mode(NavState.OFFBOARD).accepted
        await action.arm()
        assert (rig.px4.armed, rig.px4.nav_state) == (True, NavState.OFFBOARD)
        seen = rig.endpoint.watch.statistics()
        assert seen.setpoint.rates == pytest.approx((0.5, 0.0, -0.25))
        assert seen.targets == {(1, 1): seen.count}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
