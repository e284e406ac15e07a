import asyncio
import os
import time

import numpy as np
import pytest

from flightapp.kernel_timer import KernelTimer
from flightapp.timing import KernelTicker, Ticker, TickStatistics
from sim.clock import RealtimeLoop


class SteppedLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock jumps to the next deadline, so that waiting takes no time."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 5.0
        select = self._selector.select

        def jump(timeout: float | None = None) -> object:
            self.now += timeout or 0.0
            return select(0.0)

        self._selector.select = jump

    def time(self) -> float:
        return self.now


def run(work, *args):
    """``work(loop, …)`` to its end on a stepped loop."""
    loop = SteppedLoop()
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        return runner.run(work(loop, *args))


def test_deadlines_are_absolute() -> None:
    async def work(loop: SteppedLoop) -> tuple[list[float], int]:
        ticker = Ticker(250.0)
        stamps = []
        for i in range(1000):
            stamps.append(await ticker.tick())
            loop.now += 0.003 * (i % 2)  # work of up to three quarters of the period
        return stamps, ticker.overruns

    stamps, overruns = run(work)
    np.testing.assert_allclose(stamps, 5.0 + np.arange(1, 1001) / 250.0, rtol=0.0, atol=1e-12)
    assert overruns == 0


def test_deadlines_that_passed_are_skipped_and_counted() -> None:
    async def work(loop: SteppedLoop) -> tuple[list[float], int]:
        ticker = Ticker(100.0)
        stamps = [await ticker.tick()]
        loop.now += 0.035
        stamps += [await ticker.tick(), await ticker.tick()]
        return stamps, ticker.overruns

    stamps, overruns = run(work)
    np.testing.assert_allclose(stamps, (5.01, 5.05, 5.06), rtol=0.0, atol=1e-12)
    assert overruns == 3


def test_statistics_of_punctual_ticks() -> None:
    async def work(loop: SteppedLoop) -> TickStatistics:
        ticker = Ticker(200.0)
        for _ in range(400):
            await ticker.tick()
        return ticker.statistics()

    statistics = run(work)
    assert statistics.rate == pytest.approx(200.0)
    assert statistics.p50 == pytest.approx(0.005)
    assert statistics.p999 == pytest.approx(0.005)
    assert statistics.overruns == 0


def test_statistics_tell_a_late_tick() -> None:
    async def work(loop: SteppedLoop) -> TickStatistics:
        ticker = Ticker(100.0)
        for i in range(100):
            await ticker.tick()
            if i == 50:
                loop.now += 0.0999
        return ticker.statistics()

    statistics = run(work)
    assert statistics.p50 == pytest.approx(0.01)
    assert statistics.p999 > 0.09
    assert statistics.overruns == 9


def test_statistics_need_two_ticks_and_survive_a_full_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Ticker, "CAPACITY", 8)

    async def work(loop: SteppedLoop) -> tuple[TickStatistics, TickStatistics]:
        ticker = Ticker(50.0)
        none = ticker.statistics()
        for i in range(21):
            await ticker.tick()
            loop.now += 0.05 if i < 10 else 0.0
        return none, ticker.statistics()

    none, recent = run(work)
    assert none == TickStatistics(0.0, 0.0, 0.0, 0.0, 0)
    assert recent.rate == pytest.approx(50.0)
    assert recent.p999 == pytest.approx(0.02)


def test_on_the_wall_clock_no_tick_comes_before_its_deadline() -> None:
    async def work() -> None:
        ticker = Ticker(500.0)
        resolution = time.get_clock_info("monotonic").resolution
        for _ in range(20):
            deadline = await ticker.tick()
            assert asyncio.get_running_loop().time() >= deadline - 2.0 * resolution

    asyncio.run(work())


def on_the_wall(work, loop_factory=None):
    with asyncio.Runner(loop_factory=loop_factory) as runner:
        return runner.run(work())


