"""What a person sees while it flies."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.status import Status

from flightapp.app import Watch
from flightapp.bus import Bus
from flightapp.interfaces import Rig
from flightapp.messages import Event, VehicleState

REFRESH = 0.1
"""s on the wall between updates of the line."""


class _Line:
    """One line that follows the flight, and the events above it."""

    def __init__(self, console: Console, status: Status) -> None:
        self._console = console
        self._status = status
        self._drawn = 0.0
        self._bus: Bus | None = None

    def watch(self, bus: Bus, rig: Rig) -> None:
        """Follow ``bus``."""
        self._bus = bus
        bus.state.tap(self._on_state)
        bus.event.tap(self._on_event)

    def _on_state(self, state: VehicleState) -> None:
        wall = time.monotonic()
        if wall - self._drawn < REFRESH or self._bus is None:
            return
        self._drawn = wall
        x, y, z = state.position
        speed = float(np.linalg.norm(state.velocity))
        goal = self._bus.goal.latest
        gates = f"  gates {goal.passed}/{len(goal.gate_ids)}" if goal is not None and goal.gate_ids else ""
        self._status.update(
            f"{state.stamp:6.1f} s  {self._bus.phase.latest or '':8}  at ({x:6.2f} {y:6.2f} {z:5.2f}) m"
            f"  {speed:4.1f} m/s{gates}"
        )

    def _on_event(self, event: Event) -> None:
        style = "red" if event.kind == "fault" else None
        self._console.print(f"{event.stamp:8.2f} s  {event.text}", style=style, highlight=False, markup=False)


@contextmanager
def progress(console: Console) -> Iterator[Watch]:
    """A live line and the events of one flight."""
    with console.status("starting") as status:
        yield _Line(console, status).watch


@contextmanager
def bar(console: Console, total: int) -> Iterator[Callable[[bool], None]]:
    """A progress bar over ``total`` flights; call it with each one's success."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as shown:
        task = shown.add_task("flying", total=total)
        good = 0

        def advance(success: bool) -> None:
            nonlocal good
            good += success
            shown.update(task, advance=1, description=f"flying, {good} good")

        yield advance
