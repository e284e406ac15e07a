import asyncio
import math
from itertools import pairwise

import pytest
from mavlink_cases import Rig

from flightapp.inputs import BadInputError
from sim.mavlink.faults import Faults
from sim.px4.modes import NavState

ARM, MODE = 400, 176


@pytest.fixture(autouse=True)
def quick_position(monkeypatch):
    """A position counts sooner than PX4 lets it."""
    monkeypatch.setattr("sim.px4.commander.PROBATION", 0.2)


class FakePx4:
    """Takes down what happens to it."""

    def __init__(self):
        self.happened = []

    def __getattr__(self, name):
        return lambda *arguments: self.happened.append((name, *arguments))


@pytest.fixture
def clock():
    return [0.0]


@pytest.fixture
def faults(clock):
    return Faults(FakePx4(), lambda: clock[0], seed=1)


@pytest.mark.parametrize(
    "name, value, complaint",
    [
        ("xyzzy", 1.0, "unknown fault 'xyzzy'; there are"),
        ("latncy", 1.0, "did you mean 'latency'"),
        ("loss", 1.5, "a share is 0 to 1"),
        ("loss", "much", "'much' is not a number"),
        ("loss", None, "not a number"),
        ("latency", -1.0, "0 s or more"),
        ("silence", math.nan, "not finite"),
        ("pilot", "sideways", "no flight mode"),
        ("missing", None, "names of parameters"),
    ],
)
def test_bad_faults_are_named_when_they_are_scheduled(faults, name, value, complaint):
    with pytest.raises(BadInputError, match=complaint):
        faults.schedule(1.0, name, value)
    with pytest.raises(BadInputError, match=complaint):
        faults.apply(name, value)


def test_the_schedule_is_kept_in_order(faults):
    faults.schedule(2.0, "battery")
    faults.schedule(1.0, "pilot", "Position")
    faults.schedule(1.0, "refuse_arming", "")
    faults.schedule(3.0, "reboot", 1.0)
    faults.run(0.9)
    assert faults._px4.happened == []
    faults.run(2.5)
    assert faults._px4.happened == [("pilot", NavState.POSCTL), ("refuse_arming", None), ("fail_battery",)]
    faults.run(3.0)
    assert faults._px4.happened[-1] == ("reboot",)


def test_loss_is_random_but_the_same_for_a_seed(clock):
    def lost(seed):
        faults = Faults(FakePx4(), lambda: 0.0, seed)
        faults.apply("loss", 0.3)
        return [faults.delay(faults.loss_in) is None for _ in range(1000)]

    assert 250 < sum(lost(1)) < 350
    assert lost(1) == lost(1) != lost(2)


def test_latency_and_jitter(faults):
    faults.apply("latency", 0.05)
    faults.apply("jitter", "0.02")
    delays = [faults.delay(0.0) for _ in range(200)]
    assert min(delays) >= 0.05
    assert max(delays) <= 0.07
    assert max(delays) - min(delays) > 0.015
    assert not faults.harmless


def test_silence_ends_by_itself(faults, clock):
    faults.apply("silence", 2.0)
    clock[0] = 1.9
    assert faults.delay(0.0) is None
    clock[0] = 2.0
    assert faults.delay(0.0) == 0.0
    assert faults.harmless


def test_switches(faults):
    for name in ("telemetry_nan", "setpoints_ignored", "vision_ignored", "acknowledged_early"):
        faults.apply(name)
        assert getattr(faults, name) is True
        faults.apply(name, 0.0)
        assert getattr(faults, name) is False


async def test_nothing_gets_through_a_silence():
    async with Rig() as rig:
        await rig.client.wait("ATTITUDE")
        rig.endpoint.faults.apply("silence", 0.4)
        rig.client.received.clear()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.2):
                await rig.client.command(MODE, 1.0, 4.0, 2.0)
        assert rig.client.received == []
        assert rig.px4.intention is NavState.AUTO_LOITER
        await rig.client.wait("ATTITUDE")


async def test_a_lossy_link_loses_its_share():
    async with Rig() as rig:
        rig.endpoint.faults.apply("loss_out", 0.5)
        rig.client.received.clear()
        await rig.client.wait("ATTITUDE")
        await asyncio.sleep(0.8)
        sequences = [message.get_seq() for message in rig.client.received]
        sent = sum((b - a) % 256 for a, b in pairwise(sequences))
        assert 0.35 < len(sequences) / sent < 0.65


async def test_latency_counts_both_ways():
    async with Rig() as rig:
        rig.endpoint.faults.apply("latency", 0.1)
        begun = asyncio.get_running_loop().time()
        assert await rig.client.command(510, 331) == 0
        assert 0.2 <= asyncio.get_running_loop().time() - begun < 0.4


async def test_telemetry_of_a_broken_estimator():
    async with Rig() as rig:
        rig.endpoint.faults.apply("telemetry_nan")
        await asyncio.sleep(0.02)
        told = await rig.client.wait("ODOMETRY")
        assert math.isnan(told.x) and math.isnan(told.q[0]) and math.isnan(told.vx)
        assert math.isnan((await rig.client.wait("ATTITUDE")).yaw)
        await rig.client.wait("HIGHRES_IMU", lambda m: math.isnan(m.xacc))


async def test_ignored_setpoints_and_vision():
    async with Rig() as rig:
        rig.endpoint.faults.apply("vision_ignored")
        rig.endpoint.faults.apply("setpoints_ignored")
        with pytest.raises(TimeoutError):
            await rig.position(0.6)
        for _ in range(5):
            rig.client.setpoint()
        await asyncio.sleep(0.05)
        assert rig.endpoint.watch.statistics().count == 5
        assert rig.endpoint.watch.statistics().setpoint is None
        rig.endpoint.faults.apply("vision_ignored", False)
        await rig.position()


async def test_refused_arming_a_pilots_switch_and_a_failing_battery():
    async with Rig() as rig:
        await rig.position()
        rig.endpoint.faults.apply("refuse_arming", "Compass uncalibrated")
        assert await rig.client.command(MODE, 1.0, 4.0, 2.0) == 0
        text = asyncio.ensure_future(rig.client.wait("STATUSTEXT", lambda m: "Compass" in m.text))
        assert await rig.client.command(ARM, 1.0) == 1
        assert "Compass uncalibrated" in (await text).text
        rig.endpoint.faults.apply("refuse_arming", "")
        assert await rig.client.command(ARM, 1.0) == 0
        now = asyncio.get_running_loop().time()
        rig.endpoint.faults.schedule(now + 0.05, "pilot", "Position")
        rig.endpoint.faults.schedule(now + 0.1, "battery")
        await rig.client.wait("STATUSTEXT", lambda m: "battery" in m.text.lower())
        assert rig.px4.intention is NavState.POSCTL
        assert (await rig.client.wait("SYS_STATUS")).battery_remaining < 10


async def test_a_mode_may_be_acknowledged_before_it_is_refused():
    async with Rig() as rig:
        rig.endpoint.faults.apply("acknowledged_early")
        assert await rig.client.command(MODE, 1.0, 9.0) == 0
        await asyncio.sleep(0.05)
        assert [ack.result for ack in rig.client.named("COMMAND_ACK")] == [0, 1]
