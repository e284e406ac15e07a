"""PX4 parameters: what is wanted of one, and whether a value that was read is it.

Pure: names and values in, findings out. Which parameters an indoor flight wants is `wanted_parameters`' table.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Protocol

Value = int | float

FLOAT32 = 5e-7
"""Relative tolerance of what went through PX4's 32 bit floats."""


class Kind(IntEnum):
    """How PX4 stores a parameter: its MAV_PARAM_TYPE, as in QGroundControl's files."""

    INT = 6
    FLOAT = 9


class Severity(StrEnum):
    """How much hangs on a parameter."""

    MUST = "must"
    """Without it the vehicle doesn't fly, or not safely."""
    SHOULD = "should"
    """Without it it flies worse than it could."""
    NOTE = "note"
    """Worth knowing; it depends on the vehicle and is never written."""


class Verdict(StrEnum):
    """What a comparison found."""

    OK = "ok"
    DIFFERS = "differs"
    MISSING = "missing"
    """The autopilot has no such parameter."""
    UNREADABLE = "unreadable"
    """It did not answer."""


class Wanted(Protocol):
    """What a parameter's value should be like."""

    @property
    def text(self) -> str:
        """In words, for a table."""
        ...

    def accepts(self, value: Value) -> bool:
        """Whether ``value`` will do."""
        ...

    def mended(self, value: Value | None) -> Value | None:
        """What to write in place of ``value`` (None: nothing is known of it); None where a person must decide."""
        ...


@dataclass(frozen=True, slots=True)
class Within:
    """A value from ``low`` to ``high``, or one of ``choices``; ``write`` is the best of them."""

    low: float = math.inf
    high: float = -math.inf
    choices: tuple[float, ...] = ()
    write: float | None = None

    @property
    def text(self) -> str:
        """Such as "0.1 to 0.5 or 0"."""
        parts = [number_text(choice) for choice in self.choices]
        if self.low == self.high:
            parts.insert(0, number_text(self.low))
        elif self.low == -math.inf and self.high == math.inf:
            parts.insert(0, "any")
        elif self.high == math.inf:
            parts.insert(0, f"at least {number_text(self.low)}")
        elif self.low < self.high:
            parts.insert(0, f"{number_text(self.low)} to {number_text(self.high)}")
        return " or ".join(parts)

    def accepts(self, value: Value) -> bool:
        """Whether ``value`` is in the range or among the choices, as far as a 32 bit float tells."""
        if not math.isfinite(value):
            return False
        if any(same(value, choice) for choice in self.choices):
            return True
        return self.low <= value <= self.high or same(value, self.low) or same(value, self.high)

    def mended(self, value: Value | None) -> Value | None:
        """``write``, whatever the value was."""
        return self.write


def exactly(value: float) -> Within:
    """``value`` and nothing else."""
    return Within(value, value, write=value)


@dataclass(frozen=True, slots=True)
class Bits:
    """A bit mask in which ``on`` must be set and ``off`` clear; other bits are left as they are."""

    on: int = 0
    off: int = 0

    @property
    def text(self) -> str:
        """Such as "bits 0, 1, 2 set"."""
        parts = [f"{_bit_names(mask)} {word}" for mask, word in ((self.on, "set"), (self.off, "clear")) if mask]
        return ", ".join(parts)

    def accepts(self, value: Value) -> bool:
        """Whether the bits are as they should be."""
        if not math.isfinite(value):
            return False
        return int(value) & self.on == self.on and not int(value) & self.off

    def mended(self, value: Value | None) -> Value | None:
        """``value`` with these bits put right."""
        before = int(value) if value is not None and math.isfinite(value) else 0
        return (before | self.on) & ~self.off


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter that matters."""

    name: str
    kind: Kind
    wanted: Wanted
    severity: Severity
    term: str
    """Its short description in PX4's parameter reference."""
    why: str
    """One sentence: what it does to a flight."""
    reboot: bool = False
    """A new value counts only from the next start of the autopilot on."""
    absent: str = ""
    """Why a version without this parameter is fine; empty where it is not."""
    own: bool = False
    """It belongs to one vehicle; a file for any vehicle leaves it out."""

    def mended(self, value: Value | None) -> Value | None:
        """What to write in place of ``value``, in the type PX4 stores; None where a person must decide."""
        new = self.wanted.mended(value) if self.severity is not Severity.NOTE else None
        if new is None:
            return None
        return int(new) if self.kind is Kind.INT else float(new)


@dataclass(frozen=True, slots=True)
class Finding:
    """One parameter as it was found."""

    parameter: Parameter
    verdict: Verdict
    value: Value | None
    """None where it could not be read."""

    @property
    def mend(self) -> Value | None:
        """The value that would put it right; None where nothing needs writing, or a person must decide."""
        return self.parameter.mended(self.value) if self.verdict is Verdict.DIFFERS else None


def compare(wanted: Sequence[Parameter], values: Mapping[str, Value | None]) -> tuple[Finding, ...]:
    """What was read against what is ``wanted``, in its order.

    ``values`` has a number for what was read and None for what the autopilot doesn't have; a name that isn't there
    could not be read.
    """
    return tuple(_compare(parameter, values) for parameter in wanted)


def _compare(parameter: Parameter, values: Mapping[str, Value | None]) -> Finding:
    if parameter.name not in values:
        return Finding(parameter, Verdict.UNREADABLE, None)
    value = values[parameter.name]
    if value is None:
        return Finding(parameter, Verdict.MISSING, None)
    return Finding(parameter, Verdict.OK if parameter.wanted.accepts(value) else Verdict.DIFFERS, value)


def same(value: float, other: float) -> bool:
    """Whether two numbers are one as PX4 stores them."""
    return math.isclose(value, other, rel_tol=FLOAT32, abs_tol=1e-9)


def number_text(value: Value) -> str:
    """As short as it can be said without losing what a 32 bit float holds."""
    return f"{value:d}" if isinstance(value, int) else f"{value:.7g}"


def _bit_names(mask: int) -> str:
    bits = [str(bit) for bit in range(mask.bit_length()) if mask >> bit & 1]
    return ("bits " if len(bits) > 1 else "bit ") + ", ".join(bits)
