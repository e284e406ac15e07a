"""QGroundControl's parameter files (.params): one tab-separated line per parameter.

Columns: vehicle id, component id, name, value, MAV_PARAM_TYPE (6: 32 bit integer, 9: 32 bit float); lines that begin
with # are comments. Format: QGroundControl's developer guide, "Parameters File Format".
"""

from collections.abc import Iterable
from pathlib import Path

from flightapp.autopilot.parameters import Parameter, Severity, number_text
from flightapp.inputs import BadInputError

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""


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
