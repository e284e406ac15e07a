"""What is asked of the interpreter and the operating system so that a flight is not held up.

The event loop and the autopilot link's own threads run under SCHED_FIFO, the memory is locked, the garbage collector
is off. Worker threads stay under the ordinary scheduler: under FIFO, even of a lower priority, a planner that computed
for long starved the process that the poses come from. What isn't permitted is told, with how to permit it, and flown
without.
"""

import ctypes
import gc
import os
import resource
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from flightapp.config import Realtime

SWITCH_INTERVAL = 2e-4
"""s"""
MCL_CURRENT, MCL_FUTURE = 1, 2
CAP_IPC_LOCK = 14
"""Bit of the capability to lock memory beyond the limit (linux/capability.h)."""
TASKS = Path("/proc/self/task")
FIFO_HOW = (
    "LimitRTPRIO={priority} or AmbientCapabilities=CAP_SYS_NICE in the systemd unit, or rtprio {priority} in"
    " /etc/security/limits.conf"
)
MEMORY_HOW = "LimitMEMLOCK=infinity or AmbientCapabilities=CAP_IPC_LOCK in the systemd unit, or ulimit -l unlimited"


@dataclass(frozen=True, slots=True)
class Step:
    """One thing that was asked of the operating system."""

    what: str
    granted: bool
    detail: str
    """What was granted; where it was not, why, and how to permit it."""


@dataclass(frozen=True, slots=True)
class RealtimeReport:
    """All that was asked for; what the configuration leaves alone is not in it."""

    steps: tuple[Step, ...]

    @property
    def granted(self) -> bool:
        """Whether everything was."""
        return all(step.granted for step in self.steps)


def describe(report: RealtimeReport) -> str:
    """``report`` as one line for the log."""
    if not report.steps:
        return "real time: nothing asked for"
    granted = [f"{step.what} ({step.detail})" for step in report.steps if step.granted]
    refused = [f"{step.what} ({step.detail})" for step in report.steps if not step.granted]
    parts = [f"granted: {', '.join(granted)}"] if granted else []
    parts += [f"NOT permitted: {'; '.join(refused)}"] if refused else []
    return f"real time: {'; '.join(parts)}"


