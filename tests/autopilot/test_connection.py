import contextlib
import os
import pty
import socket
from pathlib import Path

import pytest

from flightapp.autopilot.connection import check_device, parse_connection
from flightapp.autopilot.library import open_library
from flightapp.inputs import BadInputError


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is not a connection"),
        ("nonsense", "is not a connection"),
        ("udp://127.0.0.1:14540", "udpin://HOST:PORT"),
        ("udpin://127.0.0.1", "is not a connection"),
        ("udpin://:14540", "'' is not an IPv4 address"),
        ("udpin://localhost:14540", "'localhost' is not an IPv4 address"),
        ("udpin://127.0.0.1:0", "a UDP port is 1 to 65535"),
        ("udpin://127.0.0.1:99999", "a UDP port is 1 to 65535"),
        ("serial://ttyTHS1:921600", "a serial device is a path"),
        ("serial:///dev/ttyTHS1:77", "no baud rate 77"),
        ("serial:///dev/ttyTHS1", "is not a connection"),
    ],
)
def test_a_connection_that_is_none_is_told(text, says):
    with pytest.raises(BadInputError) as told:
        parse_connection(text)
    assert says in str(told.value)
    assert text in str(told.value)


def test_connections_are_taken_apart():
    udp = parse_connection("udpin://0.0.0.0:14540")
    assert (udp.device, udp.number) == (None, 14540)
    serial = parse_connection("serial:///dev/ttyTHS1:921600")
    assert (str(serial.device), serial.number) == ("/dev/ttyTHS1", 921600)


def test_a_serial_device_that_is_missing_is_told(tmp_path):
    with pytest.raises(BadInputError, match="No such file or directory"):
        check_device(parse_connection(f"serial://{tmp_path}/ttyTHS1:921600"))


def test_a_file_is_no_serial_device(tmp_path):
    (tmp_path / "ttyTHS1").touch()
    with pytest.raises(BadInputError, match="is not a serial device"):
        check_device(parse_connection(f"serial://{tmp_path}/ttyTHS1:921600"))


def test_a_serial_device_without_permission_is_told(monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(BadInputError, match="dialout"):
        check_device(parse_connection("serial:///dev/null:921600"))


def test_a_device_that_is_no_line_cannot_be_opened():
    with pytest.raises(BadInputError, match=r"cannot be opened: .*ioctl"):
        open_library("serial:///dev/null:921600", 1)


def test_a_serial_line_opens():
    ours, theirs = pty.openpty()
    try:
        open_library(f"serial://{os.ttyname(theirs)}:921600", 1).destroy()
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_port_in_use_is_told():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(BadInputError, match=rf"{port}' cannot be opened: .*in use; another program"):
            open_library(f"udpin://127.0.0.1:{port}", 1)


def test_the_link_listens_on_its_own_address_and_no_other():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    before = _listening()
    library = open_library(f"udpin://127.0.0.1:{port}", 1)
    try:
        assert _listening() - before == {("127.0.0.1", port)}
    finally:
        library.destroy()


def _listening():
    """Addresses on which this process holds UDP and TCP sockets."""
    inodes = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            inodes.add(str(descriptor.readlink()).removeprefix("socket:[").removesuffix("]"))
    held = set()
    for table in ("udp", "udp6", "tcp", "tcp6"):
        for line in Path(f"/proc/self/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            fields = line.split()
            address, port = fields[1].split(":")
            if fields[9] in inodes:
                quad = ".".join(map(str, bytes.fromhex(address)[::-1])) if len(address) == 8 else address
                held.add((quad, int(port, 16)))
    return held
