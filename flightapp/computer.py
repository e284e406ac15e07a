"""The computer that the application runs on, as far as a flight depends on it."""

import asyncio
import math
import shutil
import time
from io import RawIOBase
from pathlib import Path

MEGABYTE = 1e6


class OwnComputer:
    """The real one."""

    def disk_free(self, directory: Path) -> float:
        """MB that are free where ``directory`` is; NaN where that can't be told."""
        try:
            return shutil.disk_usage(directory).free / MEGABYTE
        except OSError:
            return math.nan

    def clock_offset(self) -> float:
        """s by which the wall clock is ahead of the event loop's time."""
        return time.time() - asyncio.get_running_loop().time()

    def create(self, path: Path) -> RawIOBase:
        """A new file to write to, unbuffered; raises OSError, also later at each write."""
        return path.open("xb", buffering=0)
