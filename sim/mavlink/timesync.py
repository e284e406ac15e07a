"""The offset of a peer's clock, as PX4 learns it from the answers to its TIMESYNC requests.

After src/lib/timesync of PX4 v1.16: a double exponential filter over samples with a short round trip; stamps are
translated once it has converged, which at 10 requests a second takes about 50 s.
"""

import math

WINDOW = 500
"""Samples until it has converged."""
LONGEST_TRIP = 0.010
"""s, samples that took longer count for nothing."""
LARGEST_STEP = 0.1
"""s, further off than that the clock must have jumped…"""
JUMPS = 5
"""…if it happens so often in a row."""
_LEVEL_GAINS, _TREND_GAINS = (0.05, 0.003), (0.05, 0.003)
"""Of the filter, at first and once it has converged."""


class Timesync:
    """One peer's clock; times in s."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Know nothing, as after a boot."""
        self._count = self._jumps = 0
        self._offset = self._skew = 0.0

    @property
    def converged(self) -> bool:
        """Whether stamps are translated."""
        return self._count >= WINDOW

    def add(self, sent: float, remote: float, now: float) -> None:
        """Take in an answer: our request's time, the peer's stamp, our time of receipt."""
        trip, offset = now - sent, 0.5 * (sent + now) - remote
        if not 0.0 <= trip < LONGEST_TRIP:
            return
        if self.converged and abs(offset - self._offset) > LARGEST_STEP:
            self._jumps += 1
            if self._jumps > JUMPS:
                self.reset()
            return
        self._jumps = 0
        self._filter(offset)

    def _filter(self, offset: float) -> None:
        if self._count == 0:
            self._offset = offset
        else:
            progress = self._count / WINDOW
            share = 1.0 if progress >= 1.0 else 1.0 - math.exp(0.5 * (1.0 - 1.0 / (1.0 - progress)))
            level = share * _LEVEL_GAINS[1] + (1.0 - share) * _LEVEL_GAINS[0]
            trend = share * _TREND_GAINS[1] + (1.0 - share) * _TREND_GAINS[0]
            before = self._offset
            self._offset = level * offset + (1.0 - level) * (before + self._skew)
            self._skew = trend * (self._offset - before) + (1.0 - trend) * self._skew
        self._count += 1

    def translate(self, stamp: float, now: float) -> float:
        """Our time of the peer's ``stamp``; ``now``, the time of receipt, until it has converged."""
        return stamp + self._offset if self.converged else now
