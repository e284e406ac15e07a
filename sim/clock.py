"""Event loops for simulated flights: one whose clock jumps, one on the wall clock; both start at 0."""

import asyncio
import selectors
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import FileDescriptorLike


class NothingToWaitForError(RuntimeError):
    """Every task waits for something that no timer will ever bring about."""


class _JumpingSelector(selectors.BaseSelector):
    """Where the loop would sleep, its clock jumps ahead instead; files and signals are still polled."""

    POLL_EVERY = 0.01
    """s of virtual time between looks at files and signals."""

    def __init__(self) -> None:
        self.now = 0.0
        self._files = selectors.DefaultSelector()
        self._polled = -self.POLL_EVERY

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            ready = self._files.select(0)
            if not ready:
                raise NothingToWaitForError("the simulated flight waits for something that will never happen")
            return ready
        if timeout > 0.0:
            self.now += timeout
        if self.now - self._polled >= self.POLL_EVERY:
            self._polled = self.now
            return self._files.select(0)
        return []

    def register(self, fileobj: "FileDescriptorLike", events: int, data: object = None) -> selectors.SelectorKey:
        return self._files.register(fileobj, events, data)

    def unregister(self, fileobj: "FileDescriptorLike") -> selectors.SelectorKey:
        return self._files.unregister(fileobj)

    def modify(self, fileobj: "FileDescriptorLike", events: int, data: object = None) -> selectors.SelectorKey:
        return self._files.modify(fileobj, events, data)

    def get_key(self, fileobj: "FileDescriptorLike") -> selectors.SelectorKey:
        return self._files.get_key(fileobj)

    def get_map(self) -> Mapping["FileDescriptorLike", selectors.SelectorKey]:
        return self._files.get_map()

    def close(self) -> None:
        self._files.close()


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop whose time is virtual: it is always exactly at the deadline that is being served.

    Nothing sleeps, so a flight takes as long as its computation does; the order of events depends on
    nothing but the program. Threads must not be used with it.
    """

    def __init__(self) -> None:
        self._selector_clock = _JumpingSelector()
        super().__init__(self._selector_clock)

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._selector_clock.now

    def stall(self, seconds: float) -> None:
        """Let ``seconds`` pass in which nothing has its turn."""
        self._selector_clock.now += seconds


class RealtimeLoop(asyncio.SelectorEventLoop):
    """An ordinary event loop whose time starts at 0 now, or at ``origin`` (s by CLOCK_MONOTONIC)."""

    def __init__(self, origin: float | None = None) -> None:
        self._origin = 0.0
        super().__init__()
        self._origin = super().time() if origin is None else origin

    def time(self) -> float:
        """Seconds on the wall since the origin."""
        return super().time() - self._origin

    def stall(self, seconds: float) -> None:
        """Let ``seconds`` pass in which nothing has its turn."""
        time.sleep(seconds)
