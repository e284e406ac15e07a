"""The states of the last moments, for what is seen later than it happened."""

from bisect import bisect_right
from collections import deque

from flightapp.messages import VehicleState

KEPT = 128
"""States: more than half a second at 200 Hz."""


class RecentStates:
    """The last `KEPT` states, in order of their stamps."""

    def __init__(self) -> None:
        self._states: deque[VehicleState] = deque(maxlen=KEPT)

    def add(self, state: VehicleState) -> None:
        """Take ``state`` over; one that is not newer than the last is left out."""
        if not self._states or state.stamp > self._states[-1].stamp:
            self._states.append(state)

    def at(self, stamp: float) -> VehicleState | None:
        """The last state up to ``stamp``, or the oldest that is known; None before the first."""
        if not self._states:
            return None
        place = bisect_right(self._states, stamp, key=lambda state: state.stamp)
        return self._states[max(place - 1, 0)]
