"""What the peer of a vehicle's link saw: when setpoints arrived, and what else was sent.

Stamps are the kernel's, taken when a packet arrived, so that they don't tell of this process's own load.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector
from sim.mavlink.setpoints import Setpoint

MEMORY = 1 << 18
"""Stamps that are kept: over 17 minutes at 250 Hz."""


@dataclass(frozen=True, slots=True)
class Statistics:
    """Of the setpoints that arrived; times in s, the vehicle's faults not counted."""

    count: int
    """All of them."""
    rate: float
    """Hz, over those whose stamps are kept."""
    p50: float
    p99: float
    p999: float
    longest: float
    """Times between two; NaN with less than two."""
    first: float
    last: float
    """CLOCK_MONOTONIC; NaN before the first."""
    setpoint: Setpoint | None
    """The last that the vehicle took."""
    targets: dict[tuple[int, int], int]
    """How many were sent to which system and component."""
    senders: dict[tuple[int, int], int]
    """How many packets came from which system and component."""
    messages: dict[str, int]
    """How many of each kind arrived."""
    corrupt: int
    """Packets that were not whole."""


class Watch:
    """Counts; add to it as things arrive."""

    def __init__(self) -> None:
        self._stamps = np.empty(MEMORY)
        self.setpoint: Setpoint | None = None
        self.corrupt = 0
        self.reset()

    def reset(self) -> None:
        """Forget what has arrived so far."""
        self._count = 0
        self._targets: Counter[tuple[int, int]] = Counter()
        self._senders: Counter[tuple[int, int]] = Counter()
        self._messages: Counter[str] = Counter()

    def message(self, name: str, system: int, component: int) -> None:
        """A message has come from this system and component."""
        self._messages[name] += 1
        self._senders[system, component] += 1

    def arrived(self, stamp: float, system: int, component: int) -> None:
        """A setpoint to this system and component arrived at ``stamp`` (CLOCK_MONOTONIC, s)."""
        self._stamps[self._count % MEMORY] = stamp
        self._count += 1
        self._targets[system, component] += 1

    def stamps(self) -> Vector:
        """(n,) arrivals of setpoints (CLOCK_MONOTONIC, s), oldest first: the last `MEMORY` of them."""
        if self._count <= MEMORY:
            return self._stamps[: self._count].copy()
        return np.roll(self._stamps, -(self._count % MEMORY))

    @property
    def count(self) -> int:
        """How many setpoints have arrived."""
        return self._count

    def since(self, count: int) -> Vector:
        """(n,) arrivals (CLOCK_MONOTONIC, s) after the first ``count`` setpoints, as far as they are kept."""
        fresh = np.arange(max(count, self._count - MEMORY), self._count)
        return self._stamps[fresh % MEMORY]

    def statistics(self) -> Statistics:
        """As of now."""
        stamps = self.stamps()
        gaps = np.diff(stamps)
        quantiles = np.quantile(gaps, (0.5, 0.99, 0.999, 1.0)).tolist() if len(gaps) else [np.nan] * 4
        p50, p99, p999, longest = quantiles
        first, last = (float(stamps[0]), float(stamps[-1])) if len(stamps) else (np.nan, np.nan)
        rate = len(gaps) / (last - first) if len(gaps) and last > first else 0.0
        return Statistics(
            self._count, rate, p50, p99, p999, longest, first, last, self.setpoint,
            dict(self._targets), dict(self._senders), dict(self._messages), self.corrupt,
        )  # fmt: skip
