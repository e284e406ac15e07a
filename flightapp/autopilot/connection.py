"""Where the autopilot is: connection strings, checked before anything is opened."""

import os
import re
import stat
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path

from flightapp.inputs import BadInputError

BAUD_RATES = (57600, 115200, 230400, 460800, 500000, 576000, 921600, 1000000, 1500000, 2000000, 3000000)
HOW = "give udpin://HOST:PORT with an address of this computer, or serial:///dev/NAME:BAUD"
_FORM = re.compile(r"(?P<kind>udpin|serial)://(?P<place>[^:]*):(?P<number>\d+)")


@dataclass(frozen=True, slots=True)
class Connection:
    """A connection string that MAVSDK takes, taken apart."""

    url: str
    device: Path | None
    """Serial device; None for UDP."""
    number: int
    """UDP port to listen on, or baud rate."""


def parse_connection(text: str) -> Connection:
    """The connection that ``text`` names; raises `BadInputError` where it can be none."""
    form = _FORM.fullmatch(text)
    if form is None:
        raise BadInputError(f"link.connection = '{text}' is not a connection: {HOW}")
    place, number = form["place"], int(form["number"])
    if form["kind"] == "serial":
        if not place.startswith("/"):
            raise BadInputError(f"link.connection = '{text}': a serial device is a path such as /dev/ttyTHS1")
        if number not in BAUD_RATES:
            known = ", ".join(map(str, BAUD_RATES))
            raise BadInputError(f"link.connection = '{text}': no baud rate {number}; known: {known}")
        return Connection(text, Path(place), number)
    try:
        IPv4Address(place)
    except AddressValueError:
        raise BadInputError(
            f"link.connection = '{text}': '{place}' is not an IPv4 address (127.0.0.1 listens to this computer only,"
            " 0.0.0.0 on every network)"
        ) from None
    if not 0 < number < 65536:
        raise BadInputError(f"link.connection = '{text}': a UDP port is 1 to 65535, not {number}")
    return Connection(text, None, number)


def check_device(connection: Connection) -> None:
    """Raise `BadInputError` where the serial device of ``connection`` is missing or not permitted."""
    device = connection.device
    if device is None:
        return
    try:
        mode = device.stat().st_mode
    except OSError as error:
        raise BadInputError(
            f"link.connection = '{connection.url}': {error.strerror}: is the autopilot's telemetry port wired to"
            " this computer and its device enabled?"
        ) from None
    if not stat.S_ISCHR(mode):
        raise BadInputError(f"link.connection = '{connection.url}': {device} is not a serial device")
    if not os.access(device, os.R_OK | os.W_OK):
        raise BadInputError(
            f"link.connection = '{connection.url}': no permission for {device}; add the user to its group"
            " (ls -l tells it, on Debian and Ubuntu usually: sudo usermod -aG dialout $USER) and log in again"
        )