class RealtimeSession:
    """What is asked of the operating system while it lasts, as a context manager, and how it was before.

    Nothing raises: what the operating system refuses is in the report. For flights on the wall clock only.
    """

    def __init__(self, config: Realtime) -> None:
        self._config = config
        self._steps: list[Step] = []
        self._adopted: list[tuple[str, list[int]]] = []
        self._begun = False
        self._before: set[int] = set()
        self._scheduling: dict[int, tuple[int, int]] = {}
        self._affinity: dict[int, set[int]] = {}
        self._usual = os.sched_getaffinity(0)
        self._locked = False

    @property
    def report(self) -> RealtimeReport:
        """What was granted and what was not."""
        return RealtimeReport(tuple(self._steps))

    def __enter__(self) -> Self:
        self.begin()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def begin(self) -> None:
        """Ask for everything that concerns the process, for FIFO for the calling thread and for those adopted."""
        config = self._config
        self._begun, self._before = True, set(_threads())
        if config.lock_memory:
            self._lock_memory()
        if config.cpus:
            self._pin(set(config.cpus))
        if config.priority:
            # Reset on fork: threads that the loop starts, workers above all, begin under the ordinary scheduler.
            loop = (threading.get_native_id(),)
            self._prioritise("SCHED_FIFO for the event loop", loop, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK)
            for name, threads in self._adopted:
                self._prioritise(f"SCHED_FIFO for {name}'s threads", threads)

    @contextmanager
    def adopting(self, name: str) -> Iterator[None]:
        """Treat the native threads that come into being inside as the event loop; ``name`` says whose they are.

        They, and threads that they start, run under FIFO while the session lasts, whether it has begun already or
        begins later. Threads of Python's own, such as workers, are left alone.
        """
        before = set(_threads())
        yield
        born = sorted(set(_threads()) - before - _python_threads())
        if not born:
            return
        self._adopted.append((name, born))
        if self._begun and self._config.priority:
            self._prioritise(f"SCHED_FIFO for {name}'s threads", born)

    def end(self) -> None:
        """Put back what was changed."""
        for tid in set(_threads()) - self._before if self._adopted and self._config.priority else ():
            with suppress(OSError):  # started by an adopted one
                if os.sched_getscheduler(tid) == os.SCHED_FIFO:
                    self._scheduling.setdefault(tid, (os.SCHED_OTHER, 0))
        for tid, (policy, priority) in self._scheduling.items():
            with suppress(OSError):  # the thread may have ended
                os.sched_setscheduler(tid, policy, os.sched_param(priority))
        if self._affinity:
            for tid in _threads():
                with suppress(OSError):
                    os.sched_setaffinity(tid, self._affinity.get(tid, self._usual))
        if self._locked:
            ctypes.CDLL(None).munlockall()
        self._scheduling, self._affinity, self._locked = {}, {}, False
        self._begun = False

    def _prioritise(self, what: str, threads: Iterable[int], policy: int = os.SCHED_FIFO) -> None:
        priority, count = self._config.priority, 0
        try:
            for tid in threads:
                was = (os.sched_getscheduler(tid), os.sched_getparam(tid).sched_priority)
                os.sched_setscheduler(tid, policy, os.sched_param(priority))
                self._scheduling[tid] = was
                count += 1
        except ProcessLookupError:
            self._note(what, False, "a thread ended meanwhile")
        except OSError as error:
            self._note(what, False, f"{error.strerror}; permit it by {FIFO_HOW.format(priority=priority)}")
        else:
            self._note(what, True, f"priority {priority}, {count} {'thread' if count == 1 else 'threads'}")

    def _lock_memory(self) -> None:
        what = "memory locked"
        limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
        if limit != resource.RLIM_INFINITY and not _capable(CAP_IPC_LOCK):
            # Were it granted below the limit, allocations beyond it would fail in flight.
            self._note(what, False, f"at most {limit / 2**20:.3g} MB are permitted; permit it by {MEMORY_HOW}")
            return
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
            self._note(what, False, f"{os.strerror(ctypes.get_errno())}; permit it by {MEMORY_HOW}")
            return
        self._locked = True
        self._note(what, True, f"{resident() / 2**20:.0f} MB resident")

    def _pin(self, cpus: set[int]) -> None:
        what = f"CPUs {', '.join(map(str, sorted(cpus)))}"
        if missing := cpus - self._usual:
            there = ", ".join(map(str, sorted(self._usual)))
            absent = ", ".join(map(str, sorted(missing)))
            self._note(what, False, f"there is no CPU {absent} for this process; realtime.cpus may name {there}")
            return
        for tid in _threads():
            with suppress(OSError):  # the thread may have ended
                self._affinity[tid] = os.sched_getaffinity(tid)
                os.sched_setaffinity(tid, cpus)
        self._note(what, os.sched_getaffinity(0) == cpus, f"of {len(self._usual)}")

    def _note(self, what: str, granted: bool, detail: str) -> None:
        self._steps.append(Step(what, granted, detail))


@contextmanager
def undisturbed() -> Iterator[None]:
    """Keep the interpreter from pausing the flight.

    The garbage collector stays off, and what was made before is never looked at again; a thread that wants the
    interpreter waits 0.2 ms for it instead of 5 ms.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(interval)


def _threads() -> list[int]:
    """Every thread of this process, by its id; none where there is no /proc."""
    try:
        return [int(entry.name) for entry in TASKS.iterdir()]
    except OSError:
        return []


def _python_threads() -> set[int]:
    """Those that Python started; native ones that have called into it are not among them."""
    known = (thread for thread in threading.enumerate() if not isinstance(thread, threading._DummyThread))
    return {thread.native_id for thread in known if thread.native_id is not None}


def _capable(capability: int) -> bool:
    """Whether this process has a capability in effect."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    effective = next((line.split()[1] for line in status.splitlines() if line.startswith("CapEff:")), "0")
    return bool(int(effective, 16) >> capability & 1)


def resident() -> int:
    """Bytes of memory that this process occupies."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")
