"""A systemd that only listens."""

import select
import socket
import time
from contextlib import contextmanager


class Heard:
    """The messages that have come to a notify socket."""

    def __init__(self, opened):
        self._socket = opened
        self.messages = []

    def wait(self, text, seconds=30.0):
        """The first message from now on, or before, that has ``text``; None if none comes."""
        until = time.monotonic() + seconds
        while True:
            self.take()
            if found := next((one for one in self.messages if text in one), None):
                return found
            if time.monotonic() > until:
                return None
            select.select([self._socket], [], [], 0.1)

    def take(self):
        """All that has come so far."""
        while select.select([self._socket], [], [], 0)[0]:
            self.messages.append(self._socket.recv(4096).decode())
        return self.messages


@contextmanager
def notify_socket(address):
    """``address`` as in NOTIFY_SOCKET."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as opened:
        opened.bind("\0" + address[1:] if address.startswith("@") else address)
        yield Heard(opened)
