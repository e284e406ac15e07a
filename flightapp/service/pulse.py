"""Whether the service is well, as its watchdog is told: in flight by the sender's own ticks and by nothing else."""

import time
from collections.abc import Callable

SHARE = 0.5
"""Of the sender's stated rate that it must keep."""
PINGS = 4
"""Pings in the time within which the watchdog wants one."""


class Pulse:
    """Calls ``ping`` a few times in each ``period`` s while all is well; never for a ``period`` of 0.

    In flight only `tick`, which the sender's task calls at each turn, leads to a ping: where it stalls, ends, or comes
    too seldom, there is none. Before and after, `beat` does. By the wall clock.
    """

    def __init__(
        self,
        ping: Callable[[], None],
        period: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._ping, self._clock = ping, clock
        self._interval = period / PINGS
        self._rate: float | None = None
        self._since, self._ticks = clock(), 0

    def fly(self, rate: float) -> None:
        """A flight begins whose sender should tick ``rate`` times a second."""
        self._since, self._ticks = self._clock(), 0
        self._rate = rate

    def rest(self) -> None:
        """The flight is over."""
        self._rate = None

    def tick(self) -> None:
        """The sender has had its turn."""
        self._ticks += 1
        now = self._clock()
        elapsed = now - self._since
        if self._rate is None or elapsed < self._interval:
            return
        if self._interval > 0.0 and self._ticks >= SHARE * self._rate * elapsed:
            self._ping()
        self._since, self._ticks = now, 0

    def beat(self) -> None:
        """The service has had its turn, without a flight."""
        now = self._clock()
        if self._rate is None and self._interval > 0.0 and now - self._since >= self._interval:
            self._since = now
            self._ping()
