"""Work in processes, each started once. One that dies loses only what it was at, and that is tried again.

A pool of `concurrent.futures` or of loky breaks as a whole when a process dies, and does not say at which job.
"""

import gc
import itertools
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Generic, TypeVar

J = TypeVar("J")
R = TypeVar("R")

ATTEMPTS = 3
"""Times that a job is begun before it counts as lost."""
TIDIED = 20
"""Jobs after which a process throws away what they have left: a flight stops the collector, which then overlooks it."""


@dataclass(frozen=True, slots=True)
class Lost:
    """What is known of a job whose process died each time."""

    why: str


class _Worker(Generic[J, R]):
    """A process, and the job that it is at."""

    def __init__(self, function: Callable[[J], R]) -> None:
        self.function = function
        self.job: int | None = None
        context = get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process: SpawnProcess = context.Process(target=_serve, args=(theirs, function), daemon=True)
        self._process.start()
        theirs.close()

    def begin(self, number: int, job: J) -> None:
        """Hand over ``job``; that the process is dead is noticed when its answer is asked for."""
        self.job = number
        with suppress(OSError):
            self.connection.send(job)

    def end(self) -> int:
        """It is at nothing any more; the job that it was at."""
        number, self.job = self.job, None
        if number is None:
            raise RuntimeError("this worker was not at any job")
        return number

    def answer(self) -> R:
        """What came of its job; raises what that raised, and EOFError or OSError if the process died."""
        good, value = self.connection.recv()
        if not good:
            raise value
        result: R = value
        return result

    def death(self) -> str:
        """How the process, which is dead, died."""
        self._process.join()
        code = self._process.exitcode or 0
        return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit status {code}"

    def stop(self) -> None:
        """End the process, whatever it is at."""
        self.connection.close()
        self._process.kill()
        self._process.join()


def work(function: Callable[[J], R], jobs: Sequence[J], workers: int) -> Iterator[tuple[int, R | Lost]]:
    """``function`` of each of ``jobs`` in so many processes: the number of each job with its result, as they end.

    What ``function`` raises is raised here and ends everything. Jobs are begun in their order.
    """
    waiting = deque((number, 1) for number in range(len(jobs)))
    attempts: dict[int, int] = {}
    pool: list[_Worker[J, R]] = []
    try:
        while waiting or any(worker.job is not None for worker in pool):
            while waiting and len(pool) < workers:
                pool.append(_Worker(function))
            for worker in pool:
                if worker.job is None and waiting:
                    number, attempts[number] = waiting.popleft()
                    worker.begin(number, jobs[number])
            busy: list[Connection] = [worker.connection for worker in pool if worker.job is not None]
            for ready in wait(busy):
                worker = next(worker for worker in pool if worker.connection is ready)
                number = worker.end()
                try:
                    yield number, worker.answer()
                except (EOFError, ConnectionError):
                    pool.remove(worker)
                    if attempts[number] < ATTEMPTS:
                        waiting.appendleft((number, attempts[number] + 1))
                    else:
                        yield number, Lost(f"its process {worker.death()}, {ATTEMPTS} times")
                    worker.stop()
    finally:
        for worker in pool:
            worker.stop()


def _serve(connection: Connection, function: Callable[[J], R]) -> None:
    """Do one job after the other until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that asks is interrupted too, and ends this one
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        for number in itertools.count(1):
            job = connection.recv()
            try:
                answer = True, function(job)
            except Exception as error:  # it is for the process that asked
                connection.send((False, error))
            else:
                connection.send(answer)
            if number % TIDIED == 0:
                gc.collect()


def _end_with_parent() -> None:
    """End this process, whatever it is at, when the one that asks is gone."""
    if (parent := parent_process()) is not None:
        wait([parent.sentinel])
        os._exit(1)
