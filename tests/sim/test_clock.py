"""The virtual clock."""

import asyncio

import pytest

from flightapp.timing import Ticker
from sim.clock import NothingToWaitForError, RealtimeLoop, VirtualLoop


def run_virtually(coroutine):
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(coroutine)


def test_time_starts_at_zero_and_jumps_to_each_deadline():
    async def main():
        loop = asyncio.get_running_loop()
        seen = [loop.time()]
        await asyncio.sleep(1.5)
        seen.append(loop.time())
        await asyncio.sleep(3600.0)
        seen.append(loop.time())
        return seen

    assert run_virtually(main()) == [0.0, 1.5, 3601.5]


def test_tasks_interleave_by_their_deadlines():
    async def main():
        order = []

        async def every(name, period, times):
            for _ in range(times):
                await asyncio.sleep(period)
                order.append((name, round(asyncio.get_running_loop().time(), 9)))

        await asyncio.gather(every("a", 0.3, 3), every("b", 0.4, 2))
        return order

    assert run_virtually(main()) == [("a", 0.3), ("b", 0.4), ("a", 0.6), ("b", 0.8), ("a", 0.9)]


def test_a_timeout_fires_in_virtual_time():
    async def main():
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(2.0):
                await asyncio.sleep(1e6)
        return asyncio.get_running_loop().time()

    assert run_virtually(main()) == 2.0


def test_a_ticker_is_never_late_in_virtual_time():
    async def main():
        ticker = Ticker(250.0)
        for _ in range(1000):
            await ticker.tick()
        return ticker.statistics()

    statistics = run_virtually(main())
    assert statistics.overruns == 0
    assert statistics.rate == pytest.approx(250.0, rel=1e-9)
    assert statistics.p999 == pytest.approx(0.004, rel=1e-6)


def test_waiting_for_what_never_comes_is_an_error_instead_of_a_hang():
    async def main():
        await asyncio.get_running_loop().create_future()

    with pytest.raises(NothingToWaitForError):
        run_virtually(main())


def test_files_are_polled_while_time_jumps():
    async def main():
        loop = asyncio.get_running_loop()
        server = await asyncio.start_server(lambda _, writer: writer.write(b"x"), "127.0.0.1", 0)
        host, port = server.sockets[0].getsockname()
        reader, writer = await asyncio.open_connection(host, port)
        while not reader._buffer:
            await asyncio.sleep(0.001)
            assert loop.time() < 600.0
        writer.close()
        server.close()
        return True

    assert run_virtually(main())


def test_the_wall_clock_loop_starts_at_zero_and_does_not_jump():
    async def main():
        loop = asyncio.get_running_loop()
        begin = loop.time()
        await asyncio.sleep(0.05)
        return begin, loop.time() - begin

    with asyncio.Runner(loop_factory=RealtimeLoop) as runner:
        begin, slept = runner.run(main())
    assert 0.0 <= begin < 5.0
    assert slept >= 0.049
