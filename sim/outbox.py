"""Datagrams to a process that may be too busy to take them: sending never waits."""

import socket
from collections import deque


class Outbox:
    """Keeps up to ``depth`` datagrams for a peer that doesn't keep up, then loses the oldest.

    With depth 0, what the peer doesn't take at once is lost. They go to ``address``, or to where ``sender`` is
    connected. Owns the ``sender``.
    """

    def __init__(self, sender: socket.socket, depth: int, address: str | tuple[str, int] | None = None) -> None:
        sender.setblocking(False)
        self._sender = sender
        self._address = address
        self._depth = depth
        self._waiting: deque[bytes] = deque()
        self.lost = 0

    def send(self, datagram: bytes) -> None:
        """Send what waits, then ``datagram``, as far as the peer takes it."""
        self._waiting.append(datagram)
        self.flush()
        while len(self._waiting) > self._depth:
            self._waiting.popleft()
            self.lost += 1

    def flush(self) -> None:
        """Send what waits, as far as the peer takes it."""
        while self._waiting:
            try:
                self._put(self._waiting[0])
            except OSError:  # full, or the peer is not there (yet, or any more)
                return
            self._waiting.popleft()

    def close(self) -> None:
        """Send what waits, as far as the peer takes it, and close."""
        self.flush()
        self._sender.close()

    def _put(self, datagram: bytes) -> None:
        if self._address is None:
            self._sender.send(datagram)
        else:
            self._sender.sendto(datagram, self._address)
