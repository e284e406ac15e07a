"""MAVLink frames to and from bytes, cheaply; the messages are those of pymavlink's `development` dialect.

Here a payload is one `struct` call, without objects, and the checksum (CRC-16/MCRF4XX,
https://mavlink.io/en/guide/serialization.html) comes from `binascii`, which knows the same polynomial bit-reversed.
"""

import binascii
from collections.abc import Iterator
from functools import cache
from struct import Struct
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as dialect

V1, V2 = 0xFE, 0xFD
"""First byte of a frame."""
_SIGNED = 0x01
_SIGNATURE = 13
_MIRRORED = bytes(int(f"{value:08b}"[::-1], 2) for value in range(256))

SINGLE, TEXT = 0, -1


class Kind(NamedTuple):
    """One kind of message."""

    id: int
    name: str
    layout: Struct
    """Of the payload, in the order on the wire."""
    extra: int
    """CRC_EXTRA."""
    fields: tuple[tuple[str, int], ...]
    """Names in the order on the wire, with the length of arrays; `SINGLE` for numbers, `TEXT` for characters."""


class Frame(NamedTuple):
    """A message that came in."""

    kind: Kind
    system: int
    component: int
    payload: bytes
    """At least as long as the layout; longer by extensions that the dialect doesn't know."""

    def values(self) -> tuple[Any, ...]:
        """All values in the order on the wire, arrays unrolled."""
        return self.kind.layout.unpack_from(self.payload)

    def decode(self) -> dict[str, Any]:
        """Values by field; arrays as tuples."""
        values, at, found = self.values(), 0, {}
        for name, count in self.kind.fields:
            found[name] = values[at : at + count] if count > 0 else values[at]
            at += max(count, 1)
        return found


_PROTOCOL_VERSION = Kind(
    300,
    "PROTOCOL_VERSION",
    Struct("<HHH8B8B"),
    217,
    (("version", 0), ("min_version", 0), ("max_version", 0), ("spec_version_hash", 8), ("library_version_hash", 8)),
)
"""Not in the dialect any more, but PX4 sends it."""


@cache
def kind(message: int) -> Kind | None:
    """What is known of the message with this id."""
    if message == _PROTOCOL_VERSION.id:
        return _PROTOCOL_VERSION
    known = dialect.mavlink_map.get(message)
    if known is None:
        return None
    types = dict(zip(known.fieldnames, known.fieldtypes, strict=True))
    fields = tuple(
        (name, TEXT if types[name] == "char" else count)
        for name, count in zip(known.ordered_fieldnames, known.array_lengths, strict=True)
    )
    return Kind(message, known.msgname, known.unpacker, known.crc_extra, fields)


@cache
def named(name: str) -> Kind:
    """The message called ``name``; raises `KeyError`."""
    for message in (*dialect.mavlink_map, _PROTOCOL_VERSION.id):
        found = kind(message)
        if found is not None and found.name == name:
            return found
    raise KeyError(name)


def checksum(data: bytes) -> int:
    """CRC-16/MCRF4XX."""
    mirrored = binascii.crc_hqx(data.translate(_MIRRORED), 0xFFFF)
    return _MIRRORED[mirrored & 0xFF] << 8 | _MIRRORED[mirrored >> 8]


def encode(message: Kind, **values: Any) -> bytes:
    """A payload from values by field; what isn't given is zero. For messages that are rarely sent."""
    unrolled: list[Any] = []
    for name, count in message.fields:
        if count > 0:
            given = tuple(values.get(name, ()))
            unrolled += given + (0,) * (count - len(given))
        else:
            unrolled.append(values.get(name, b"" if count == TEXT else 0))
    return message.layout.pack(*unrolled)


def pack(message: Kind, payload: bytes, sequence: int, system: int, component: int) -> bytes:
    """A MAVLink 2 frame; the payload's trailing zeros are left out, as they must be."""
    body = payload.rstrip(b"\0") or b"\0"
    number = message.id
    head = bytes((len(body), 0, 0, sequence, system, component, number & 0xFF, number >> 8 & 0xFF, number >> 16))
    crc = checksum(head + body + bytes((message.extra,)))
    return b"\xfd" + head + body + bytes((crc & 0xFF, crc >> 8))


class Decoder:
    """Takes datagrams apart; counts what isn't MAVLink, or isn't whole."""

    def __init__(self) -> None:
        self.corrupt = 0
        """Frames with a wrong checksum, and rests of datagrams that are no frames."""

    def frames(self, datagram: bytes) -> Iterator[Frame]:
        """The frames of one datagram; those of unknown messages are left out."""
        at, end = 0, len(datagram)
        while at < end:
            version = datagram[at]
            head = 10 if version == V2 else 6
            if version not in (V1, V2) or end - at < head + 2:
                self.corrupt += 1
                return
            length = datagram[at + 1]
            signature = _SIGNATURE if version == V2 and datagram[at + 2] & _SIGNED else 0
            after = at + head + length + 2 + signature
            frame = self._frame(datagram[at : after - signature], version, head) if after <= end else None
            if after > end:
                self.corrupt += 1
            elif frame is not None:
                yield frame
            at = after

    def _frame(self, data: bytes, version: int, head: int) -> Frame | None:
        message = data[7] | data[8] << 8 | data[9] << 16 if version == V2 else data[5]
        known = kind(message)
        if known is None:
            return None
        if checksum(data[1:-2] + bytes((known.extra,))) != data[-2] | data[-1] << 8:
            self.corrupt += 1
            return None
        payload = data[head:-2]
        missing = known.layout.size - len(payload)
        if missing > 0:
            payload += bytes(missing)
        system, component = (data[5], data[6]) if version == V2 else (data[3], data[4])
        return Frame(known, system, component, payload)
