import asyncio
import socket
import time

import numpy as np
import pytest
from mavlink_cases import Client, Rig

from flightapp.inputs import BadInputError
from sim.mavlink.endpoint import Link, MavlinkEndpoint
from sim.mavlink.setpoints import Setpoint
from sim.mavlink.socket_link import SocketLink
from sim.mavlink.watch import MEMORY, Watch


def test_statistics_of_nothing():
    seen = Watch().statistics()
    assert (seen.count, seen.rate) == (0, 0.0)
    assert np.isnan(seen.longest) and np.isnan(seen.last)


def test_statistics_of_arrivals():
    watch = Watch()
    for stamp in (1.0, 1.004, 1.008, 1.108, 1.112):
        watch.arrived(stamp, 1, 1)
    watch.arrived(1.116, 2, 1)
    seen = watch.statistics()
    assert seen.count == 6
    assert seen.p50 == pytest.approx(0.004)
    assert seen.longest == pytest.approx(0.1)
    assert seen.rate == pytest.approx(5 / 0.116)
    assert (seen.first, seen.last) == (1.0, 1.116)
    assert seen.targets == {(1, 1): 5, (2, 1): 1}
    watch.reset()
    assert watch.statistics().count == 0


def test_the_memory_of_arrivals_is_bounded():
    watch = Watch()
    for n in range(MEMORY + 10):
        watch.arrived(0.004 * n, 1, 1)
    assert len(watch.stamps()) == MEMORY
    assert watch.stamps()[0] == pytest.approx(0.04)
    seen = watch.statistics()
    assert seen.count == MEMORY + 10
    assert seen.longest == pytest.approx(0.004)


async def test_the_kernel_stamps_what_arrives():
    got = []
    link = SocketLink(0, lambda data, stamp, sender: got.append((data, stamp, sender)))
    link.open()
    await asyncio.sleep(0.2)  # Linux switches stamps on in the background
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(link.address)
        before = time.monotonic()
        sender.send(b"one")
        after = time.monotonic()
        busy_until = after + 0.1  # the stamp must not tell of this process's load
        while time.monotonic() < busy_until:
            pass
        await asyncio.sleep(0.01)
    link.close()
    ((data, stamp, address),) = got
    assert data == b"one"
    assert address[0] == "127.0.0.1"
    assert before - 5e-4 <= stamp <= after + 5e-4


async def test_a_port_in_use_is_named():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        async with Rig() as rig:
            endpoint = MavlinkEndpoint(rig.px4, asyncio.get_running_loop().time, [Link(0), Link(port)])
            with pytest.raises(BadInputError, match=f"UDP port {port}: Address already in use"):
                await endpoint.start()


async def test_only_loopback_is_listened_to():
    async with Rig() as rig:
        assert [host for host, _ in rig.endpoint.addresses] == ["127.0.0.1"]


async def test_it_answers_whoever_spoke_last():
    async with Rig() as rig:
        other = Client()
        other.remote = rig.endpoint.addresses[0]
        other.setpoint()
        await other.wait("ATTITUDE")
        assert await rig.client.nothing("ATTITUDE", 0.1)
        rig.client.setpoint()
        await rig.client.wait("ATTITUDE")
        other.close()


async def test_noise_moves_nobody():
    async with Rig() as rig:
        other = Client()
        other.remote = rig.endpoint.addresses[0]
        other.send_bytes(b"noise")
        await rig.client.wait("ATTITUDE")
        assert rig.endpoint.watch.statistics().corrupt == 1
        other.close()


async def test_without_a_remote_it_waits_to_be_spoken_to():
    async with Rig() as rig:
        loop, client = asyncio.get_running_loop(), Client()
        endpoint = MavlinkEndpoint(rig.px4, loop.time, [Link(0)])
        await endpoint.start()
        client.remote = endpoint.addresses[0]
        assert await client.nothing("ATTITUDE", 0.1)
        client.setpoint()
        await client.wait("ATTITUDE")
        await endpoint.close()
        client.close()


async def test_what_the_peer_saw():
    async with Rig() as rig:
        for _ in range(20):
            rig.client.setpoint(rates=(0.5, 0.0, 0.0), thrust=0.25, sent=2500)
            await asyncio.sleep(0.004)
        rig.client.setpoint(system=9)
        await asyncio.sleep(0.05)
        seen = rig.endpoint.watch.statistics()
        assert seen.count == seen.messages["SET_ATTITUDE_TARGET"] == 21
        assert seen.targets == {(1, 1): 20, (9, 1): 1}
        assert seen.senders == {(1, 191): 21}
        assert seen.setpoint == Setpoint(128, (1.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0), 0.25, 2.5)
        assert 0.003 < seen.p50 < 0.01
        assert abs(seen.last - time.monotonic()) < 1.0
