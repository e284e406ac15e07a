"""What an examination of the vehicle found: lines with a light each, as tables and as JSON."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from flightapp.autopilot.parameters import Finding, Severity, Value, Verdict, number_text

PARAMETERS = "PX4 parameters"


class Light(StrEnum):
    """Whether to fly."""

    GREEN = "green"
    AMBER = "amber"
    """It flies, but not as it should; or it can't be told from here."""
    RED = "red"
    """Don't."""


_STYLE = {Light.GREEN: "green", Light.AMBER: "yellow", Light.RED: "red"}


@dataclass(frozen=True, slots=True)
class Line:
    """One thing that was looked at."""

    group: str
    name: str
    light: Light
    found: str
    wanted: str = ""
    mend: str = ""
    """How to put it right; empty where nothing is wrong."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All that was looked at."""

    profile: str
    lines: tuple[Line, ...]
    findings: tuple[Finding, ...]

    def all_lines(self) -> tuple[Line, ...]:
        """The lines, then one for each parameter."""
        return (*self.lines, *map(parameter_line, self.findings))

    @property
    def light(self) -> Light:
        """The worst of all."""
        lights = {line.light for line in self.all_lines()}
        return next((light for light in (Light.RED, Light.AMBER) if light in lights), Light.GREEN)


def parameter_line(finding: Finding) -> Line:
    """The line of one parameter."""
    parameter = finding.parameter
    value = value_text(finding.value)
    bad = Light.RED if parameter.severity is Severity.MUST else Light.AMBER
    if finding.verdict is Verdict.OK:
        return Line(PARAMETERS, parameter.name, Light.GREEN, value, parameter.wanted.text)
    if finding.verdict is Verdict.MISSING:
        found = f"not on this version: {parameter.absent}" if parameter.absent else "not on this version"
        mend = "" if parameter.absent else "install a PX4 that has it (v1.16 does)"
        light = Light.GREEN if parameter.absent else bad
        return Line(PARAMETERS, parameter.name, light, found, parameter.wanted.text, mend)
    if finding.verdict is Verdict.UNREADABLE:
        mend = "look at the link, then ask again"
        return Line(PARAMETERS, parameter.name, bad, "no answer", parameter.wanted.text, mend)
    write = finding.mend
    mend = "a person must decide" if write is None else f"--fix sets {number_text(write)}"
    if parameter.reboot:
        mend += "; counts after a reboot"
    return Line(PARAMETERS, parameter.name, bad, value, parameter.wanted.text, mend)


def value_text(value: Value | None) -> str:
    """A parameter's value for a table."""
    return "–" if value is None else number_text(value)


def diagnosis_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """All of it, for a machine: lights, lines, and each parameter with its reason and PX4's own term for it."""
    return {
        "profile": diagnosis.profile,
        "light": str(diagnosis.light),
        "lines": [
            {key: str(getattr(line, key)) for key in ("group", "name", "light", "found", "wanted", "mend")}
            for line in diagnosis.lines
        ],
        "parameters": [_finding_json(finding) for finding in diagnosis.findings],
    }


def _finding_json(finding: Finding) -> dict[str, Any]:
    parameter = finding.parameter
    value = finding.value
    return {
        "name": parameter.name,
        "verdict": str(finding.verdict),
        "light": str(parameter_line(finding).light),
        "value": value if value is not None and math.isfinite(value) else None,
        "wanted": parameter.wanted.text,
        "write": finding.mend,
        "severity": str(parameter.severity),
        "why": parameter.why,
        "term": parameter.term,
        "reboot": parameter.reboot,
    }


def diagnosis_tables(diagnosis: Diagnosis) -> Iterator[Table | Text]:
    """For a terminal: what was looked at, the parameters that are wrong with their reasons, and the verdict."""
    yield _line_table(diagnosis.lines)
    wrong = [finding for finding in diagnosis.findings if parameter_line(finding).light is not Light.GREEN]
    if wrong:
        yield _parameter_table(wrong)
    fine = [finding.parameter.name for finding in diagnosis.findings if finding not in wrong]
    if fine:
        yield Text(f"{len(fine)} parameters as wanted: {', '.join(fine)}", style=_STYLE[Light.GREEN])
    counts = [sum(line.light is light for line in diagnosis.all_lines()) for light in (Light.RED, Light.AMBER)]
    verdict = {
        Light.RED: f"red: {counts[0]} to mend before flying, {counts[1]} more to look at",
        Light.AMBER: f"amber: flies; {counts[1]} to look at",
        Light.GREEN: "green: nothing is wrong",
    }
    yield Text(verdict[diagnosis.light], style=f"bold {_STYLE[diagnosis.light]}")


def _line_table(lines: Sequence[Line]) -> Table:
    """Group by group, on one screen."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("", "", "found", "wanted", "mend"):
        table.add_column(column, overflow="fold")
    for group in dict.fromkeys(line.group for line in lines):
        table.add_row("", Text(group, style="bold"))
        for line in lines:
            if line.group == group:
                cells = (Text(cell) for cell in (str(line.light), line.name, line.found, line.wanted, line.mend))
                table.add_row(*cells, style=_STYLE[line.light])
    return table


def _parameter_table(findings: Sequence[Finding]) -> Table:
    table = Table(title=PARAMETERS, title_justify="left", box=box.SIMPLE, show_lines=True)
    for column in ("", "value", "wanted", "why (PX4's term)", "mend"):
        table.add_column(column, overflow="fold", no_wrap=column == "")
    for finding in findings:
        line, parameter = parameter_line(finding), finding.parameter
        why = Text(f"{parameter.why} ({parameter.term})")
        cells = (Text(cell) for cell in (line.name, line.found, line.wanted))
        table.add_row(*cells, why, Text(line.mend), style=_STYLE[line.light])
    return table
