"""What a person sees while it flies."""

import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.status import Status
from rich.table import Table

from flightapp.app import Watch
from flightapp.bus import Bus
from flightapp.dashboard import Dashboard
from flightapp.interfaces import Rig
from flightapp.messages import Event
from flightapp.mission.rehearsal import Rehearsed

REFRESH, REDRAW = 0.1, 0.25
"""s on the wall between updates of the line, and of the dashboard."""


class _Screen:
    """One line that follows the flight, and the events above it.

    Written by a thread of its own: a terminal that is slow, or stopped, must not hold the flight up.
    """

    def __init__(self, console: Console, status: Status) -> None:
        self._console = console
        self._status = status
        self._bus: Bus | None = None
        self._events: deque[Event] = deque()
        self._began: float | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="display", daemon=True)
        self._thread.start()

    def watch(self, bus: Bus, _: Rig) -> None:
        """Follow ``bus``."""
        self._bus = bus
        bus.event.tap(self._events.append)

    def close(self) -> None:
        """Write what is left."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._over.wait(REFRESH):
            self._write()
        self._write()

    def _write(self) -> None:
        while self._events:
            event = self._events.popleft()
            style = "red" if event.kind == "fault" else None
            text = f"{self._since_begin(event.stamp):8.2f} s  {event.text}"
            self._console.print(text, style=style, highlight=False, markup=False)
        bus = self._bus
        if bus is None or (state := bus.state.latest) is None:
            return
        x, y, z = state.position
        speed = float(np.linalg.norm(state.velocity))
        goal = bus.goal.latest
        gates = f"  gates {goal.passed}/{len(goal.gate_ids)}" if goal is not None and goal.gate_ids else ""
        self._status.update(
            f"{self._since_begin(state.stamp):6.1f} s  {bus.phase.latest or '':8}  at ({x:6.2f} {y:6.2f} {z:5.2f}) m"
            f"  {speed:4.1f} m/s{gates}"
        )

    def _since_begin(self, stamp: float) -> float:
        if self._began is None:
            self._began = stamp
        return stamp - self._began


@contextmanager
def progress(console: Console) -> Iterator[Watch]:
    """A live line and the events of one flight."""
    with console.status("starting") as status:
        screen = _Screen(console, status)
        try:
            yield screen.watch
        finally:
            screen.close()


@contextmanager
def dashboard(console: Console) -> Iterator[Watch]:
    """The flight at a glance, drawn anew a few times a second; events as plain lines where there is no terminal."""
    if not console.is_terminal:
        with progress(console) as watch:
            yield watch
        return
    with Live(console=console, auto_refresh=False) as live:
        screen = _Glance(live)
        try:
            yield screen.watch
        finally:
            screen.close()


class _Glance:
    """Draws a `Dashboard` in a thread of its own, for the same reason as `_Screen`."""

    def __init__(self, live: Live) -> None:
        self._live = live
        self._dashboard: Dashboard | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="dashboard", daemon=True)
        self._thread.start()

    def watch(self, bus: Bus, rig: Rig) -> None:
        """Follow the flight."""
        self._dashboard = Dashboard(bus, rig)

    def close(self) -> None:
        """Draw how it ended."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._over.wait(REDRAW):
            self._draw()
        self._draw()

    def _draw(self) -> None:
        if self._dashboard is not None:
            self._live.update(self._dashboard.draw(), refresh=True)


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


def rehearsal_table(steps: Sequence[Rehearsed]) -> Table:
    """What a mission would do."""
    table = Table(title="What the mission would do", title_justify="left")
    table.add_column("", justify="right")
    for name in ("behavior", "parameters", "then at (m)", ""):
        table.add_column(name)
    for number, step in enumerate(steps, start=1):
        given = ", ".join(f"{key}={_short(value)}" for key, value in step.parameters.items())
        place = ", ".join(f"{value:.1f}" for value in step.destination)
        table.add_row(str(number), step.name, given, place, step.note)
    return table


def _short(value: object) -> str:
    """``value`` in words, unless it is long."""
    if isinstance(value, tuple) and len(value) > 3:
        return f"({len(value)} of them)"
    return repr(value)
