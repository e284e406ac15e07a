"""What systemd is told, and by whose health."""

import asyncio
import os
import socket
from contextlib import suppress

import pytest
from fakes import virtually
from notify_socket import notify_socket

from flightapp.bus import Bus
from flightapp.service.notify import Notifier
from flightapp.service.pulse import Pulse
from flightapp.timing import Ticker


@pytest.mark.parametrize("kind", ["path", "abstract"])
def test_every_message_arrives(tmp_path, kind):
    address = str(tmp_path / "notify") if kind == "path" else f"@flightapp-test-{os.getpid()}"
    with notify_socket(address) as heard:
        notifier = Notifier({"NOTIFY_SOCKET": address})
        notifier.ready("waiting")
        notifier.status("waiting")
        notifier.status("flying:\n3 s")
        notifier.ping()
        notifier.reloading()
        notifier.stopping()
        notifier.close()
    *plain, reloading, stopping = heard.messages
    assert plain == ["READY=1\nSTATUS=waiting", "STATUS=flying: 3 s", "WATCHDOG=1"]
    assert reloading.startswith("RELOADING=1\nMONOTONIC_USEC=") and int(reloading.rpartition("=")[2]) > 0
    assert stopping == "STOPPING=1"


def test_without_systemd_nothing_is_sent():
    notifier = Notifier({})
    notifier.ready("waiting")
    notifier.ping()
    assert notifier.watchdog == 0.0


def test_a_socket_that_is_full_or_gone_holds_nothing_up(tmp_path):
    address = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as deaf:
        deaf.bind(address)
        notifier = Notifier({"NOTIFY_SOCKET": address})
        for _ in range(5000):  # far more than the queue holds, and nobody reads
            notifier.ping()
    notifier.ping()
    notifier.close()
    notifier.ping()


def test_what_must_be_heard_is_kept_while_the_queue_is_full(tmp_path):
    address = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as slow:
        slow.bind(address)
        slow.setblocking(False)
        notifier = Notifier({"NOTIFY_SOCKET": address})
        for _ in range(1000):
            notifier.ping()
        notifier.reloading()
        notifier.ready("flying")
        heard = drained(slow)
        assert set(heard) == {"WATCHDOG=1"} and len(heard) < 1000
        notifier.status("flying")
        assert [one.partition("=")[0] for one in drained(slow)] == ["RELOADING", "READY"]
        notifier.close()


def drained(slow):
    heard = []
    with suppress(BlockingIOError):
        while True:
            heard.append(slow.recv(4096).decode())
    return heard


@pytest.mark.parametrize(
    ("environment", "seconds"),
    [
        ({"WATCHDOG_USEC": "10000000"}, 10.0),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": str(os.getpid())}, 10.0),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": "1"}, 0.0),
        ({"WATCHDOG_USEC": "soon"}, 0.0),
    ],
)
def test_the_watchdog_is_this_process_own(environment, seconds):
    assert Notifier(environment).watchdog == seconds


RATE, PERIOD = 250.0, 10.0


def pings_of(sender, seconds=30.0, beats=()):
    """When the watchdog was told, beside ``sender(bus, ticker)``; at ``beats`` the service itself has its turn."""

    async def main():
        bus, loop, pings = Bus(), asyncio.get_running_loop(), []
        pulse = Pulse(lambda: pings.append(loop.time()), PERIOD, loop.time)
        bus.tick.tap(lambda _: pulse.tick())
        for when in beats:
            loop.call_at(when, pulse.beat)
        pulse.fly(RATE)
        task = asyncio.create_task(sender(bus, Ticker(RATE)))
        await asyncio.sleep(seconds)
        task.cancel()
        return pings

    return virtually(main())


async def steadily(bus, ticker):
    while True:
        bus.tick.publish(await ticker.tick())


def test_a_sender_that_ticks_keeps_the_watchdog_quiet():
    pings = pings_of(steadily)
    assert len(pings) == 11
    assert max(later - sooner for sooner, later in zip([0.0, *pings], pings, strict=False)) < PERIOD / 2.0


def test_pings_stop_when_the_sender_stalls_and_come_again_when_it_goes_on():
    async def stalling(bus, ticker):
        while True:
            stamp = await ticker.tick()
            if 10.0 < stamp < 20.0:
                await asyncio.sleep(20.0 - stamp)
            bus.tick.publish(stamp)

    # The service's own turns change nothing about it.
    pings = pings_of(stalling, beats=[0.1 * k for k in range(300)])
    assert [ping for ping in pings if 10.1 < ping < 20.1] == []
    assert min(pings) < 5.0 and max(pings) > 25.0


def test_pings_stop_when_the_sender_has_ended():
    async def dying(bus, ticker):
        while (stamp := await ticker.tick()) < 10.0:
            bus.tick.publish(stamp)

    assert max(pings_of(dying, beats=[0.1 * k for k in range(300)])) <= 10.0


def test_a_sender_that_is_far_too_slow_is_not_well():
    async def slowly(bus, ticker):
        while True:
            await asyncio.sleep(4.0 / RATE)
            bus.tick.publish(await ticker.tick())

    assert pings_of(slowly) == []


def test_without_a_flight_the_service_itself_is_asked():
    async def main():
        loop, pings = asyncio.get_running_loop(), []
        pulse = Pulse(lambda: pings.append(loop.time()), PERIOD, loop.time)
        pulse.fly(RATE)
        pulse.rest()
        for _ in range(110):
            await asyncio.sleep(0.1)
            pulse.beat()
        await asyncio.sleep(10.0)
        return pings

    pings = virtually(main())
    assert len(pings) == 4 and max(pings) < 11.0
    assert all(2.4 < later - sooner < 2.7 for sooner, later in zip([0.0, *pings], pings, strict=False))


def test_the_socket_is_not_given_to_children(tmp_path):
    notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify")})
    assert notifier._socket.type == socket.SOCK_DGRAM and not notifier._socket.get_inheritable()
    notifier.close()
