"""What may be asked of a flight from outside while it lasts: to land, to land at once, to go on with other gains."""

import asyncio
import contextlib
import signal
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Self

from flightapp.inputs import BadInputError

WAITING = 16
"""Retunings that may wait for their turn."""
NOTHING_FLIES = "nothing flies; what is set before a flight stands in the vehicle file, or in --set"


@dataclass(frozen=True, slots=True, eq=False)
class Retuning:
    """Somebody wants other gains."""

    settings: Mapping[str, str] | None
    """Value by section.key; None: the files are to be read anew."""
    answer: Future[str] = field(default_factory=Future)
    """What has changed, in words, or `BadInputError`."""

    def refuse(self, why: str) -> None:
        """Nothing comes of it, unless it has been answered."""
        if not self.answer.done():
            self.answer.set_exception(BadInputError(why))


class Orders:
    """The orders of one flight.

    `stop`, `abort` and `retune` may be called from any thread and from signal handlers, before the flight too: they
    hold nothing up and take no lock. The rest is for the flight's own event loop, within which it is a context manager.
    """

    def __init__(self) -> None:
        self.stopped = ""
        """Why the flight is to end, in words; empty while it is not."""
        self.aborted = ""
        """Why it is to land right where it is."""
        self.begun = False
        """Whether the flight has begun; it stays so."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._retunings: deque[Retuning] = deque()
        self._end, self._tune = asyncio.Event(), asyncio.Event()

    @property
    def flying(self) -> bool:
        """Whether the flight has begun and is not over."""
        return self._loop is not None

    def stop(self, why: str) -> None:
        """Have it come to rest along its line and land; the first reason counts."""
        self.stopped = self.stopped or why
        self._tell()

    def abort(self, why: str) -> None:
        """Have the autopilot land it right where it is, also where it is coming to rest already."""
        self.aborted = self.aborted or why
        self.stop(why)

    def retune(self, settings: Mapping[str, str] | None) -> Future[str]:
        """Have it go on with other ``settings``, or with what its files say now (None)."""
        asked = Retuning(settings)
        if len(self._retunings) >= WAITING:
            asked.refuse(f"{WAITING} changes wait already; try again")
            return asked.answer
        self._retunings.append(asked)
        if self._loop is None:
            self._refuse_all()
        self._tell()
        return asked.answer

    def __enter__(self) -> Self:
        self._loop, self.begun = asyncio.get_running_loop(), True
        self._take()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop = None
        self._refuse_all()

    async def ended(self) -> str:
        """Why the flight is to end, as soon as it is."""
        await self._end.wait()
        return self.stopped

    async def retuning(self) -> Retuning:
        """The next that is asked for."""
        while not self._retunings:
            self._tune.clear()
            await self._tune.wait()
        return self._retunings.popleft()

    def _tell(self) -> None:
        loop = self._loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # it is closed: the flight is over
                loop.call_soon_threadsafe(self._take)

    def _take(self) -> None:
        if self.stopped:
            self._end.set()
        if self._retunings:
            self._tune.set()

    def _refuse_all(self) -> None:
        with contextlib.suppress(IndexError):
            while True:
                self._retunings.popleft().refuse(NOTHING_FLIES)


@contextlib.contextmanager
def signalled() -> Iterator[Orders]:
    """Orders that SIGINT and SIGTERM (stop) and SIGHUP (read the files anew) give, in the main thread.

    Only the first of those that stop counts: the landing goes on.
    """
    orders = Orders()
    if threading.current_thread() is not threading.main_thread():
        yield orders
        return

    def caught(number: int, _: object) -> None:
        if number == signal.SIGHUP:
            orders.retune(None)
        else:
            orders.stop(f"interrupted by {signal.Signals(number).name}")

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, caught) for number in numbers}
    try:
        yield orders
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
