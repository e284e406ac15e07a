"""The flight at a glance on a terminal: what it does, how well, and what is wrong."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from flightapp.bus import Bus
from flightapp.interfaces import Rig
from flightapp.messages import Event, PlanReport, VehicleState
from flightapp.safety.faults import Fault, FaultKind

EVENTS = 8
"""Events that are shown, the newest last."""
PERIOD = 1.0
"""s of the flight over which rates are taken."""
FRESH = 0.1
"""s, a setpoint older than this is not being flown."""
LOW_BATTERY, OFF_LINE = 0.3, 0.5
"""Charge left and m off the line beyond which a value stands out."""


class Rate:
    """How often something comes, from a count that grows."""

    def __init__(self) -> None:
        self._from = (0.0, 0)
        self.value: float | None = None
        """Hz, over the last `PERIOD`; None before the first."""

    def take(self, stamp: float, count: int) -> None:
        """``count`` is what it is at ``stamp``."""
        since, before = self._from
        if count < before or stamp < since:
            self._from = stamp, count
        elif stamp - since >= PERIOD:
            self.value = (count - before) / (stamp - since) if before else None
            self._from = stamp, count


@dataclass(frozen=True, slots=True)
class Line:
    """One value of the dashboard."""

    name: str
    value: str
    style: str = ""


class Dashboard:
    """What is known of a flight, as something that rich can draw.

    `draw` may be called from another thread than the flight's: it reads the newest messages and holds nothing up.
    """

    def __init__(self, bus: Bus, rig: Rig) -> None:
        self._bus, self._rig = bus, rig
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._faults: dict[FaultKind, Fault] = {}
        self._plans = {True: 0, False: 0}
        self._began: float | None = None
        self._sender, self._images, self._poses = Rate(), Rate(), Rate()
        bus.event.tap(self._take_event)
        bus.fault.tap(self._take_fault)
        bus.plan.tap(self._take_plan)

    def draw(self) -> RenderableType:
        """The dashboard as it stands."""
        bus = self._bus
        state = bus.state.latest
        stamp = state.stamp if state is not None else 0.0
        for rate, topic in ((self._sender, bus.command), (self._images, bus.frame), (self._poses, bus.pose)):
            rate.take(stamp, topic.count)
        halves = Columns([_table(self._flight(state)), _table(self._health(stamp))], padding=(0, 6))
        title = f"{bus.phase.latest or 'starting'} · {max(stamp - (self._began or 0.0), 0.0):.1f} s"
        events = [self._event_line(event) for event in tuple(self._events)]
        faults = [Text(f"✗ {fault}", style="bold red", overflow="ellipsis", no_wrap=True) for fault in self._present()]
        return Panel(Group(halves, Text(), *faults, *events), title=title, border_style="red" if faults else "cyan")

    def _flight(self, state: VehicleState | None) -> Sequence[Line]:
        bus = self._bus
        active = ", ".join(bus.behaviors.latest or ()) or "none"
        lines = [Line("behavior", active)]
        if state is None:
            return [*lines, Line("position", "not known yet", "yellow")]
        x, y, z = state.position
        lines += [
            Line("position", f"{x:7.2f} {y:7.2f} {z:6.2f} m", "red" if state.doubt else ""),
            Line("speed", f"{float(np.linalg.norm(state.velocity)):5.2f} m/s"),
        ]
        setpoint = bus.setpoint.latest
        if setpoint is not None and abs(state.stamp - setpoint.stamp) < FRESH:
            error = float(np.linalg.norm(setpoint.position - state.position))
            lines.append(Line("off the line", f"{error:5.2f} m", "yellow" if error > OFF_LINE else ""))
        sigma = float(np.sqrt(max(np.trace(state.covariance[:3, :3]), 0.0)))
        lines.append(Line("uncertain by", f"{sigma:5.2f} m"))
        goal, known = bus.goal.latest, bus.gate_map.latest
        if goal is not None and goal.gate_ids:
            found = 0 if known is None else len(known.gates)
            lines.append(Line("gates", f"{goal.passed} of {len(goal.gate_ids)} passed, {found} known"))
        return lines

    def _health(self, stamp: float) -> Sequence[Line]:
        bus, status = self._bus, self._rig.autopilot.status.latest
        sending = bus.command.latest is not None and stamp - bus.command.latest.stamp < FRESH
        rate = self._sender.value
        told = "-" if rate is None or not sending else f"{rate:5.1f} Hz"
        lines = [Line("sender", told), Line("planner", *self._planner(bus.plan.latest))]
        lines.append(Line("poses, images", f"{_hertz(self._poses)}, {_hertz(self._images)}"))
        if status is not None:
            low = status.battery < LOW_BATTERY
            lines.append(
                Line("battery", f"{100 * status.battery:3.0f} %, {status.voltage:.1f} V", "red" if low else "")
            )
            lines.append(Line("autopilot", f"{status.mode.value}, {'armed' if status.armed else 'disarmed'}"))
        lines.append(Line("faults", str(len(self._faults) or "none"), "red" if self._faults else "green"))
        return lines

    def _planner(self, last: PlanReport | None) -> tuple[str, str]:
        if last is None:
            return "-", ""
        counts = f"{self._plans[True]} flown, {self._plans[False]} refused"
        return f"{counts}, last {1e3 * last.elapsed:.1f} ms", "" if last.accepted else "yellow"

    def _event_line(self, event: Event) -> Text:
        style = "red" if event.kind == "fault" else "dim" if event.kind in ("autopilot", "guard") else ""
        text = f"{event.stamp - (self._began or 0.0):8.2f} s  {event.text}"
        return Text(text, style=style, overflow="ellipsis", no_wrap=True)

    def _present(self) -> Sequence[Fault]:
        return list(self._faults.values())

    def _take_event(self, event: Event) -> None:
        if self._began is None:
            self._began = event.stamp
        self._events.append(event)

    def _take_fault(self, fault: Fault) -> None:
        if fault.over:
            self._faults.pop(fault.kind, None)
        else:
            self._faults[fault.kind] = fault

    def _take_plan(self, report: PlanReport) -> None:
        self._plans[report.accepted] += 1


def _hertz(rate: Rate) -> str:
    return "-" if rate.value is None else f"{rate.value:.0f} Hz"


def _table(lines: Sequence[Line]) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(no_wrap=True)
    for line in lines:
        table.add_row(line.name, Text(line.value, style=line.style))
    return table
