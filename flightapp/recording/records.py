"""Encoding of the messages that come irregularly: JSON, with a JSON schema made from the dataclass.

Numbers that are not finite are the strings "NaN", "Infinity" and "-Infinity", as in protobuf's JSON mapping.
"""

import json
import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, cast, get_args, get_origin, get_type_hints

import numpy as np

from flightapp.messages import (
    AutopilotStatus,
    Collision,
    CommandArrivals,
    Event,
    GateEstimate,
    GatePassage,
    PlanReport,
    ProcessLoad,
)
from flightapp.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class TrueGates:
    """Where the gates really are, as the log keeps it."""

    stamp: float
    """The newest stamp in the log when the gates were reported."""
    gates: tuple[GateEstimate, ...]


RECORDS: Mapping[str, type] = {
    f"flightapp.{record.__name__}": record
    for record in (
        TrueGates,
        Trajectory,
        AutopilotStatus,
        Event,
        PlanReport,
        GatePassage,
        Collision,
        CommandArrivals,
        ProcessLoad,
    )
}
"""Every message type that is written this way, by the name of its schema."""

Convert = Callable[[Any], Any]

_TO_JSON = json.JSONEncoder(separators=(",", ":"), allow_nan=False, check_circular=False).encode
_NUMBER = {"type": ["number", "string"]}
_SCALARS: Mapping[Any, Mapping[str, Any]] = {
    float: _NUMBER,
    int: {"type": "integer"},
    bool: {"type": "boolean"},
    str: {"type": "string"},
    NoneType: {"type": "null"},
}


def encode(message: Any) -> bytes:
    """``message``, a dataclass of `RECORDS`, as JSON."""
    return _TO_JSON(_flattener(cast(Hashable, type(message)))(message)).encode()


def decode(record: type, data: bytes) -> Any:
    """What `encode` made of a ``record``; raises ValueError, KeyError or TypeError where it is not one."""
    return _builder(cast(Hashable, record))(json.loads(data))


def json_schema(record: type) -> bytes:
    """The JSON schema of ``record``."""
    return json.dumps({"title": record.__name__, **_schema(record)}, separators=(",", ":")).encode()


def _number(value: float) -> float | str:
    if math.isfinite(value):
        return float(value)
    return "NaN" if math.isnan(value) else "Infinity" if value > 0.0 else "-Infinity"


def _numbers(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        listed = value.tolist()
        return listed if all(map(math.isfinite, value.flat)) else _numbers(listed)
    return [_numbers(item) for item in value] if isinstance(value, list) else _number(value)


@cache
def _flattener(kind: Any) -> Convert:
    """What turns a value of type ``kind`` into JSON's own types."""
    if kind is float:
        return _number
    if is_dataclass(kind):
        parts = tuple((name, _flattener(hint)) for name, hint in get_type_hints(kind).items())
        return lambda value: {name: part(getattr(value, name)) for name, part in parts}
    if get_origin(kind) is UnionType:
        inner = _flattener(_present(kind))
        return lambda value: None if value is None else inner(value)
    if get_origin(kind) is np.ndarray:
        return _numbers
    if get_origin(kind) is tuple:
        item = _flattener(get_args(kind)[0])
        return lambda value: [item(part) for part in value]
    return kind if kind in (int, bool) else str


@cache
def _builder(kind: Any) -> Convert:
    """What turns JSON's own types into a value of type ``kind``."""
    if is_dataclass(kind):
        make = cast(type, kind)
        parts = tuple((name, _builder(hint)) for name, hint in get_type_hints(kind).items())
        return lambda value: make(*[part(value[name]) for name, part in parts])
    if get_origin(kind) is UnionType:
        inner = _builder(_present(kind))
        return lambda value: None if value is None else inner(value)
    if get_origin(kind) is np.ndarray:
        return lambda value: np.array(value, float)
    if get_origin(kind) is tuple:
        item = _builder(get_args(kind)[0])
        return lambda value: tuple([item(part) for part in value])
    return cast(Convert, kind)


def _present(kind: Any) -> Any:
    return next(option for option in get_args(kind) if option is not NoneType)


def _schema(kind: Any) -> Mapping[str, Any]:
    if kind in _SCALARS:
        schema = _SCALARS[kind]
    elif is_dataclass(kind):
        hints = get_type_hints(kind)
        properties = {name: _schema(hint) for name, hint in hints.items()}
        schema = {"type": "object", "properties": properties, "required": list(hints)}
    elif get_origin(kind) is UnionType:
        schema = {"anyOf": [_schema(option) for option in get_args(kind)]}
    elif get_origin(kind) is np.ndarray:
        schema = {"type": "array"}
    elif get_origin(kind) is tuple:
        items = get_args(kind)
        listed = {"items": _schema(items[0])} if items[-1] is Ellipsis else {"prefixItems": [*map(_schema, items)]}
        schema = {"type": "array", **listed}
    else:
        schema = {"type": "string", "enum": [member.value for member in kind]}
    return schema
