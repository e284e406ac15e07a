"""Reading a flight log, whole or cut off.

Record framing follows the MCAP specification (https://mcap.dev/spec): one byte of opcode and eight of
length, so that a record that was cut off is recognised by its length.
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import fields
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Header, Metadata, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream

from flightapp.evaluation.flight import Commands, Flight, Inertial, Motions, Poses, Setpoints, Stages, States
from flightapp.inputs import BadInputError
from flightapp.messages import (
    AutopilotStatus,
    Collision,
    CommandArrivals,
    Event,
    GateMap,
    GatePassage,
    GroundTruth,
    ImuSample,
    PlanReport,
    PoseSample,
    ProcessLoad,
    RateCommand,
    Setpoint,
    Sightings,
    StageTime,
    VehicleState,
)
from flightapp.recording.nested import NESTED
from flightapp.recording.pictures import PICTURE, picture
from flightapp.recording.records import TrueGates, decode
from flightapp.recording.wire import FIXED, PACKAGE
from flightapp.recording.writer import HEADER, PROFILE
from flightapp.trajectory import Trajectory

_MAGIC = b"\x89MCAP0\r\n"
START = 4096
"""Bytes that hold an MCAP file's header."""
_MESSAGE_HEAD = 22
"""Bytes of a message before its payload: channel (2), sequence (4), log time (8), publish time (8)."""
_DAMAGE = (
    DecodeError,
    McapError,
    CRCValidationError,
    RuntimeError,
    struct.error,
    ArithmeticError,
    LookupError,
    MemoryError,
    TypeError,
    ValueError,
)


def read_flight(path: Path) -> Flight:
    """The flight in ``path``, up to where the file is whole.

    Raises `BadInputError` for a file that is missing, empty, not a flight log, of another format version, or
    damaged elsewhere than at its end.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise BadInputError(f"{path}: there is no such flight log") from None
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error}") from None
    try:
        _check_start(path, data)
        return _Contents(data).flight()
    except _DAMAGE as error:
        raise BadInputError(f"{path}: the flight log is damaged: {error or type(error).__name__}") from None


def mcap_profile(path: Path) -> str | None:
    """The profile in the header of an MCAP file, which tells who wrote it; None for any other file.

    Raises `BadInputError` where it cannot be read.
    """
    try:
        with path.open("rb") as file:
            data = file.read(START)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror or error}") from None
    _, opcode, body = next(_records(data, len(_MAGIC)), (0, 0, b""))
    if not data.startswith(_MAGIC) or opcode != Opcode.HEADER:
        return None
    try:
        return str(Header.read(ReadDataStream(BytesIO(body))).profile)
    except _DAMAGE:
        return None


def _check_start(path: Path, data: bytes) -> None:
    if not data:
        raise BadInputError(f"{path}: the file is empty, not a flight log")
    if data[: len(_MAGIC)] != _MAGIC[: len(data)]:
        raise BadInputError(f"{path}: not an MCAP file, so not a flight log")
    _, opcode, body = next(_records(data, len(_MAGIC)), (0, 0, b""))
    if not body:
        raise BadInputError(f"{path}: the flight log was cut off before its first record")
    profile = Header.read(ReadDataStream(BytesIO(body))).profile if opcode == Opcode.HEADER else ""
    name, _, version = PROFILE.partition("/")
    if profile.partition("/")[0] != name:
        raise BadInputError(f"{path}: an MCAP file, but not a flight log of {name} (its profile is '{profile}')")
    if profile != PROFILE:
        found = profile.partition("/")[2]
        raise BadInputError(f"{path}: a flight log of format version {found}; this program reads version {version}")


def _records(data: bytes, position: int) -> Iterator[tuple[int, int, bytes]]:
    """Position, opcode and body of every whole record from ``position`` on."""
    while position + 9 <= len(data):
        opcode = data[position]
        end = position + 9 + int.from_bytes(data[position + 1 : position + 9], "little")
        if opcode == 0 or end > len(data):
            return
        yield position, opcode, data[position + 9 : end]
        position = end


def _check_sum(data: bytes, expected: int) -> None:
    if expected not in (0, zlib.crc32(data)):
        raise ValueError("its checksum is wrong")


class _Contents:
    """The payloads of a log by type of message."""

    def __init__(self, data: bytes) -> None:
        self.header: dict[str, str] = {}
        self.complete = False
        self._payloads: dict[str, list[bytes]] = defaultdict(list)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, list[bytes]] = {}
        for position, opcode, body in _records(data, len(_MAGIC)):
            stream = ReadDataStream(BytesIO(body))
            if opcode == Opcode.DATA_END:
                _check_sum(data[:position], DataEnd.read(stream).data_section_crc)
                self.complete = True
                break
            if opcode == Opcode.METADATA:
                metadata = Metadata.read(stream)
                if metadata.name == HEADER:
                    self.header.update(metadata.metadata)
            elif opcode == Opcode.CHUNK:
                chunk, length = get_chunk_data_stream(Chunk.read(stream), validate_crc=True)
                for _, inner, content in _records(chunk.read(length), 0):
                    self._take(inner, content)
            else:
                self._take(opcode, body)

    def _take(self, opcode: int, body: bytes) -> None:
        if opcode == Opcode.MESSAGE:
            self._channels[int.from_bytes(body[:2], "little")].append(body[_MESSAGE_HEAD:])
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(body)))
            self._channels[channel.id] = self._payloads[self._schemas.get(channel.schema_id, "")]
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(body)))
            self._schemas[schema.id] = schema.name

    def flight(self) -> Flight:
        return Flight(
            self.header,
            self.complete,
            self._columns(PoseSample, Poses),
            self._states(),
            self._columns(Setpoint, Setpoints),
            self._columns(RateCommand, Commands),
            self._columns(GroundTruth, Motions),
            self._messages(GateMap),
            tuple(report.gates for report in self._messages(TrueGates)),
            self._messages(Sightings),
            self._messages(Trajectory),
            self._messages(AutopilotStatus),
            self._messages(Event),
            self._messages(PlanReport),
            self._messages(GatePassage),
            self._messages(Collision),
            self._messages(CommandArrivals),
            self._messages(ProcessLoad),
            self._columns(ImuSample, Inertial),
            self._columns(StageTime, Stages),
            tuple(sorted(map(picture, self._payloads[PICTURE]), key=lambda shown: shown.stamp)),
        )

    def _columns(self, kind: type, columns: type) -> Any:
        layout = FIXED[kind].layout
        payloads = self._payloads[layout.name]
        if not payloads:
            return columns()
        arrays = layout.columns(payloads)
        stamps = arrays["stamp"]
        if np.any(np.diff(stamps) < 0.0):
            order = np.argsort(stamps, kind="stable")
            arrays = {name: array[order] for name, array in arrays.items()}
        return columns(**arrays)

    def _states(self) -> States:
        """The states; of those with one stamp the last, which a late pose has corrected."""
        states: States = self._columns(VehicleState, States)
        last = np.append(np.diff(states.stamp) > 0.0, True)
        return states if last.all() else States(**{f.name: getattr(states, f.name)[last] for f in fields(States)})

    def _messages(self, kind: type) -> Any:
        name = f"{PACKAGE}.{kind.__name__}"
        read = NESTED[kind].decode if kind in NESTED else partial(decode, kind)
        messages = [read(payload) for payload in self._payloads[name]]
        return tuple(sorted(messages, key=lambda message: message.stamp))
