"""Ticks on absolute deadlines, and what they cost in punctuality.

All time is the event loop's own (`loop.time()`), monotonic seconds.
"""

import asyncio
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class TickStatistics:
    """How punctual a periodic task was.

    `rate` is in Hz; `p50`, `p99` and `p999` are of the time between ticks, in seconds.
    `overruns` counts deadlines that had passed before the task asked for them.
    """

    rate: float
    p50: float
    p99: float
    p999: float
    overruns: int


class Ticker:
    """Ticks at ``rate`` Hz on absolute deadlines: a late tick doesn't shift the next one.

    Deadlines that passed unseen are skipped and counted in `overruns`.
    """

    CAPACITY = 1 << 17

    def __init__(self, rate: float) -> None:
        if not rate > 0.0:
            raise ValueError(f"a ticker's rate must be positive, not {rate} Hz")
        self._loop = asyncio.get_running_loop()
        self._period = 1.0 / rate
        self._origin = self._loop.time()
        self._count = 0
        self._stamps = np.zeros(self.CAPACITY)
        self._ticks = 0
        self.overruns = 0

    async def tick(self) -> float:
        """Wait for the next deadline and return it as a stamp."""
        upcoming = int((self._loop.time() - self._origin) / self._period) + 1
        due = self._count + 1
        self.overruns += max(upcoming - due, 0)
        self._count = max(upcoming, due)
        deadline = self._origin + self._count * self._period
        woken = self._loop.create_future()
        self._loop.call_at(deadline, _wake, woken)
        await woken
        self._stamps[self._ticks % self.CAPACITY] = self._loop.time()
        self._ticks += 1
        return deadline

    def statistics(self) -> TickStatistics:
        """Punctuality over (at most) the last `CAPACITY` ticks."""
        n = min(self._ticks, self.CAPACITY)
        stamps = np.sort(self._stamps[:n])
        if n < 2:
            return TickStatistics(0.0, 0.0, 0.0, 0.0, self.overruns)
        between = np.diff(stamps)
        p50, p99, p999 = np.percentile(between, (50.0, 99.0, 99.9))
        return TickStatistics((n - 1) / (stamps[-1] - stamps[0]), p50, p99, p999, self.overruns)


def _wake(woken: "asyncio.Future[None]") -> None:
    if not woken.done():
        woken.set_result(None)
