"""Where local datagrams arrive: a path in the file system, or a UDP port of this computer."""

import errno
import re
import socket
from contextlib import suppress
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path

from flightapp.inputs import BadInputError

HOW = "give a path such as /run/flightapp/poses, or 127.0.0.1:PORT"
_PORT = re.compile(r"(?P<host>[^/:]+):(?P<port>\d+)")


def parse_address(text: str) -> Path | tuple[str, int]:
    """The path, or loopback host and port, that ``text`` names; raises `ValueError`."""
    if text.startswith("/"):
        return Path(text)
    form = _PORT.fullmatch(text)
    if form is None:
        raise ValueError(f"'{text}' is not an address: {HOW}")
    port = int(form["port"])
    try:
        local = IPv4Address(form["host"]).is_loopback
    except AddressValueError:
        local = False
    if not local:
        raise ValueError(f"'{form['host']}' is not an address of this computer alone: {HOW}")
    if not 0 < port < 65536:
        raise ValueError(f"a UDP port is 1 to 65535, not {port}")
    return form["host"], port


def listen(text: str) -> socket.socket:
    """A datagram socket that receives what is sent to the address ``text``; raises `BadInputError`.

    A path that a process left behind when it ended is taken over; one that is being listened at is not.
    """
    try:
        address = parse_address(text)
        return _listen_at_path(address) if isinstance(address, Path) else _listen_at_port(address)
    except ValueError as error:
        raise BadInputError(f"pose address: {error}") from None
    except OSError as error:
        why = "something else receives there already" if error.errno == errno.EADDRINUSE else error.strerror
        raise BadInputError(f"pose address '{text}': {why}") from None


def _listen_at_port(address: tuple[str, int]) -> socket.socket:
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiver.bind(address)
    except OSError:
        receiver.close()
        raise
    return receiver


def _listen_at_path(path: Path) -> socket.socket:
    if path.is_socket() and not _is_served(path):
        path.unlink()
    receiver = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        receiver.bind(str(path))
    except OSError:
        receiver.close()
        raise
    return receiver


def _is_served(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe, suppress(ConnectionRefusedError):
        probe.connect(str(path))
        return True
    return False


def forget(receiver: socket.socket) -> None:
    """Close a ``receiver`` that `listen` made, and remove its path."""
    name = receiver.getsockname() if receiver.fileno() >= 0 else b""
    receiver.close()
    if isinstance(name, str) and name.startswith("/"):
        Path(name).unlink(missing_ok=True)
