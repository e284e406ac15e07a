"""Gains that change in flight: all of them between two ticks, or none.

Only what a controller alone uses may change. What others were built with, such as the vehicle's delay or a limit that
plans keep to, may not. Plans are still screened with the gains that the flight began with.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from flightapp.config import Config, with_settings
from flightapp.config.fields import bounds
from flightapp.inputs import BadInputError
from flightapp.interfaces import Controller, Tunable


@dataclass(frozen=True, slots=True)
class Change:
    """A field of the configuration that has another value."""

    key: str
    before: object
    after: object
    live: bool
    """Whether it may change in flight."""

    def __str__(self) -> str:
        return f"{self.key} {self.before} → {self.after}"


def changes(before: Config, after: Config) -> tuple[Change, ...]:
    """What differs between two configurations, in the order of the sections."""
    found = []
    for name in Config.model_fields:
        old, new = getattr(before, name), getattr(after, name)
        for key in type(old).model_fields:
            was, is_now = getattr(old, key), getattr(new, key)
            if was != is_now:
                found.append(Change(f"{name}.{key}", was, is_now, old.may_change_in_flight(key)))
    return tuple(found)


def live_changes(before: Config, after: Config) -> tuple[Change, ...]:
    """`changes`, all of which may happen in flight; raises `BadInputError` naming those that may not."""
    found = changes(before, after)
    if barred := [str(change) for change in found if not change.live]:
        raise BadInputError(f"may not change in flight: {', '.join(barred)}")
    return found


@dataclass(frozen=True, slots=True)
class LiveField:
    """A field that may change in flight."""

    key: str
    value: object
    bounds: str
    """Such as "> 0.1, ≤ 20"; empty where there are none."""
    description: str


def live_fields(config: Config) -> tuple[LiveField, ...]:
    """All fields that may change in flight, with their values in ``config``, in the order of the sections."""
    found = []
    for name in Config.model_fields:
        section = getattr(config, name)
        for key, described in type(section).model_fields.items():
            if section.may_change_in_flight(key):
                text = described.description or ""
                found.append(LiveField(f"{name}.{key}", getattr(section, key), bounds(described), text))
    return tuple(found)


class Retuner:
    """Holds the configuration of a flight and its ``controller``; ``load`` reads the configuration anew.

    What was set in flight stands over the files until the flight ends, as ``--set`` does: a reload keeps it.
    """

    def __init__(self, config: Config, controller: Controller, load: Callable[[], Config]) -> None:
        self._config, self._controller, self._load = config, controller, load
        self._set: dict[str, str] = {}

    @property
    def config(self) -> Config:
        """The one that is flown with."""
        return self._config

    def propose(self, settings: Mapping[str, str] | None) -> Config:
        """The configuration with other ``settings`` (value by section.key), or as its files are now (None).

        Changes nothing, and may be called from another thread; raises `BadInputError`.
        """
        if settings is None:
            return with_settings(self._load(), self._set, "tune set")
        return with_settings(self._config, settings, "tune set")

    def apply(self, config: Config, settings: Mapping[str, str] | None = None) -> str:
        """Go on with ``config``, proposed for ``settings``; what has changed, in words.

        Raises `BadInputError`, and nothing has changed then.
        """
        if found := live_changes(self._config, config):
            if not isinstance(self._controller, Tunable):
                raise BadInputError(f"the controller '{config.control.controller}' cannot be retuned in flight")
            self._controller.retune(config)
        self._config = config
        self._set |= settings or {}
        return ", ".join(map(str, found)) or "nothing has changed"
