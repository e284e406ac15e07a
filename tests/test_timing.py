import asyncio
import time

import numpy as np
import pytest

from flightapp.timing import Ticker, TickStatistics


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


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
async def test_rate_must_be_positive(rate: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        Ticker(rate)


async def test_a_cancelled_tick_is_no_error() -> None:
    waiting = asyncio.create_task(Ticker(100.0).tick())
    await asyncio.sleep(0)
    waiting.cancel()
    await asyncio.sleep(0.02)
    assert waiting.cancelled()
