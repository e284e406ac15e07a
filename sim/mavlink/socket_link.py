"""A UDP socket on this computer that stamps what arrives, as the kernel received it."""

import asyncio
import socket
import time
from collections.abc import Callable
from struct import Struct

from flightapp.inputs import BadInputError

Address = tuple[str, int]
LOOPBACK = "127.0.0.1"
SO_TIMESTAMPNS = 35
"""Linux, not in Python's socket module: socket(7)."""
_TIMESPEC = Struct("@ll")
_LARGEST = 2048
_AT_ONCE = 64
"""Datagrams that are taken before others get their turn."""


class SocketLink:
    """Gives each datagram with its stamp (CLOCK_MONOTONIC, s) and its sender to ``received``."""

    def __init__(self, port: int, received: Callable[[bytes, float, Address], None]) -> None:
        self._port = port
        self._received = received
        self._socket: socket.socket | None = None
        self.unsent = 0
        """Datagrams that the system didn't take."""

    def open(self) -> None:
        """Bind to the port, 0 for any, on loopback only; raises `BadInputError` where that can't be done."""
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.bind((LOOPBACK, self._port))
        except (OSError, OverflowError) as error:
            opened.close()
            reason = error.strerror if isinstance(error, OSError) else "no such port"
            raise BadInputError(f"the simulated vehicle can't listen on UDP port {self._port}: {reason}") from None
        opened.setblocking(False)
        opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket = opened
        asyncio.get_running_loop().add_reader(opened, self._take)

    def close(self) -> None:
        """Give the port back."""
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    @property
    def address(self) -> Address:
        """Where it listens; raises `RuntimeError` while it is closed."""
        if self._socket is None:
            raise RuntimeError("the link is closed")
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def send(self, datagram: bytes, remote: Address) -> None:
        """Send at once, or lose it."""
        if self._socket is not None:
            try:
                self._socket.sendto(datagram, remote)
            except OSError:
                self.unsent += 1

    def _take(self) -> None:
        for _ in range(_AT_ONCE):
            if self._socket is None:
                return
            try:
                datagram, ancillary, _, sender = self._socket.recvmsg(_LARGEST, 64)
            except OSError:  # none is left
                return
            self._received(datagram, _stamp(ancillary), sender)


def _stamp(ancillary: list[tuple[int, int, bytes]]) -> float:
    """When the kernel received it, by CLOCK_MONOTONIC: the kernel tells it by CLOCK_REALTIME."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            waited: int = time.clock_gettime_ns(time.CLOCK_REALTIME) - (seconds * 1_000_000_000 + nanoseconds)
            return 1e-9 * (time.monotonic_ns() - max(waited, 0))
    return time.monotonic()
