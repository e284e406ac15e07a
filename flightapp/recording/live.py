"""The live view: what goes into the log is also served to Foxglove over a WebSocket, to be looked at and nothing else.

Protocol: https://github.com/foxglove/ws-protocol. The server runs in threads of its own, outside Python. Each client
has a queue of its own, whose oldest messages are dropped where the client is slow; nobody waits for a client. No
capability is offered: clients can neither publish nor set parameters nor call services.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

import foxglove
from foxglove import Context

from flightapp.inputs import BadInputError

LOOPBACK = "127.0.0.1:8765"
"""Where it is served unless another address is asked for: for this computer alone, at Foxglove's usual port."""
BACKLOG = 512
"""Messages that may wait for one client: about half a second of a flight."""
_ADDRESS = re.compile(r"(?P<host>[^:\[\]]+|\[[0-9a-fA-F:.]+\]):(?P<port>\d{1,5})")


class LiveServer:
    """Serves all that is logged through `context` at ``address``, HOST:PORT.

    Raises `BadInputError` where ``address`` is none, or cannot be listened at.
    """

    def __init__(self, address: str, name: str) -> None:
        form = _ADDRESS.fullmatch(address)
        port = int(form["port"]) if form is not None else -1
        if form is None or not 0 <= port < 65536:
            raise BadInputError(f"live view: '{address}' is not an address: give HOST:PORT, such as {LOOPBACK}")
        self.context = Context()
        """What is logged here is served."""
        self._host = form["host"]
        try:
            self._server = foxglove.start_server(
                name=name,
                host=self._host.strip("[]"),
                port=port,
                capabilities=[],
                context=self.context,
                message_backlog_size=BACKLOG,
            )
        except (RuntimeError, OSError, ValueError) as error:
            why = str(error).rpartition("FoxgloveError: ")[2]
            raise BadInputError(f"live view: cannot serve at {address}: {why}") from None

    @property
    def url(self) -> str:
        """What Foxglove is to connect to."""
        return f"ws://{self._host}:{self._server.port}"

    def close(self) -> None:
        """Send clients away and stop serving."""
        self._server.stop()


@contextmanager
def served(address: str, name: str) -> Iterator[Context | None]:
    """The context of a `LiveServer` at ``address`` for as long as this lasts; None where ``address`` is empty."""
    if not address:
        yield None
        return
    server = LiveServer(address, name)
    try:
        yield server.context
    finally:
        server.close()
