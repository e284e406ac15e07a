"""QGroundControl's parameter files (.params): one tab-separated line per parameter.

Columns: vehicle id, component id, name, value, MAV_PARAM_TYPE (6: 32 bit integer, 9: 32 bit float); lines that begin
with # are comments. Format: QGroundControl's developer guide, "Parameters File Format".
"""

import math
import re
from collections.abc import Iterable
from pathlib import Path

from flightapp.autopilot.parameters import Kind, Parameter, Severity, Value, number_text
from flightapp.inputs import BadInputError

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
COLUMNS = "vehicle id, component id, name, value and type, with tabs between them"
_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")


def params_text(wanted: Iterable[Parameter], profile: str, system_id: int = 1) -> str:
    """A file that sets what of ``wanted`` suits any vehicle, each parameter under a comment that says why.

    ``profile`` names the table in the file's head.
    """
    lines = [
        f"# PX4 indoors on external vision, offboard body rates, profile {profile}.",
        "# What belongs to one vehicle alone (hover thrust, thrust curve, system id): see flightapp doctor.",
        "#",
        "# Vehicle-Id Component-Id Name Value Type",
        "#",
    ]
    for parameter in wanted:
        value = None if parameter.own or parameter.severity is Severity.NOTE else parameter.mended(None)
        if value is not None:
            lines.append(f"# {parameter.term}: {parameter.why}")
            fields = (system_id, AUTOPILOT, parameter.name, number_text(value), int(parameter.kind))
            lines.append("\t".join(map(str, fields)))
    return "\n".join(lines) + "\n"


def write_params(path: Path, wanted: Iterable[Parameter], profile: str) -> None:
    """Write `params_text` to ``path``; raises `BadInputError` where that can't be done."""
    try:
        path.write_text(params_text(wanted, profile), encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror}") from None


def read_params(path: Path) -> dict[str, Value]:
    """The autopilot's parameters in the file ``path``; those of other components are passed over.

    Raises `BadInputError` that names file and line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInputError(f"{path}: there is no such parameter file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path}: cannot be read: {error}") from None
    values: dict[str, Value] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            component, name, value = _parse(line)
            if component == AUTOPILOT and name in values:
                raise ValueError(f"{name} is set a second time; remove one of the lines")
        except ValueError as error:
            raise BadInputError(f"{path}:{number}: {error}") from None
        if component == AUTOPILOT:
            values[name] = value
    return values


def _parse(line: str) -> tuple[int, str, Value]:
    """Component, name and value of one ``line``; raises `ValueError` that says what is wrong with it."""
    fields = line.rstrip("\r\n").split("\t")
    if len(fields) != 5:
        raise ValueError(f"{len(fields)} columns; expected five: {COLUMNS}")
    system, component, name, value, kind = fields
    for what, field in (("vehicle", system), ("component", component)):
        if not field.isascii() or not field.isdigit() or int(field) > 255:
            raise ValueError(f"{what} id '{field}' is not a number from 0 to 255")
    if not _NAME.fullmatch(name):
        raise ValueError(f"'{name}' is not the name of a parameter (letters, digits and _, at most 16)")
    if kind not in (str(int(Kind.INT)), str(int(Kind.FLOAT))):
        raise ValueError(f"type '{kind}' of {name} is neither 6 (integer) nor 9 (float)")
    return int(component), name, _integer(name, value) if int(kind) == Kind.INT else _float(name, value)


def _integer(name: str, text: str) -> int:
    if not re.fullmatch(r"[+-]?\d+", text, re.ASCII) or not -(2**31) <= int(text) < 2**31:
        raise ValueError(f"{name} = '{text}' is not a 32 bit integer")
    return int(text)


def _float(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{name} = '{text}' is not a number") from None
    if not math.isfinite(value):
        raise ValueError(f"{name} = '{text}' is not finite")
    return value
