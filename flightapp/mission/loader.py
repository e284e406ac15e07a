"""Missions are Python files: `async def mission(drone)`, with a TRACK and SETTINGS beside it."""

import inspect
import runpy
import traceback
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightapp.inputs import BadInputError
from flightapp.mission.drone import Drone
from flightapp.track import Track, load_track


@dataclass(frozen=True, slots=True)
class MissionFile:
    """A mission as loaded from its file."""

    name: str
    path: Path
    track: Track
    settings: dict[str, Any]
    run: Callable[[Drone], Awaitable[None]]


def load_mission(path: Path) -> MissionFile:
    """Load and check a mission; raises `BadInputError` that says what is wrong and where."""
    if not path.is_file():
        raise BadInputError(f"{path}: there is no such mission file")
    try:
        names = runpy.run_path(str(path))
    except Exception as error:  # a mission is the user's own code: whatever it raises is told, not traced
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        raise BadInputError(f"{path}:{line}: {type(error).__name__}: {error}") from None
    run = names.get("mission")
    if not inspect.iscoroutinefunction(run):
        raise BadInputError(f"{path}: a mission needs `async def mission(drone)`")
    track = names.get("TRACK")
    if not isinstance(track, str):
        raise BadInputError(f'{path}: a mission needs TRACK = "tracks/name.toml", relative to the mission')
    settings = names.get("SETTINGS", {})
    if not isinstance(settings, dict) or not all(isinstance(key, str) for key in settings):
        raise BadInputError(f'{path}: SETTINGS must be a dict such as {{"race.v_max": 4.0}}')
    return MissionFile(path.stem, path, load_track(path.parent / track), settings, run)
