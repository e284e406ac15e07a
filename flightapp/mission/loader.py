"""Missions: Python files with `async def mission(drone)`, or TOML files with a list of steps."""

import asyncio
import inspect
import runpy
import traceback
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.mission.drone import BehaviorFailedError, Drone, Setting
from flightapp.mission.steps import read_steps
from flightapp.track import Track, load_track


class MissionError(Exception):
    """A mission's own code failed; the text says where and what."""


@dataclass(frozen=True, slots=True)
class MissionFile:
    """A mission as loaded from its file."""

    name: str
    path: Path
    track: Track
    settings: dict[str, Any]
    run: Callable[[Drone], Awaitable[None]]
    """Raises `BehaviorFailedError`, or `MissionError` for whatever else is wrong."""
    parameters: dict[str, Setting] = field(default_factory=dict)
    """The mission's own, with their defaults."""

    def set_parameters(self, config: Config) -> Mapping[str, Setting]:
        """The mission's parameters as ``config`` changes them; raises `BadInputError` for one that it has not."""
        values = dict(self.parameters)
        for name, value in config.mission.parameters.items():
            if name not in values:
                known = f"it has {', '.join(sorted(values))}" if values else "it has no PARAMETERS"
                raise BadInputError(f"{self.path}: the mission has no parameter '{name}'; {known}")
            values[name] = _like(values[name], value, f"mission.parameters.{name}")
        return values


def load_mission(path: Path) -> MissionFile:
    """Load and check a mission; raises `BadInputError` that says what is wrong and where."""
    if not path.is_file():
        raise BadInputError(f"{path}: there is no such mission file")
    return _load_steps(path) if path.suffix == ".toml" else _load_python(path)


def _load_steps(path: Path) -> MissionFile:
    steps = read_steps(path)
    return MissionFile(path.stem, path, load_track(path.parent / steps.track), steps.flat_settings(), steps.run)


def _load_python(path: Path) -> MissionFile:
    try:
        names = runpy.run_path(str(path))
    except Exception as error:  # a mission is the user's own code: whatever it raises is told, not traced
        raise BadInputError(f"{_place(path, error)}: {type(error).__name__}: {error}") from None
    run = names.get("mission")
    if not inspect.iscoroutinefunction(run):
        raise BadInputError(f"{path}: a mission needs `async def mission(drone)`")
    track = names.get("TRACK")
    if not isinstance(track, str):
        raise BadInputError(f'{path}: a mission needs TRACK = "tracks/name.toml", relative to the mission')
    settings = names.get("SETTINGS", {})
    if not isinstance(settings, dict) or not all(isinstance(key, str) for key in settings):
        raise BadInputError(f'{path}: SETTINGS must be a dict such as {{"race.v_max": 4.0}}')
    parameters = names.get("PARAMETERS", {})
    if not isinstance(parameters, dict) or not all(_is_parameter(*item) for item in parameters.items()):
        raise BadInputError(f'{path}: PARAMETERS must be a dict of numbers, words or truths, such as {{"rounds": 3}}')
    return MissionFile(path.stem, path, load_track(path.parent / track), settings, _placed(run, path), parameters)


def _placed(run: Callable[[Drone], Awaitable[None]], path: Path) -> Callable[[Drone], Awaitable[None]]:
    """``run``, whose own errors tell the line of the mission at which they came up."""

    async def placed(drone: Drone) -> None:
        try:
            await run(drone)
        except asyncio.CancelledError:
            raise
        except BaseException as error:
            first = _first(error)
            if isinstance(first, BehaviorFailedError):
                raise first from None
            if not isinstance(first, Exception):
                raise
            raise MissionError(f"{_place(path, first)}: {type(first).__name__}: {first}") from error

    return placed


def _first(error: BaseException) -> BaseException:
    """``error``, or the first of those that came up together."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


def _place(path: Path, error: BaseException) -> str:
    """Where in ``path`` an error came up: the last of its lines on the way to it."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return f"{path}:{frames[-1].lineno if frames else getattr(error, 'lineno', None)}"


def _is_parameter(name: object, value: object) -> bool:
    return isinstance(name, str) and isinstance(value, bool | int | float | str)


def _like(default: Setting, value: Setting, key: str) -> Setting:
    """``value`` as what ``default`` is; raises `BadInputError` where it is something else."""
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not type(default):
        raise BadInputError(f"'{key}' = {value!r}: as {default!r} it must be of the type {type(default).__name__}")
    return value
