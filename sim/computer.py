"""The simulated drone's computer, and what sim.faults does to it."""

import errno
import math
import os
from collections.abc import Callable, Sequence
from io import FileIO, RawIOBase
from pathlib import Path
from typing import TypeVar

from flightapp.interfaces import PlanningError, Worker
from sim.clock import RealtimeLoop, VirtualLoop
from sim.faults import BUSY, IDLE, Fault, acting, named

T = TypeVar("T")

DISK = 50_000.0
"""MB that are free unless a fault says otherwise."""


class SimComputer:
    """A computer with a clock and a disk of its own; ``time`` is the flight's."""

    def __init__(self, faults: Sequence[Fault], time: Callable[[], float]) -> None:
        self._faults = named(faults, "disk_full", "log_failing", "clock_jump")
        self._time = time

    def disk_free(self, directory: Path) -> float:
        """MB."""
        full = acting(self._faults, "disk_full", self._time())
        return DISK if full is None else full.amount[0]

    def clock_offset(self) -> float:
        """s, the sum of all jumps so far."""
        now = self._time()
        return math.fsum(fault.amount[0] for fault in named(self._faults, "clock_jump") if fault.acts(now))

    def create(self, path: Path) -> RawIOBase:
        """A new file; writing to it fails while the log is to."""
        return _File(path, lambda: acting(self._faults, "log_failing", self._time()) is not None)


class _File(FileIO):
    """A file on a disk that may fail."""

    def __init__(self, path: Path, failing: Callable[[], bool]) -> None:
        super().__init__(path, "xb")
        self._failing = failing

    def write(self, data: bytes | bytearray | memoryview) -> int:  # type: ignore[override]
        if self._failing():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


class FaultyWorker:
    """A worker whose plans may fail."""

    def __init__(self, worker: Worker, faults: Sequence[Fault], time: Callable[[], float]) -> None:
        self._worker, self._time = worker, time
        self._faults = named(faults, "planner_failing")

    async def run(self, name: str, function: Callable[[], T]) -> T:
        """As the worker does, unless it is a plan that is to fail."""
        if name == "plan" and acting(self._faults, "planner_failing", self._time()):
            return await self._worker.run(name, _fail)
        return await self._worker.run(name, function)

    def close(self) -> None:
        """Close the worker."""
        self._worker.close()


def _fail() -> T:  # type: ignore[type-var]
    raise PlanningError("the planner fails, as simulated")


def slow_down(faults: Sequence[Fault], stamp: float) -> float:
    """How many times longer computation takes at ``stamp``."""
    slow = acting(faults, "compute_slow", stamp)
    return 1.0 if slow is None else slow.amount[0]


def hold_up(loop: VirtualLoop | RealtimeLoop, faults: Sequence[Fault]) -> None:
    """Have the event loop miss its turns when ``faults`` say so."""

    def busy(end: float) -> None:
        if loop.time() < end:
            loop.stall(BUSY)
            loop.call_later(IDLE, busy, end)

    for fault in named(faults, "loop_stall"):
        loop.call_at(fault.begin, loop.stall, fault.amount[0])
    for fault in named(faults, "loop_busy"):
        loop.call_at(fault.begin, busy, fault.end)
