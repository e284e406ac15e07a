"""A systemd that only listens."""

import socket
import threading
import time
from contextlib import contextmanager


class Heard:
    """The messages that come to a notify socket; its queue is short, so a thread takes them."""

    def __init__(self, opened):
        self._socket = opened
        self.messages = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="systemd", daemon=True)
        self._thread.start()

    def _run(self):
        self._socket.settimeout(0.05)
        while not self._over.is_set():
            try:
                self.messages.append(self._socket.recv(4096).decode())
            except TimeoutError:
                continue

    def wait(self, text, seconds=30.0):
        """The first message, of those that have come or come in time, that has ``text``; None if none does."""
        until = time.monotonic() + seconds
        while True:
            if found := next((one for one in list(self.messages) if text in one), None):
                return found
            if time.monotonic() > until:
                return None
            time.sleep(0.01)

    def close(self):
        """Take what is left."""
        time.sleep(0.1)
        self._over.set()
        self._thread.join()


@contextmanager
def notify_socket(address):
    """``address`` as in NOTIFY_SOCKET."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as opened:
        opened.bind("\0" + address[1:] if address.startswith("@") else address)
        heard = Heard(opened)
        try:
            yield heard
        finally:
            heard.close()
