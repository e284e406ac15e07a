"""From flight logs to a vehicle file."""

import datetime
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomlkit
from rich.table import Table
from tomlkit.items import Table as TomlTable

from flightapp.config import Vehicle, load_config
from flightapp.evaluation.flight import Flight
from flightapp.identification.findings import Finding, Identified, identify
from flightapp.identification.series import SHORTEST, Stretch, stretches
from flightapp.inputs import BadInputError, validate
from flightapp.recording.reader import read_flight

LOG = "flight.mcap"


def identify_runs(runs: Sequence[Path], base: Path | None = None) -> Identified:
    """What the flights in ``runs`` (directories or logs) tell of their vehicle, beside what ``base`` says.

    Without ``base`` it is compared with what the first flight was flown with. Raises `BadInputError`.
    """
    parts: list[Stretch] = []
    flown: list[Vehicle] = []
    for run in runs:
        path = run / LOG if run.is_dir() else run
        flight = read_flight(path)
        vehicle = _vehicle(path, flight)
        parts += _parts(path, flight, vehicle)
        flown.append(vehicle)
    before = load_config(base).vehicle if base is not None else flown[0]
    return identify(parts, before, not any(vehicle.learn_hover_thrust for vehicle in flown))


def _vehicle(path: Path, flight: Flight) -> Vehicle:
    """The vehicle section that ``flight`` was flown with."""
    try:
        table = tomllib.loads(flight.header["config"])["vehicle"]
    except (KeyError, tomllib.TOMLDecodeError):
        raise BadInputError(f"{path}: the flight log doesn't say with which configuration it was flown") from None
    return validate(Vehicle, table, f"{path}: its configuration")


def _parts(path: Path, flight: Flight, vehicle: Vehicle) -> list[Stretch]:
    if flight.commands.stamp.size == 0:
        raise BadInputError(f"{path}: no commands are in it: the vehicle never flew along a line of ours")
    if flight.states.stamp.size == 0:
        raise BadInputError(f"{path}: no states are in it, so nothing tells what the commands did")
    parts = stretches(flight, vehicle)
    if not parts:
        raise BadInputError(
            f"{path}: nowhere did the autopilot follow our commands in flight for {SHORTEST + 1.0:g} s on end;"
            " fly missions/identify.py"
        )
    return parts


def findings_table(found: Identified) -> Table:
    """Parameter, before, found, ±, unit, and how well the model fits."""
    table = Table("parameter", "before", "found", "±", "unit", "fit", "")
    for column in table.columns[1:4]:
        column.justify = "right"
    for one in found.findings:
        sigma = "" if math.isnan(one.sigma) else f"{one.sigma:.2g}"
        quality = "" if math.isnan(one.quality) else f"{100.0 * one.quality:.1f} %"
        table.add_row(one.name, f"{one.before:.4g}", f"{one.value:.4g}", sigma, one.unit, quality, one.note)
    for refusal in found.refusals:
        table.add_row(refusal.name, "", "not told", "", "", "", refusal.why)
    return table


def findings_json(found: Identified) -> dict[str, Any]:
    """``found`` for other programs; SI units."""

    def entry(one: Finding) -> dict[str, Any]:
        numbers = {"before": one.before, "value": one.value, "sigma": one.sigma, "fit": one.quality}
        finite = {key: None if math.isnan(value) else value for key, value in numbers.items()}
        return {"parameter": one.name, **finite, "unit": one.unit, "note": one.note}

    return {
        "duration": found.duration,
        "found": [entry(one) for one in found.findings],
        "not_told": [{"parameter": refusal.name, "why": refusal.why} for refusal in found.refusals],
    }


def vehicle_text(found: Identified, base: Path | None, source: str, date: datetime.date) -> str:
    """``base``, or an empty file, as TOML with what was ``found`` in its vehicle section; each line says how well.

    ``source`` names the flights in a comment.
    """
    document = tomlkit.parse(base.read_text(encoding="utf-8")) if base is not None else tomlkit.document()
    if "vehicle" not in document:
        document["vehicle"] = tomlkit.table()
    table = document["vehicle"]
    assert isinstance(table, TomlTable)  # the file has been read as a vehicle file
    for key in dict.fromkeys(one.key for one in found.findings):
        ones = [one for one in found.findings if one.key == key]
        item = tomlkit.item(_value(ones, found.before))
        table[key] = item.comment(f"{_comment(ones)}, {source}, {date.isoformat()}")
    return tomlkit.dumps(document)


def _value(ones: Sequence[Finding], before: Vehicle) -> Any:
    if ones[0].axis is None:
        return _rounded(ones[0])
    values = list(getattr(before, ones[0].key))
    for one in ones:
        values[one.axis or 0] = _rounded(one)
    return values


def _rounded(one: Finding) -> float:
    """To a tenth of the standard error, or four digits."""
    digits = 1 - math.floor(math.log10(one.sigma)) if one.sigma > 0.0 else 4
    return round(one.value, min(digits, 6))


def _comment(ones: Sequence[Finding]) -> str:
    sigmas = [f"{one.sigma:.2g}" for one in ones if not math.isnan(one.sigma)]
    unit = f" {ones[0].unit}" if ones[0].unit else ""
    return f"± {', '.join(sigmas)}{unit}" if sigmas else (ones[0].note or "found")


def write_vehicle(path: Path, text: str) -> None:
    """Write a vehicle file; raises `BadInputError` where that cannot be."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"--out {path}: cannot be written: {error.strerror or error}") from None
