"""The common data channel: typed topics that hold the newest message."""

import asyncio
from collections.abc import Callable
from typing import Generic, TypeVar, cast

T = TypeVar("T")

Tap = Callable[[T], object]


class Topic(Generic[T]):
    """The newest message of one kind.

    A consumer that falls behind skips to the newest; nothing queues here. Taps are called at once, in
    the order in which they were added, for every message; they must be quick and must not raise.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.latest: T | None = None
        self.count = 0
        self._waiters: list[asyncio.Future[T]] = []
        self._taps: list[Tap[T]] = []

    def publish(self, message: T) -> None:
        """Make ``message`` the newest one, wake who waits and call the taps."""
        self.latest = message
        self.count += 1
        for tap in self._taps:
            tap(message)
        if self._waiters:
            waiters, self._waiters = self._waiters, []
            for waiter in waiters:
                if not waiter.done():
                    waiter.set_result(message)

    async def next(self) -> T:
        """The next message that will be published after this call."""
        waiter: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        try:
            return await waiter
        except asyncio.CancelledError:
            if waiter in self._waiters:
                self._waiters.remove(waiter)
            raise

    def tap(self, callback: Tap[T]) -> None:
        """Have ``callback`` called with every message from now on."""
        self._taps.append(callback)


class Reader(Generic[T]):
    """One consumer's place on a topic: each message is taken at most once, the newest first."""

    def __init__(self, topic: Topic[T]) -> None:
        self._topic = topic
        self._seen = topic.count

    async def newest(self) -> T:
        """The newest message that this reader has not taken yet; waits if there is none."""
        if self._topic.count == self._seen:
            await self._topic.next()
        # More may have been published between the waking and now.
        self._seen = self._topic.count
        return cast(T, self._topic.latest)
