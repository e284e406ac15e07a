"""The offset between the autopilot's clock and ours, from TIMESYNC exchanges."""

from collections import deque
from dataclasses import dataclass

WINDOW = 40
"""Exchanges that are remembered: 20 s at 2 Hz."""
STEP = 0.05
"""s, a change of the offset beyond what round trips explain: the other clock was set anew, or it rebooted."""


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """Time from a request to its answer, s."""

    count: int
    p50: float
    longest: float


class ClockOffset:
    """Estimates how far the autopilot's clock is ahead of ours.

    Of the recent exchanges the one with the shortest round trip tells the offset best (NTP's clock filter, RFC 5905
    section 10), since what makes an answer late is queueing, which is seldom the same both ways.
    """

    def __init__(self) -> None:
        self._exchanges: deque[tuple[float, float]] = deque(maxlen=WINDOW)
        self.steps = 0
        """How often the autopilot's clock was found to have jumped."""

    def add(self, sent: float, remote: float, received: float) -> None:
        """Take in an exchange: our stamps (s) of request and answer, and the autopilot's in between."""
        trip = received - sent
        if not 0.0 <= trip < 1.0:
            return
        offset = remote - 0.5 * (sent + received)
        if self._exchanges:
            shortest, known = min(self._exchanges)
            if abs(offset - known) > STEP + 0.5 * (trip + shortest):
                self._exchanges.clear()
                self.steps += 1
        self._exchanges.append((trip, offset))

    @property
    def offset(self) -> float | None:
        """s that the autopilot's clock is ahead of ours; None before the first exchange."""
        return min(self._exchanges)[1] if self._exchanges else None

    def to_ours(self, remote: float) -> float | None:
        """Our stamp of the moment ``remote`` (s) by the autopilot's clock; None before the first exchange."""
        offset = self.offset
        return None if offset is None else remote - offset

    @property
    def round_trip(self) -> RoundTrip | None:
        """Round trips of the exchanges that are remembered; None before the first."""
        trips = sorted(trip for trip, _ in self._exchanges)
        return RoundTrip(len(trips), trips[len(trips) // 2], trips[-1]) if trips else None
