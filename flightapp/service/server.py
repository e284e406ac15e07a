"""The control socket's server: a thread of its own, which the sender does not wait for.

It takes one step at a time and rests in between, so that no crowd of clients takes the interpreter from the sender
for long. A client has a moment to say its one line; while places are scarce, whoever has been silent longest goes.
"""

import contextlib
import errno
import grp
import os
import selectors
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flightapp.inputs import BadInputError
from flightapp.service.peer import GROUP, Peer, peer_of, refusal
from flightapp.service.protocol import LINE, Request, encode, parse, refused

Answer = dict[str, Any] | Future[dict[str, Any]]
PLACES = 64
"""Connections at a time."""
BACKLOG = 256
"""Connections that may wait for a place."""
TIME = 2.0
"""s to say a request, and again to take the answer."""
LONGEST = 60.0
"""s that an answer may take to be made."""
TURN = 0.5
"""s between two turns of an idle server."""
REST = 0.005
"""s after each step, so that at most two hundred are taken in a second."""
MODE = 0o660


@dataclass(slots=True, eq=False)
class _Client:
    """One connection."""

    connection: socket.socket
    peer: Peer
    until: float
    """By when it must have gone on."""
    heard: bytearray = field(default_factory=bytearray)
    answer: Future[dict[str, Any]] | None = None
    """What is being made."""
    rest: bytes = b""
    """Of the answer, that is still to be sent."""


