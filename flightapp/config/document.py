"""Every field of the configuration as a page of the documentation."""

import enum
import re
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from flightapp.config.fields import Section, bounds
from flightapp.config.whole import Config

INTRODUCTION = """# Configuration

Every field, from the models in `flightapp/config/`, which check a file whole before anything is armed: an unknown key
is an error that names the file, the key and the nearest known one, and so is a value outside its range.
Values come from the defaults below ← the `--vehicle` file ← the mission's `SETTINGS` ← `--set section.key=value`.
In files `section` is a table; `flightapp check` prints the effective configuration as such a file.

Units are SI, but for degrees in keys that end in `_deg`. A range such as `> 0, ≤ 2` holds for the value; where there is
none, what the meaning says is checked. Fields marked in the last column may change while flying.
"""

UNITS = (
    *("m/s²/√Hz", "m/s²/√s", "rad/√m", "rad/√s", "s²/m²", "rad/s²", "kg m²", "m/s²", "m/s³", "m/√m", "m/√s"),
    *("px RMS", "rad/s", "m/s", "1/s", "deg", "rad", "0..1", "MB", "Hz", "kg", "px", "°", "V", "m", "s"),
)
"""With which a description begins where its field has a unit, the longest first."""
_UNIT = re.compile(rf"({'|'.join(map(re.escape, UNITS))})(?![\w'/])(?:[,:] )?")


def document() -> str:
    """The page, in Markdown."""
    lines = [INTRODUCTION]
    for name, field in Config.model_fields.items():
        section = field.annotation
        assert isinstance(section, type)
        lines += [f"## {name}", "", (section.__doc__ or "").strip(), ""]
        lines += ["| key | type | default | range | unit | meaning | in flight |", "| --- " * 7 + "|"]
        lines += [_row(section, key, inner) for key, inner in section.model_fields.items()]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def unit_and_meaning(description: str) -> tuple[str, str]:
    """``description`` without the unit that it begins with, and that unit; "" where it has none."""
    found = _UNIT.match(description)
    return (found[1], description[found.end() :].strip()) if found else ("", description)


def _row(section: type[Section], key: str, field: FieldInfo) -> str:
    unit, meaning = unit_and_meaning(field.description or "")
    default = field.get_default(call_default_factory=True)
    cells = (
        *(f"`{key}`", _type(field.annotation), f"`{_toml(default)}`", bounds(field), unit, meaning),
        "yes" if section.may_change_in_flight(key) else "",
    )
    return f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |"


def _type(annotation: Any) -> str:
    """In words, such as "3 numbers"."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is tuple:
        count = "list of" if inner[-1] is Ellipsis else str(len(inner))
        return f"{count} {_plural(inner[0])}"
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_type, inner)))
    if choices := _choices(annotation):
        return f"one of {', '.join(f'`{choice}`' for choice in choices)}"
    return _PLAIN[annotation] if origin is None else _PLAIN.get(origin) or _type(inner[0])


_PLAIN: dict[Any, str] = {bool: "true or false", int: "integer", float: "number", str: "text", dict: "table"}


def _choices(annotation: Any) -> list[str]:
    """The values of an enumeration or a Literal; none of anything else."""
    if get_origin(annotation) is Literal:
        return [str(choice) for choice in get_args(annotation)]
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        return [str(member.value) for member in annotation]
    return []


def _plural(annotation: Any) -> str:
    if get_origin(annotation) is tuple:
        return f"({', '.join(_type(part) for part in get_args(annotation))})"
    return _type(annotation) + "s"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, enum.Enum):
        value = value.value
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
