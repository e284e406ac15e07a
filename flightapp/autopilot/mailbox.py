"""From MAVSDK's callback thread to the event loop: the newest message only, and never a queue that grows."""

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from flightapp.timing import monotonic_origin

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Hands what a thread puts in over to the loop, which calls ``deliver`` with arrival stamp and content.

    While the loop is busy only the last ``depth`` remain; `missed` counts what was pushed out. Stamps are the loop's
    time, taken when the message was put in.
    """

    def __init__(self, deliver: Callable[[float, T], None], depth: int = 1) -> None:
        self._loop = asyncio.get_running_loop()
        self._origin = monotonic_origin(self._loop)
        self._deliver = deliver
        self._waiting: deque[tuple[float, T]] = deque(maxlen=depth)
        self._lock = threading.Lock()
        self._called = False
        self._arrivals: deque[float] = deque(maxlen=64)
        self.missed = 0

    def put(self, content: T) -> None:
        """Leave ``content``; from any thread."""
        stamp = time.monotonic() - self._origin
        self._arrivals.append(stamp)
        with self._lock:
            self.missed += len(self._waiting) == self._waiting.maxlen
            self._waiting.append((stamp, content))
            if self._called:
                return
            self._called = True
        try:
            self._loop.call_soon_threadsafe(self._empty)
        except RuntimeError:  # the loop was closed while the last messages came in
            self._waiting.clear()

    def _empty(self) -> None:
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
            self._called = False
        for stamp, content in waiting:
            self._deliver(stamp, content)

    def rate(self) -> float:
        """Messages per second lately; 0 when none came for two seconds."""
        arrivals = list(self._arrivals)
        if len(arrivals) < 2 or self._loop.time() - arrivals[-1] > 2.0:
            return 0.0
        return (len(arrivals) - 1) / max(arrivals[-1] - arrivals[0], 1e-6)
