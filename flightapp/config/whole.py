"""The whole configuration, checked together, and how it is read and written."""

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import model_validator

from flightapp.config.fields import Section
from flightapp.config.flight import Control, Guard, Mission, Mpc, Mpcc, Planning, Race
from flightapp.config.perception import Detection, Estimation, GateMapping, Sensors
from flightapp.config.safety import Geofence, Safety
from flightapp.config.system import Compute, ExternalVision, Link, Realtime, Recording, Simulation
from flightapp.config.vehicle import Camera, Vehicle
from flightapp.frames import GRAVITY
from flightapp.inputs import BadInputError, Location, read_toml, validate


class Config(Section):
    """Everything that can be set."""

    vehicle: Vehicle = Vehicle()
    camera: Camera = Camera()
    detection: Detection = Detection()
    estimation: Estimation = Estimation()
    mapping: GateMapping = GateMapping()
    planning: Planning = Planning()
    control: Control = Control()
    mpc: Mpc = Mpc()
    mpcc: Mpcc = Mpcc()
    race: Race = Race()
    mission: Mission = Mission()
    safety: Safety = Safety()
    geofence: Geofence = Geofence()
    guard: Guard = Guard()
    link: Link = Link()
    external_vision: ExternalVision = ExternalVision()
    sensors: Sensors = Sensors()
    realtime: Realtime = Realtime()
    compute: Compute = Compute()
    recording: Recording = Recording()
    sim: Simulation = Simulation()

    @model_validator(mode="after")
    def _flyable(self) -> "Config":
        available = self.vehicle.thrust_max
        needed = math.hypot(GRAVITY, self.race.a_max)
        if needed > available:
            fits = math.sqrt(max(available**2 - GRAVITY**2, 0.0))
            raise ValueError(
                f"race.a_max = {self.race.a_max} m/s² needs {needed:.1f} m/s² of thrust in level flight, but"
                f" vehicle.thrust_to_weight = {self.vehicle.thrust_to_weight} gives {available:.1f};"
                f" race.a_max may be at most {fits:.1f}"
            )
        slowest = min(self.vehicle.drag[0], self.vehicle.drag[1])
        if slowest > 0.0:
            tilt = math.radians(self.control.tilt_max_deg)
            push = min(GRAVITY * math.tan(min(tilt, 1.5)), math.sqrt(available**2 - GRAVITY**2))
            reachable = push / slowest
            if self.race.v_max > reachable:
                raise ValueError(
                    f"race.v_max = {self.race.v_max} m/s cannot be flown: with vehicle.drag = {slowest} 1/s the"
                    f" thrust balances the drag at {reachable:.1f} m/s; race.v_max may be at most that"
                )
        return self


def load_config(
    vehicle_file: Path | None = None,
    mission: Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
) -> Config:
    """Defaults ← ``vehicle_file`` ← the mission's dotted settings ← ``--set`` strings "section.key=value"."""
    layers: list[tuple[str, dict[str, Any]]] = []
    if vehicle_file is not None:
        layers.append((str(vehicle_file), read_toml(vehicle_file, "vehicle file")))
    if mission:
        layers.append(("mission", _nested(mission.items(), "mission")))
    for text in overrides:
        key, separator, value = text.partition("=")
        if not separator:
            raise BadInputError(f"--set {text}: expected section.key=value")
        layers.append(_setting(f"--set {text}", key, value))
    return _built(layers)


def with_settings(config: Config, settings: Mapping[str, str], what: str) -> Config:
    """``config`` with other ``settings``, each a value as in ``--set`` by its section.key, as ``what`` gives them."""
    given = [_setting(f"{what} {key}={value}", key, value) for key, value in settings.items()]
    return _built([("the present configuration", config.model_dump()), *given])


def _setting(source: str, key: str, value: str) -> tuple[str, dict[str, Any]]:
    return source, _nested([(key.strip(), _parse_value(value.strip()))], source)


def _built(layers: Sequence[tuple[str, dict[str, Any]]]) -> Config:
    """What ``layers``, each with its source, make of the defaults; the last counts."""
    data: dict[str, Any] = {}
    origin: dict[Location, str] = {}
    for source, layer in layers:
        for section, table in layer.items():
            if not isinstance(data.get(section, {}), dict):
                continue  # what an earlier source got wrong stays, to be told
            origin[section,] = source
            if not isinstance(table, dict):
                data[section] = table
                continue
            merged = data.setdefault(section, {})
            for key, value in table.items():
                both = isinstance(value, dict) and isinstance(merged.get(key), dict)
                merged[key] = merged[key] | value if both else value
                origin[section, key] = source
    everything = ", ".join(source for source, _ in layers) or "defaults"
    return validate(Config, data, lambda at: origin.get(at[:2], origin.get(at[:1], everything)))


def dump_config(config: Config) -> str:
    """``config`` as TOML, complete, with each field's description as a comment."""
    document = tomlkit.document()
    for name in Config.model_fields:
        section: Section = getattr(config, name)
        table = tomlkit.table()
        for key, sub_field in type(section).model_fields.items():
            value = getattr(section, key)
            if isinstance(value, dict):
                item: Any = tomlkit.inline_table()
                item.update(value)
            else:
                item = tomlkit.item(list(value) if isinstance(value, tuple) else value)
            item.comment(sub_field.description or "")
            table.add(key, item)
        document.add(name, table)
    return tomlkit.dumps(document)


def _nested(settings: Iterable[tuple[str, Any]], source: str) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for key, value in settings:
        section, separator, name = key.partition(".")
        if not separator or not section or not name:
            sections = ", ".join(Config.model_fields)
            raise BadInputError(f"{source}: '{key}': expected section.key, with one of the sections {sections}")
        name, inner, part = name.partition(".")
        table = data.setdefault(section, {})
        table[name] = {**table.get(name, {}), part: value} if inner else value
    return data


def _parse_value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (tomllib.TOMLDecodeError, RecursionError):
        return text
    return parsed["value"] if len(parsed) == 1 else text
