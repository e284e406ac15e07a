"""What the service tells systemd: sd_notify(3), whose protocol is a datagram of VAR=VALUE lines."""

import contextlib
import os
import socket
import time
from collections.abc import Mapping


class Notifier:
    """Sends to the socket that ``environment`` names in NOTIFY_SOCKET; nothing where it names none.

    A send never waits: what does not fit into the socket's queue is lost.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # '@' stands for the zero byte with which an abstract address begins.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)
        self._status = ""
        self.watchdog = _watchdog(environment)
        """s within which systemd wants a `ping`; 0 where it wants none."""

    def ready(self, status: str) -> None:
        """The service is up, or has reloaded."""
        self._status = status
        self._send("READY=1", f"STATUS={_line(status)}")

    def status(self, text: str) -> None:
        """What the service does, in one line, if it has changed."""
        if text != self._status:
            self._status = text
            self._send(f"STATUS={_line(text)}")

    def ping(self) -> None:
        """All is well."""
        self._send("WATCHDOG=1")

    def reloading(self) -> None:
        """The configuration is being read anew; `ready` must follow."""
        self._send("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        """The service is about to end."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Send nothing any more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, *lines: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # nobody listens, or the queue is full: the next one will do
                self._socket.sendto("\n".join(lines).encode(), self._address)


def _line(text: str) -> str:
    return " ".join(text.split())


def _watchdog(environment: Mapping[str, str]) -> float:
    try:
        period = int(environment.get("WATCHDOG_USEC", "0")) / 1e6
        mine = int(environment.get("WATCHDOG_PID", os.getpid())) == os.getpid()
    except ValueError:
        return 0.0
    return period if mine else 0.0
