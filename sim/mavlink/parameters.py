"""The vehicle's parameters on the link (src/modules/mavlink/mavlink_parameters.cpp of PX4 v1.16).

Values travel in a float field: an integer's bytes are put into it as they are. A parameter that isn't known by its
name is not answered for.
"""

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from struct import Struct
from typing import NamedTuple

from flightapp.inputs import BadInputError, read_toml
from sim.mavlink.codec import Frame, named
from sim.px4.parameters import Parameters, Value

INT32, REAL32, UINT32 = 6, 9, 5
"""MAV_PARAM_TYPE."""
BURST = 5
"""Values of a list that are sent at once."""
NO_INDEX = 65535
HASH = "_HASH_CHECK"
"""Comes first in a list, so that a ground station can tell whether its cache is current."""
INFO = 6
"""MAV_SEVERITY."""
_VALUE, _SET = Struct("<4sHH16sB"), Struct("<4sBB16sB")
_INT, _FLOAT = Struct("<i"), Struct("<f")


def standard_parameters() -> dict[str, Value]:
    """Those of an indoor vehicle that the model doesn't act on, by name."""
    tables = read_toml(Path(__file__).with_suffix(".toml"), "table of parameters")
    return {**tables["px4"], **tables["indoor"]}


def override(parameters: Parameters, assignments: Iterable[str]) -> None:
    """Set parameters from "NAME=VALUE"; raises `BadInputError` for an unknown name or a value that is no number."""
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        name = name.strip()
        if not equals:
            raise BadInputError(f"parameter '{assignment}': give NAME=VALUE")
        if name not in parameters:
            near = get_close_matches(name, parameters, 1)
            raise BadInputError(f"unknown parameter '{name}'{f'; did you mean {near[0]}?' if near else ''}")
        kind = type(parameters[name])
        try:
            value = kind(text)
        except ValueError:
            what = "an integer" if kind is int else "a number"
            raise BadInputError(f"parameter {name}: '{text.strip()}' is not {what}") from None
        parameters.set(name, _stored(value))


def _stored(value: Value) -> Value:
    """As PX4 keeps it: floats have single precision."""
    stored: Value = value if isinstance(value, int) else _FLOAT.unpack(_FLOAT.pack(value))[0]
    return stored


class Reply(NamedTuple):
    """What is sent in answer."""

    payloads: tuple[bytes, ...] = ()
    """Of PARAM_VALUE."""
    text: str = ""
    """A status text."""


NOTHING = Reply()


class ParameterServer:
    """Answers the parameter messages of one link; ``hidden`` tells which names the vehicle doesn't know."""

    def __init__(self, parameters: Parameters, hidden: Callable[[], frozenset[str]]) -> None:
        self._parameters = parameters
        self._hidden = hidden
        self._listing: list[str] | None = None

    @property
    def listing(self) -> bool:
        """Whether a list is being sent."""
        return self._listing is not None

    def handle(self, frame: Frame) -> Reply:
        """Answer PARAM_REQUEST_READ, PARAM_REQUEST_LIST or PARAM_SET."""
        if frame.kind.name == "PARAM_REQUEST_LIST":
            self._listing = [HASH, *self._names()]
            return NOTHING
        return self._set(frame) if frame.kind.name == "PARAM_SET" else self._read(frame.decode())

    def next_burst(self) -> tuple[bytes, ...]:
        """The next values of a list that was asked for."""
        if self._listing is None:
            return ()
        names, rest = self._listing[:BURST], self._listing[BURST:]
        self._listing = rest or None
        return tuple(self._payload(name) for name in names)

    def _names(self) -> list[str]:
        return sorted(set(self._parameters) - self._hidden())

    def _read(self, request: Mapping[str, object]) -> Reply:
        index = request["param_index"]
        names = self._names()
        if isinstance(index, int) and index >= 0:
            if index >= len(names):
                return Reply(text=f"[pm] unknown param ID: {index}")
            return Reply((self._payload(names[index]),))
        name = _name(request["param_id"])
        return Reply((self._payload(name),)) if name == HASH or name in names else NOTHING

    def _set(self, frame: Frame) -> Reply:
        raw, _, _, identifier, kind = _SET.unpack_from(frame.payload)
        name = _name(identifier)
        if name == HASH:  # the ground station has a current cache
            self._listing = None
            return NOTHING
        if name not in self._parameters or name in self._hidden():
            return Reply(text=f"unknown param: {name}")
        if kind != _kind(self._parameters[name]):
            return Reply(text=f"param types mismatch param: {name}")
        self._parameters.set(name, (_INT if kind == INT32 else _FLOAT).unpack(raw)[0])
        return Reply((self._payload(name),))

    def _payload(self, name: str) -> bytes:
        names = self._names()
        if name == HASH:
            raw, kind, index = _INT.pack(self._parameters.version), UINT32, NO_INDEX
        else:
            value = self._parameters[name]
            kind, index = _kind(value), names.index(name)
            raw = _INT.pack(value) if isinstance(value, int) else _FLOAT.pack(value)
        return _VALUE.pack(raw, len(names), index, name.encode(), kind)


def _kind(value: Value) -> int:
    return INT32 if isinstance(value, int) else REAL32


def _name(identifier: object) -> str:
    return (
        identifier.split(b"\0", 1)[0].decode("ascii", "replace") if isinstance(identifier, bytes) else str(identifier)
    )


VALUE = named("PARAM_VALUE")
