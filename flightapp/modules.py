"""Finding modules by name: entry points, so that another package can add one."""

from importlib.metadata import entry_points
from typing import Any

from flightapp.inputs import BadInputError


def find(kind: str, name: str) -> Any:
    """The entry point ``name`` of the group ``flightapp.<kind>``, loaded; raises `BadInputError`."""
    group = entry_points(group=f"flightapp.{kind}")
    for entry in group:
        if entry.name == name:
            return entry.load()
    known = ", ".join(sorted(entry.name for entry in group))
    raise BadInputError(f"there is no '{name}' among the {kind}; known: {known}")
