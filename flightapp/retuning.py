"""Gains that change in flight: all of them between two ticks, or none.

Only what a controller alone uses may change. What others were built with, such as the vehicle's delay or a limit that
plans keep to, may not. Plans are still screened with the gains that the flight began with.
"""

import asyncio
import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from flightapp.config import Config, Section
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
                found.append(Change(f"{name}.{key}", was, is_now, _may_change(old, key)))
    return tuple(found)


def _may_change(section: Section, key: str) -> bool:
    fixed = type(section).FIXED_IN_FLIGHT
    return fixed is not None and key not in fixed


def live_changes(before: Config, after: Config) -> tuple[Change, ...]:
    """`changes`, all of which may happen in flight; raises `BadInputError` naming those that may not."""
    found = changes(before, after)
    if barred := [str(change) for change in found if not change.live]:
        raise BadInputError(f"may not change in flight: {', '.join(barred)}")
    return found


class Retuner:
    """Holds the configuration of a flight and its ``controller``; ``load`` reads the configuration anew."""

    def __init__(self, config: Config, controller: Controller, load: Callable[[], Config]) -> None:
        self._config, self._controller, self.load = config, controller, load

    def apply(self, config: Config) -> str:
        """Go on with ``config``; what has changed, in words. Raises `BadInputError`, and nothing has changed then."""
        found = live_changes(self._config, config)
        if not found:
            return "nothing has changed"
        if not isinstance(self._controller, Tunable):
            raise BadInputError(f"the controller '{config.control.controller}' cannot be retuned in flight")
        self._controller.retune(config)
        self._config = config
        return ", ".join(map(str, found))


@contextlib.contextmanager
def hangups(asked: asyncio.Event) -> Iterator[None]:
    """Have SIGHUP set ``asked``, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop, before = asyncio.get_running_loop(), signal.getsignal(signal.SIGHUP)
    loop.add_signal_handler(signal.SIGHUP, asked.set)
    try:
        yield
    finally:
        loop.remove_signal_handler(signal.SIGHUP)
        signal.signal(signal.SIGHUP, before)
