"""Ticks on absolute deadlines, and what they cost in punctuality.

All time is the event loop's own (`loop.time()`), monotonic seconds.
"""

import asyncio
import math
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from flightapp.kernel_timer import KernelTimer

READINGS = 5
"""Pairs of readings of two clocks, of which the closest counts: a process may be held up between the two."""


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


def monotonic_origin(loop: asyncio.AbstractEventLoop) -> float:
    """CLOCK_MONOTONIC (s) when the time of ``loop`` was 0, from the pair of readings that lie closest together."""
    best, origin = math.inf, 0.0
    for _ in range(READINGS):
        before = loop.time()
        now = time.monotonic()
        after = loop.time()
        if after - before < best:
            best, origin = after - before, now - 0.5 * (before + after)
    return origin


class Ticker:
    """Ticks at ``rate`` Hz on absolute deadlines: a late tick doesn't shift the next one.

    Deadlines that passed unseen are skipped and counted in `overruns`. Waits by the event loop's own timers, whatever
    its clock, real or virtual; on the wall clock those are up to a millisecond late (see `KernelTicker`).
    """

    CAPACITY = 1 << 17

    def __init__(self, rate: float) -> None:
        if not 0.0 < rate < float("inf"):
            raise ValueError(f"a ticker's rate must be positive, not {rate} Hz")
        self._loop = asyncio.get_running_loop()
        self._period = 1.0 / rate
        self._origin = self._loop.time()
        self._count = 0
        self._stamps = np.zeros(self.CAPACITY)
        self._ticks = 0
        self._woken: asyncio.Future[None] | None = None
        self.overruns = 0

    async def tick(self) -> float:
        """Wait for the next deadline and return it as a stamp."""
        upcoming = int((self._loop.time() - self._origin) / self._period) + 1
        due = self._count + 1
        self.overruns += max(upcoming - due, 0)
        self._count = max(upcoming, due)
        deadline = self._origin + self._count * self._period
        self._woken = self._loop.create_future()
        self._wake_at(deadline)
        await self._woken
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
        p50, p99, p999 = (float(value) for value in np.percentile(between, (50.0, 99.0, 99.9)))
        return TickStatistics(float((n - 1) / (stamps[-1] - stamps[0])), p50, p99, p999, self.overruns)

    def close(self) -> None:
        """Give back what the ticker holds; it ticks no more."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _wake_at(self, deadline: float) -> None:
        """Have `_wake` called at ``deadline``, or very soon where it has passed."""
        self._loop.call_at(deadline, _wake, self._woken)


class KernelTicker(Ticker):
    """A `Ticker` on a kernel timer (timerfd, Linux): for loops on the wall clock.

    The loop's own timers are rounded up to the whole millisecond of epoll's timeout. The kernel's wakes at the
    deadline, by CLOCK_MONOTONIC, with which the loop's clock must run but for its origin. Close it, or use it as a
    context manager. Raises OSError where the kernel has no timer to give.
    """

    def __init__(self, rate: float) -> None:
        super().__init__(rate)
        self._ahead = monotonic_origin(self._loop)
        self._timer = KernelTimer()
        self._loop.add_reader(self._timer.fileno(), self._expired)

    def close(self) -> None:
        """Give the timer back; a second time changes nothing."""
        if self._timer.closed:
            return
        if not self._loop.is_closed():
            self._loop.remove_reader(self._timer.fileno())
        self._timer.close()

    def _wake_at(self, deadline: float) -> None:
        self._timer.set(deadline + self._ahead)

    def _expired(self) -> None:
        # Else a tick that was given up had expired, and the timer is set for the next one already.
        if self._timer.expired():
            _wake(self._woken)


def _wake(woken: "asyncio.Future[None] | None") -> None:
    if woken is not None and not woken.done():
        woken.set_result(None)
