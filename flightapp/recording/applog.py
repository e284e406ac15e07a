"""The application's own log: one JSON object a line, stamped with the flight's time."""

import contextlib
from pathlib import Path
from types import TracebackType
from typing import Self

import structlog

from flightapp.messages import Event


class AppLog:
    """Writes events to ``path`` as JSON lines, each at once."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="utf-8", buffering=1)
        self.error: OSError | None = None
        """Why the last of what could not be written was not."""
        self._log = structlog.wrap_logger(
            structlog.PrintLogger(self._file),
            processors=[structlog.processors.JSONRenderer(ensure_ascii=False)],
        )

    def write(self, event: Event) -> None:
        """Log ``event``; a disk that is full must not end the flight."""
        try:
            self._log.msg(event.text, kind=event.kind, stamp=round(event.stamp, 6))
        except OSError as error:
            self.error = error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError):  # what it could not write it has told
            self._file.close()
