"""The flight log: every message in one MCAP file, readable up to the last half second if the flight is cut off.

Chunks are closed and handed to the operating system every half second of log time, so that a crash of the
process loses at most that. The same messages give the same bytes.
"""

import os
from collections.abc import Callable, Mapping
from io import RawIOBase
from pathlib import Path
from typing import Any, NamedTuple

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.mcap import MCAPCompression, MCAPWriteOptions

from flightapp.messages import Frame
from flightapp.recording.nested import NESTED
from flightapp.recording.records import RECORDS, TrueGates, encode, json_schema
from flightapp.recording.view import View
from flightapp.recording.wire import FIXED, PACKAGE, Encode

PROFILE = "flightapp/3"
"""The MCAP profile: the application and the version of the format."""
HEADER = "flight"
"""The name of the metadata records that hold the header."""
FLUSH_INTERVAL = 0.5
"""s of log time between hand-overs to the operating system."""
CHUNK_SIZE = 1 << 20
NANOSECONDS = 1e9


class _Route(NamedTuple):
    """Where the messages of one topic and type go."""

    log: Callable[[bytes, int], None] | None
    encode: Encode
    shown: bool


class _File:
    """What the MCAP writer writes into: unbuffered, and deaf after the first error, which it keeps."""

    def __init__(self, file: RawIOBase) -> None:
        self._file = file
        self.error: OSError | None = None

    def write(self, data: bytes | bytearray) -> int:
        view = memoryview(data)
        try:
            while self.error is None and view:
                view = view[self._file.write(view) or 0 :]
        except OSError as error:
            self.error = error
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def flush(self) -> None:
        pass

    def sync(self) -> None:
        try:
            if self.error is None:
                os.fdatasync(self._file.fileno())
        except OSError as error:
            self.error = error

    def close(self) -> None:
        self._file.close()


class FlightLog:
    """Writes messages to a new file ``path``.

    ``header`` holds what is known before the flight: "mission", "seed", "track" (JSON), "config" (TOML), and
    whatever else the caller wants to keep. ``opening`` is the side of the gates' openings in metres, for the
    3-D view. ``create`` makes the file, if another than an ordinary one is wanted. ``durable`` waits at every flush
    until the disk has the data, so that a loss of power costs no more than a crash; it belongs in a thread of its own.
    ``context`` is where the messages pass through, for others that listen there, such as a live view.
    Raises OSError if the file exists or cannot be made.
    A disk that fails in flight does not raise; `error` tells, and `close` raises it.
    """

    def __init__(
        self,
        path: Path,
        *,
        header: Mapping[str, str],
        opening: float = 1.4,
        durable: bool = False,
        create: Callable[[Path], RawIOBase] | None = None,
        context: Context | None = None,
    ) -> None:
        self._file = _File(path.open("xb", buffering=0) if create is None else create(path))
        self._durable = durable
        self._context = Context() if context is None else context
        options = MCAPWriteOptions(
            compression=MCAPCompression.Lz4,
            profile=PROFILE,
            chunk_size=CHUNK_SIZE,
            disable_seeking=True,
        )
        self._writer = foxglove.open_mcap(self._file, context=self._context, writer_options=options)
        self._view = View(self._context, opening)
        self._routes: dict[tuple[str, type], _Route] = {}
        self._newest = 0.0
        self._flushed = 0.0
        self.annotate(header)

    @property
    def error(self) -> OSError | None:
        """Why writing stopped, if it did."""
        return self._file.error

    def annotate(self, entries: Mapping[str, str]) -> None:
        """Add to the header what became known later, such as the outcome; later entries win."""
        self._writer.write_metadata(HEADER, dict(entries))
        self._flush()

    def write(self, topic: str, message: Any) -> None:
        """Append ``message``; raises TypeError for a type that has no schema, struct.error for a wrong shape.

        Topics that carry the same type are read back as one stream.
        """
        if type(message) is tuple:
            message = TrueGates(self._newest, message)
        kind = type(message)
        route = self._routes.get((topic, kind)) or self._open(topic, kind)
        stamp: float = message.stamp
        time = max(int(stamp * NANOSECONDS), 0)
        if route.log is not None:
            route.log(route.encode(message), time)
        if route.shown:
            self._view.show(message, time)
        if stamp > self._newest:
            self._newest = stamp
            if stamp - self._flushed >= FLUSH_INTERVAL:
                self._flush()

    def close(self) -> None:
        """Finish the file; raises the OSError that stopped the writing, if one did."""
        self._writer.close()
        if self._durable:
            self._file.sync()
        self._file.close()
        if self.error is not None:
            raise self.error

    def _flush(self) -> None:
        self._flushed = self._newest
        self._writer.flush()
        if self._durable:
            self._file.sync()

    def _open(self, topic: str, kind: type) -> _Route:
        name = f"{PACKAGE}.{kind.__name__}"
        if kind is Frame:
            route = _Route(None, bytes, True)
        elif kind in FIXED:
            fixed = FIXED[kind]
            schema = Schema(name=name, encoding="protobuf", data=fixed.layout.schema)
            route = _Route(self._channel(topic, schema, "protobuf"), fixed.encode, kind in View.SHOWN)
        elif kind in NESTED:
            nested = NESTED[kind]
            schema = Schema(name=name, encoding="protobuf", data=nested.schema)
            route = _Route(self._channel(topic, schema, "protobuf"), nested.encode, kind in View.SHOWN)
        elif name in RECORDS:
            schema = Schema(name=name, encoding="jsonschema", data=json_schema(kind))
            route = _Route(self._channel(topic, schema, "json"), encode, kind in View.SHOWN)
        else:
            raise TypeError(f"topic '{topic}': a {kind.__name__} cannot be recorded")
        self._routes[topic, kind] = route
        return route

    def _channel(self, topic: str, schema: Schema, encoding: str) -> Callable[[bytes, int], None]:
        channel = Channel(topic, schema=schema, message_encoding=encoding, context=self._context)
        log: Callable[[bytes, int], None] = channel.base.log
        return log
