"""Finding modules by name: entry points, so that another package can add one."""

import difflib
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from typing import Any

from flightapp.inputs import BadInputError


def find(kind: str, name: str) -> Any:
    """The entry point ``name`` of the group ``flightapp.<kind>``, loaded; raises `BadInputError`."""
    if name not in names(kind):
        _installed.cache_clear()  # it may have been installed since
    for entry in _installed(kind):
        if entry.name == name:
            try:
                return entry.load()
            except ImportError as error:
                raise BadInputError(
                    f"'{name}' of the {kind} cannot be loaded: {error}; install what it needs"
                ) from None
    known = names(kind)
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean '{close[0]}'? " if close else ""
    raise BadInputError(f"there is no '{name}' among the {kind}; {hint}known: {', '.join(known)}")


def names(kind: str) -> list[str]:
    """The names of all modules of a kind, such as "planners"."""
    return sorted(entry.name for entry in _installed(kind))


@cache
def _installed(kind: str) -> EntryPoints:
    """The group's entry points; to seek them reads the metadata of every package there is."""
    return entry_points(group=f"flightapp.{kind}")