class ControlServer:
    """Listens at ``path`` and has ``answer`` called, in its thread, with each sound request of who may command.

    ``turn`` is called about every half second, too. Raises `BadInputError` where it cannot listen. ``identify`` and
    ``judge`` tell who is there and why he may not command.
    """

    def __init__(
        self,
        path: Path,
        answer: Callable[[Request, Peer], Answer],
        turn: Callable[[], None] = lambda: None,
        identify: Callable[[socket.socket], Peer] = peer_of,
        judge: Callable[[Peer], str] = refusal,
    ) -> None:
        self._path, self._answer, self._turn = path, answer, turn
        self._identify, self._judge = identify, judge
        self._clients: OrderedDict[socket.socket, _Client] = OrderedDict()
        self._selector = selectors.DefaultSelector()
        self._listener = _listen(path)
        self._woken, self._waker = socket.socketpair()
        for one in (self._woken, self._waker):
            one.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._over = False
        self.turns = 0
        """Grows while the server is well."""
        self._thread = threading.Thread(target=self._run, name="control socket", daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """Connections that are open."""
        return len(self._clients)

    def close(self) -> None:
        """Hang up and remove the socket."""
        self._over = True
        self._wake()
        self._thread.join()

    def _run(self) -> None:
        turned = 0.0
        try:
            while not self._over:
                for key, _ in self._selector.select(TURN):
                    self._step(key.fileobj)
                    if self._over:
                        break
                    time.sleep(REST)
                self._expire()
                if time.monotonic() - turned >= TURN:
                    turned = time.monotonic()
                    self.turns += 1
                    self._turn()
        finally:
            for client in list(self._clients.values()):
                self._hang_up(client)
            for one in (self._listener, self._woken, self._waker, self._selector):
                one.close()
            self._path.unlink(missing_ok=True)

    def _step(self, ready: object) -> None:
        if ready is self._listener:
            self._accept()
        elif ready is self._woken:
            with contextlib.suppress(BlockingIOError):
                self._woken.recv(4096)
            for client in [one for one in self._clients.values() if one.answer is not None and one.answer.done()]:
                self._finish(client)
        elif isinstance(ready, socket.socket) and (known := self._clients.get(ready)) is not None:
            try:
                self._write(known) if known.rest else self._read(known)
            except OSError:
                self._hang_up(known)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:  # it has gone again, or there are no descriptors left
            return
        connection.setblocking(False)
        try:
            peer = self._identify(connection)
            why = self._judge(peer)
        except OSError as error:
            peer, why = Peer(0, -1, -1), f"who you are cannot be told: {error.strerror}"
        client = _Client(connection, peer, time.monotonic() + TIME)
        if not why and len(self._clients) >= PLACES:
            self._make_room()
        self._clients[connection] = client
        self._selector.register(connection, selectors.EVENT_READ)
        if why:
            self._reply(client, refused(why))

    def _make_room(self) -> None:
        silent = next((one for one in self._clients.values() if one.answer is None), None)
        if silent is None:
            silent = next(iter(self._clients.values()))
        self._reply(silent, refused(f"more than {PLACES} connections, and this one said nothing; try again"))
        if silent.connection in self._clients:
            self._hang_up(silent)

    def _read(self, client: _Client) -> None:
        data = client.connection.recv(LINE + 1 - len(client.heard))
        client.heard += data
        if b"\n" in client.heard:
            self._serve(client, bytes(client.heard.partition(b"\n")[0]))
        elif len(client.heard) > LINE:
            self._reply(client, refused(f"the request is longer than {LINE} bytes"))
        elif not data and client.answer is None and client.heard:
            self._reply(client, refused("a request is one line, ended by a newline"))
        elif not data:
            self._hang_up(client)

    def _serve(self, client: _Client, line: bytes) -> None:
        try:
            answer = self._answer(parse(line), client.peer)
        except BadInputError as error:
            answer = refused(str(error))
        except Exception as error:  # whatever it is, it must not end the server
            answer = refused(f"the service failed: {type(error).__name__}: {error}")
        if isinstance(answer, dict):
            self._reply(client, answer)
            return
        self._selector.unregister(client.connection)
        client.answer, client.until = answer, time.monotonic() + LONGEST
        answer.add_done_callback(lambda _: self._wake())

    def _finish(self, client: _Client) -> None:
        assert client.answer is not None
        error = client.answer.exception()
        answer = refused(str(error)) if error is not None else client.answer.result()
        client.answer = None
        self._selector.register(client.connection, selectors.EVENT_READ)
        self._reply(client, answer)

    def _reply(self, client: _Client, answer: dict[str, Any]) -> None:
        client.rest, client.until = encode(answer), time.monotonic() + TIME
        with contextlib.suppress(KeyError):
            self._selector.modify(client.connection, selectors.EVENT_WRITE)
        try:
            self._write(client)
        except OSError:
            self._hang_up(client)

    def _write(self, client: _Client) -> None:
        with contextlib.suppress(BlockingIOError):
            client.rest = client.rest[client.connection.send(client.rest) :]
        if not client.rest:
            self._hang_up(client)

    def _expire(self) -> None:
        now = time.monotonic()
        for client in [one for one in self._clients.values() if one.until < now]:
            if client.rest:
                self._hang_up(client)
            elif client.answer is not None:
                client.answer = None
                self._selector.register(client.connection, selectors.EVENT_READ)
                self._reply(client, refused(f"no answer within {LONGEST:g} s"))
            else:
                self._reply(client, refused(f"no request within {TIME:g} s"))

    def _hang_up(self, client: _Client) -> None:
        self._clients.pop(client.connection, None)
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(client.connection)
        client.connection.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # it has been woken already, or is closed
            self._waker.send(b"\0")


def _listen(path: Path) -> socket.socket:
    """A listening socket that the service's user and the group may write to; raises `BadInputError`.

    It gets its name when it listens: who sees it is answered. What a process left behind there is replaced.
    """
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        if path.exists() and (not path.is_socket() or _is_served(path)):
            raise OSError(errno.EADDRINUSE, "there is something else, or a service that listens")
        mask = os.umask(0o777 & ~MODE)
        try:
            listener.bind(str(fresh))
        finally:
            os.umask(mask)
        with contextlib.suppress(KeyError, OSError):  # no such group, or it is not ours to give to
            os.chown(fresh, -1, grp.getgrnam(GROUP).gr_gid)
        listener.listen(BACKLOG)
        listener.setblocking(False)
        fresh.rename(path)
    except OSError as error:
        listener.close()
        with contextlib.suppress(OSError):
            fresh.unlink()
        raise BadInputError(
            f"{path}: cannot listen there: {error.strerror or error}; name another place with --socket or"
            " FLIGHTAPP_SOCKET, or stop the service that listens there"
        ) from None
    return listener


def _is_served(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe, contextlib.suppress(ConnectionRefusedError):
        probe.connect(str(path))
        return True
    return False
