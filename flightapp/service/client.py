"""Talks to the service."""

import contextlib
import json
import os
import socket
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from flightapp.inputs import BadInputError
from flightapp.service.peer import GROUP
from flightapp.service.protocol import encode

VARIABLE = "FLIGHTAPP_SOCKET"
SOCKET = Path("/run/flightapp/control.sock")
PATIENCE = 30.0
"""s that an answer may take: a mission is loaded and checked meanwhile."""
ANSWER = 1 << 20
"""Bytes that an answer may have."""


def socket_path() -> Path:
    """Where the service listens: what FLIGHTAPP_SOCKET says, else `SOCKET`."""
    return Path(os.environ.get(VARIABLE) or SOCKET)


def ask(request: BaseModel, path: Path | None = None, patience: float = PATIENCE) -> dict[str, Any]:
    """The service's answer to ``request``; raises `BadInputError` where none comes."""
    path = path or socket_path()
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(patience)
            connection.connect(str(path))
            with contextlib.suppress(BrokenPipeError):  # a refusal came before the request was read
                connection.sendall(encode(request))
            answer = _line(connection)
    except (FileNotFoundError, ConnectionRefusedError):
        raise BadInputError(
            f"{path}: no service listens there; start it with `systemctl start flightapp` or `flightapp serve`,"
            f" or name another socket in {VARIABLE}"
        ) from None
    except PermissionError:
        raise BadInputError(
            f"{path}: you may not talk to the service; become a member of its group with"
            f" `sudo usermod -aG {GROUP} $USER` and log in again"
        ) from None
    except TimeoutError:
        raise BadInputError(f"{path}: no answer within {patience:g} s; see `journalctl -u flightapp`") from None
    except OSError as error:
        raise BadInputError(f"{path}: {error.strerror or error}") from None
    try:
        told = json.loads(answer)
    except ValueError:
        told = None
    if not isinstance(told, dict):
        raise BadInputError(f"{path}: the service hung up without an answer; see `journalctl -u flightapp`")
    return told


def _line(connection: socket.socket) -> bytes:
    received = b""
    while not received.endswith(b"\n") and len(received) < ANSWER:
        try:
            data = connection.recv(65536)
        except ConnectionResetError:
            break
        if not data:
            break
        received += data
    return received
