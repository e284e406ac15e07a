"""Where computation goes that would hold the event loop up."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


class ThreadWorker:
    """Runs each kind of computation in a thread of its own, so that a slow one delays no other.

    MAVSDK's calls use the loop's default executor, which stays free of this work.
    """

    def __init__(self) -> None:
        self._threads: dict[str, ThreadPoolExecutor] = {}

    async def run(self, name: str, function: Callable[[], T]) -> T:
        """``function()``'s result, computed in the thread for ``name``."""
        thread = self._threads.get(name)
        if thread is None:
            thread = self._threads[name] = ThreadPoolExecutor(1, thread_name_prefix=name)
        return await asyncio.get_running_loop().run_in_executor(thread, function)

    def close(self) -> None:
        """Give the threads back; what they still compute is waited for."""
        for thread in self._threads.values():
            thread.shutdown()
