"""The flight at a glance on a terminal: what it does, how well, and what is wrong."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from rich.console import Console, ConsoleOptions, RenderResult
from rich.segment import Segment
from rich.style import Style

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
NAME, WIDE = 16, 90
"""Columns of a name, and of a terminal from where on two values stand side by side."""
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

    def draw(self) -> "Sheet":
        """The dashboard as it stands."""
        bus = self._bus
        state = bus.state.latest
        stamp = state.stamp if state is not None else 0.0
        for rate, topic in ((self._sender, bus.command), (self._images, bus.frame), (self._poses, bus.pose)):
            rate.take(stamp, topic.count)
        title = f"{bus.phase.latest or 'starting'} · {max(stamp - (self._began or 0.0), 0.0):.1f} s"
        faults = [Line("", f"✗ {fault}", "bold red") for fault in tuple(self._faults.values())]
        events = [self._event_line(event) for event in tuple(self._events)]
        return Sheet(title, self._flight(state), self._health(stamp), [*faults, *events], bool(faults))

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

    def _event_line(self, event: Event) -> Line:
        style = "red" if event.kind == "fault" else "dim" if event.kind in ("autopilot", "guard") else ""
        return Line("", f"{event.stamp - (self._began or 0.0):8.2f} s  {event.text}", style)

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


@dataclass(frozen=True, slots=True)
class Sheet:
    """What a `Dashboard` shows at one moment.

    It makes its lines itself: tables and panels of rich take ten times as long, in which the sender would have to
    wait for the interpreter.
    """

    title: str
    left: Sequence[Line]
    right: Sequence[Line]
    below: Sequence[Line]
    alarm: bool

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The lines, none wider than the console."""
        width = options.max_width
        rule = Style.parse("red" if self.alarm else "cyan")
        yield Segment(f"── {self.title} {'─' * width}"[:width], rule)
        yield Segment.line()
        if width >= WIDE:
            for left, right in zip_longest(self.left, self.right, fillvalue=Line("", "")):
                yield from _cells(left, width // 2)
                yield from _cells(right, width - width // 2)
                yield Segment.line()
        else:
            for line in (*self.left, *self.right):
                yield from _cells(line, width)
                yield Segment.line()
        for line in (Line("", ""), *self.below):
            yield Segment(line.value[:width], Style.parse(line.style))
            yield Segment.line()
        yield Segment("─" * width, rule)
        yield Segment.line()


def _cells(line: Line, width: int) -> Iterator[Segment]:
    """Name and value of ``line``, together ``width`` wide."""
    yield Segment(f" {line.name:<{NAME - 1}}"[:width], Style.parse("dim"))
    yield Segment(f"{line.value:<{max(width - NAME, 0)}}"[: max(width - NAME, 0)], Style.parse(line.style))