@pytest.mark.parametrize("loop_factory", [None, RealtimeLoop])
def test_the_kernel_ticks_on_absolute_deadlines_in_the_loops_time(loop_factory):
    async def work():
        loop = asyncio.get_running_loop()
        begin = loop.time()
        with KernelTicker(250.0) as ticker:
            deadlines, now = [], []
            for _ in range(40):
                deadlines.append(await ticker.tick())
                now.append(loop.time())
        return begin, np.array(deadlines), np.array(now), ticker.overruns

    begin, deadlines, now, overruns = on_the_wall(work, loop_factory)
    steps = (deadlines - deadlines[0]) * 250.0
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert (np.diff(deadlines) > 0.0).all()
    assert deadlines[0] - begin > 0.003
    assert (now >= deadlines - 1e-6).all()
    assert np.rint(steps[-1]) + 1 - len(steps) <= overruns


@pytest.mark.parametrize("late", [0.03, 0.2])
def test_after_a_stall_the_kernel_ticker_skips_and_counts_and_never_bursts(late):
    async def work():
        loop = asyncio.get_running_loop()
        with KernelTicker(100.0) as ticker:
            before = await ticker.tick()
            time.sleep(late)  # noqa: ASYNC251
            resumed = loop.time()
            after = [await ticker.tick() for _ in range(3)]
            return before, resumed, after, ticker.overruns

    before, resumed, after, overruns = on_the_wall(work)
    assert after[0] > resumed
    assert np.diff(after).min() > 0.0099
    assert overruns >= round((after[0] - before) * 100.0) - 1 >= int(100.0 * late)


def test_a_kernel_tick_that_was_given_up_does_not_bring_the_next_one_early():
    async def work():
        loop = asyncio.get_running_loop()
        with KernelTicker(50.0) as ticker:
            waiting = asyncio.create_task(ticker.tick())
            await asyncio.sleep(0)
            time.sleep(0.021)  # noqa: ASYNC251
            waiting.cancel()
            deadline = await ticker.tick()
            return deadline, loop.time(), waiting.cancelled()

    deadline, now, cancelled = on_the_wall(work)
    assert cancelled
    assert now >= deadline - 1e-6


def test_a_kernel_timer_tells_its_expiration_once():
    timer = KernelTimer()
    timer.set(time.monotonic() + 60.0)
    assert not timer.expired()
    timer.set(time.monotonic() - 1.0)
    assert timer.expired()
    assert not timer.expired()
    timer.close()
    assert timer.closed


def test_news_of_an_expiration_that_came_too_late_does_not_wake():
    async def work():
        with KernelTicker(5.0) as ticker:
            waiting = asyncio.create_task(ticker.tick())
            await asyncio.sleep(0)
            ticker._expired()
            await asyncio.sleep(0.01)
            early = waiting.done()
            await waiting
            return early

    assert not on_the_wall(work)


def test_a_kernel_ticker_gives_its_descriptor_back():
    async def work():
        before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        ticker = KernelTicker(100.0)
        during = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        ticker.close()
        ticker.close()
        return before, during, len(os.listdir("/proc/self/fd"))  # noqa: PTH208

    before, during, after = on_the_wall(work)
    assert (during, after) == (before + 1, before)


def test_a_kernel_ticker_may_be_closed_after_its_loop():
    async def work():
        return KernelTicker(100.0)

    ticker = on_the_wall(work)
    ticker.close()
    with pytest.raises(OSError, match="timerfd_settime"):
        ticker._timer.set(0.0)


def test_the_rate_kept_by_the_kernel_is_the_one_asked_for():
    async def work():
        with KernelTicker(500.0) as ticker:
            for _ in range(100):
                await ticker.tick()
            return ticker.statistics()

    statistics = on_the_wall(work)
    periods = 99 + statistics.overruns
    assert statistics.rate == pytest.approx(99 / (periods / 500.0), rel=0.05)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
async def test_rate_must_be_positive(rate: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        Ticker(rate)


async def test_a_cancelled_tick_is_no_error() -> None:
    waiting = asyncio.create_task(Ticker(100.0).tick())
    await asyncio.sleep(0)
    waiting.cancel()
    await asyncio.sleep(0.02)
    assert waiting.cancelled()
