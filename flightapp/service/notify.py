"""What the service tells systemd: sd_notify(3), whose protocol is a datagram of VAR=VALUE lines."""

import contextlib
import os
import socket
import time
from collections import deque
from collections.abc import Mapping

KEPT = 4
"""Messages that are kept for later."""


class Notifier:
    """Sends to the socket that ``environment`` names in NOTIFY_SOCKET; nothing where it names none.

    A send never waits. Where the socket's queue is full a ping or a status is lost, for the next will do; the others
    are kept and go out before it.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # '@' stands for the zero byte with which an abstract address begins.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)
        self._status = ""
        self._kept: deque[bytes] = deque(maxlen=KEPT)
        self.watchdog = _watchdog(environment)
        """s within which systemd wants a `ping`; 0 where it wants none."""

    def ready(self, status: str) -> None:
        """The service is up, or has reloaded."""
        self._status = status
        self._keep("READY=1", f"STATUS={_line(status)}")

    def status(self, text: str) -> None:
        """What the service does, in one line, if it has changed."""
        if text != self._status:
            self._status = text
            self._send(f"STATUS={_line(text)}".encode())
        else:
            self._send()

    def ping(self) -> None:
        """All is well."""
        self._send(b"WATCHDOG=1")

    def reloading(self) -> None:
        """The configuration is being read anew; `ready` must follow."""
        self._keep("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        """The service is about to end."""
        self._keep("STOPPING=1")

    def close(self) -> None:
        """Send nothing any more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _keep(self, *lines: str) -> None:
        self._kept.append("\n".join(lines).encode())
        self._send()

    def _send(self, message: bytes | None = None) -> None:
        """What was kept and then ``message``, as far as they go."""
        with contextlib.suppress(IndexError):  # nothing more is kept
            while True:
                kept = self._kept.popleft()
                if not self._sent(kept):
                    self._kept.appendleft(kept)
                    return
        if message is not None:
            self._sent(message)

    def _sent(self, message: bytes) -> bool:
        """Whether ``message`` has gone out, or nobody wants it."""
        if self._socket is None:
            return True
        try:
            self._socket.sendto(message, self._address)
        except OSError:  # nobody listens, or the queue is full
            return False
        return True


def _line(text: str) -> str:
    return " ".join(text.split())


def _watchdog(environment: Mapping[str, str]) -> float:
    try:
        period = int(environment.get("WATCHDOG_USEC", "0")) / 1e6
        mine = int(environment.get("WATCHDOG_PID", os.getpid())) == os.getpid()
    except ValueError:
        return 0.0
    return period if mine else 0.0
