"""The recorder: a tap on every topic that never holds the flight up."""

import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from flightapp.channel import Topic
from flightapp.recording.writer import FlightLog

T = TypeVar("T")

CAPACITY = 8192
"""Messages that may wait: about seven seconds of a flight."""
DRAIN_INTERVAL = 0.02
"""s between the thread's looks at the queue."""


class Recorder:
    """Writes what flows through topics to ``log``.

    With ``threaded``, messages wait in a queue of at most ``capacity`` that one thread drains; what finds it
    full is dropped and counted. Without, they are written at once, so that a simulation in virtual time is
    complete and repeatable.
    """

    def __init__(self, log: FlightLog, capacity: int = CAPACITY, *, threaded: bool) -> None:
        self._log = log
        self._capacity = capacity
        self._queue: deque[tuple[str, Any]] = deque()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True) if threaded else None
        self.dropped = 0
        """Messages that found the queue full."""
        self.refused = 0
        """Messages that could not be encoded: a wrong shape, a stamp that is not finite, no schema."""
        self.reason = ""
        """Why the last of them was refused."""
        if self._thread is not None:
            self._thread.start()

    @property
    def error(self) -> OSError | None:
        """Why writing stopped, if it did; what comes then is lost, and nothing else happens."""
        return self._log.error

    def tap(self, topic: Topic[T], name: str | None = None, *, every: int = 1) -> None:
        """Record one in ``every`` messages of ``topic`` from now on, as ``name`` (the topic's own, if None)."""
        take = self._put if self._thread is not None else self._write
        tap = partial(take, topic.name if name is None else name)
        topic.tap(tap if every == 1 else _thinned(tap, every))

    def close(self, **entries: str) -> None:
        """Write what waits, add ``entries`` (such as the outcome) to the log's header and close the log.

        Raises the OSError that stopped the writing, if one did.
        """
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
        for count, label in ((self.dropped, "dropped"), (self.refused, "refused")):
            if count:
                entries[label] = str(count)
        if entries:
            self._log.annotate(entries)
        self._log.close()

    def _put(self, name: str, message: object) -> None:
        if len(self._queue) < self._capacity:
            self._queue.append((name, message))
        else:
            self.dropped += 1

    def _write(self, name: str, message: object) -> None:
        try:
            self._log.write(name, message)
        except Exception as error:  # a tap must not raise, whatever a module has published
            self.refused += 1
            self.reason = f"{name}: {error}"

    def _run(self) -> None:
        stopping = False
        while not stopping:
            stopping = self._stop.wait(DRAIN_INTERVAL)
            while self._queue:
                self._write(*self._queue.popleft())


def _thinned(take: Callable[[object], None], every: int) -> Callable[[object], None]:
    count = 0

    def tap(message: object) -> None:
        nonlocal count
        if count % every == 0:
            take(message)
        count += 1

    return tap
