"""What the service writes to standard error, for the journal: by a thread, as a pipe may be full."""

import contextlib
import os
import sys
import threading
from collections import deque
from typing import IO

WAITING = 1000
"""Lines that may wait; the oldest of more are lost."""
LOOK = 0.1
"""s between looks at what waits."""
ERROR, NOTICE = 3, 5
"""Levels of syslog."""


class Journal:
    """Lines with their level, which systemd takes off where it reads them. `write` may be called from anywhere."""

    def __init__(self, stream: IO[str] | None = None) -> None:
        self._stream = stream or sys.stderr
        self._levels = "JOURNAL_STREAM" in os.environ
        self._lines: deque[str] = deque(maxlen=WAITING)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def write(self, text: str, level: int = NOTICE) -> None:
        """Have ``text`` written."""
        self._lines.append(f"<{level}>{text}" if self._levels else text)

    def close(self) -> None:
        """Write what is left, unless nobody takes it."""
        self._over.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        while not self._over.wait(LOOK):
            self._drain()
        self._drain()

    def _drain(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            while self._lines:
                self._stream.write(" ".join(self._lines.popleft().split()) + "\n")
            self._stream.flush()
