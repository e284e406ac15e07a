"""Flights with one fault each, judged by ground truth and by the autopilot's mode: is what happens what is stated?"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flightapp.evaluation.sweep import wilson_interval
from flightapp.frames import Vector
from flightapp.messages import AutopilotStatus, Collision, FlightMode
from flightapp.safety.faults import FaultKind, Reaction, Stage
from flightapp.safety.table import reaction_to

DOWN = 0.15
"""m, height of a vehicle on the ground."""
STILL = 0.3
"""m/s, of one that does not move."""
HOVERS = 0.2
"""m/s, of one that has stopped."""
PROMPT = 1.0
"""s from a fault's being noticeable to the reaction's being seen."""
SLOWING = 2.5
"""s, longest time in which the pace is reduced, beyond that."""
STOPPING = 4.0
"""s, longest time from being noticeable to standing."""
CLEARING = 5.0
"""s, longest time from being noticeable to the landing of a vehicle that comes to rest beyond what stands below."""
FASTER = 1.1
"""By which a slow flight may be faster than its share of the greatest speed."""
ASTRAY = 1.5
"""m from the finish at which a mission that went on may land."""
LET_GO = 0.1
"""s in which the last command is sent after a pilot has changed the mode."""
LANDING = (FlightMode.LAND, FlightMode.DESCEND)


@dataclass(frozen=True, slots=True)
class Stages:
    """When the stages of a flight begin, and when it is over; s of the flight's clock."""

    begin: Mapping[Stage, float]
    end: float
    passages: tuple[float, ...] = ()
    """When gates were passed."""

    def at(self, stamp: float) -> Stage:
        """The stage at ``stamp``."""
        return max((begin, stage) for stage, begin in self.begin.items() if begin <= stamp)[1]

    def window(self, stage: Stage) -> tuple[float, float]:
        """When ``stage`` begins and ends."""
        later = [t for t in (*self.begin.values(), self.end) if t > self.begin[stage]]
        return self.begin[stage], min(later, default=self.end)


@dataclass(frozen=True, slots=True)
class Seen:
    """What an observer outside has seen of a flight, and which faults the application has told of."""

    stamp: Vector
    """(n,) s, of the true motion."""
    position: Vector
    """(n, 3) m, world."""
    speed: Vector
    """(n,) m/s."""
    tilt: Vector
    """(n,) rad between the body's z axis and up."""
    statuses: Sequence[AutopilotStatus]
    passages: Sequence[int]
    """Gates that were passed, in their order."""
    collisions: Sequence[Collision]
    commands: Vector
    """(k, 2) when commands were sent, s, and their rate of roll and pitch, rad/s."""
    told: Mapping[FaultKind, float]
    """When the application told of each fault for the first time."""
    stages: Stages

    @property
    def last_command(self) -> float:
        """s, when the last command was sent; −∞ where none was."""
        return float(self.commands[-1, 0]) if self.commands.size else -math.inf

    def turning(self, stamp: float) -> float:
        """rad/s, rate of roll and pitch of the last command before ``stamp``."""
        sent = self.commands[self.commands[:, 0] <= stamp]
        return float(sent[-1, 1]) if sent.size else 0.0

    @property
    def armed(self) -> bool:
        """Whether it ever was."""
        return any(status.armed for status in self.statuses)

    @property
    def down(self) -> bool:
        """Whether it lies on the ground with its motors off in the end."""
        off = not self.statuses[-1].armed
        return bool(off and self.position[-1, 2] < DOWN and self.speed[-1] < STILL)

    def modes(self, begin: float, end: float = math.inf) -> list[FlightMode]:
        """The modes in which it was armed from ``begin`` on, in their order."""
        flown = [s.mode for s in self.statuses if s.armed and begin <= s.stamp < end]
        return [mode for mode, _ in itertools.groupby(flown)]


@dataclass(frozen=True, slots=True)
class Statement:
    """What is to be seen of one flight."""

    kind: FaultKind
    stage: Stage
    reaction: Reaction
    begin: float
    """s, when the fault begins."""
    notice: float
    """s until it can be noticed."""
    end: float
    """s, when it is over; infinite where it is not."""
    gates: Sequence[int]
    finish: Vector
    """(3,) m."""
    pushed: bool
    """Whether it may be anywhere in the end."""
    slow: float
    """m/s, what a slow flight may reach."""
    patience: float
    """s of hovering before a landing."""
    clearing: float = 0.0
    """s that it may fly on before a landing."""


def departure(said: Statement, seen: Seen) -> str:
    """How what was ``seen`` differs from what is ``said``; empty where it doesn't.

    The fault must have been told of, or another that follows from it and calls for the same.
    """
    since = min((stamp for kind, stamp in seen.told.items() if _fits(kind, said)), default=None)
    if since is None:
        return f"was not noticed, but {', '.join(seen.told) or 'nothing'} was"
    if not said.begin - 0.01 <= since:
        return "was noticed before it was there"
    return _JUDGES[said.reaction](said, seen)


def due(said: Statement) -> float:
    """s, when the reaction must be seen."""
    return said.begin + said.notice + PROMPT + said.clearing


def _fits(kind: FaultKind, said: Statement) -> bool:
    alike = said.reaction is not Reaction.CONTINUE and reaction_to(kind, said.stage) is said.reaction
    return kind is said.kind or alike


def _goes_on(said: Statement, seen: Seen) -> str:
    if list(seen.passages) != list(said.gates):
        return f"passed gates {list(seen.passages)}, not {list(said.gates)}"
    if not seen.down:
        return "is not on the ground in the end"
    astray = float(np.linalg.norm(seen.position[-1, :2] - said.finish[:2]))
    return f"landed {astray:.1f} m from the finish" if astray > ASTRAY and not said.pushed else ""


def _slows_down(said: Statement, seen: Seen) -> str:
    slow = (seen.stamp > said.begin + said.notice + SLOWING) & (seen.stamp < said.end)
    fastest = float(seen.speed[slow].max(initial=0.0))
    return f"still flies at {fastest:.2f} m/s" if fastest > FASTER * said.slow else _goes_on(said, seen)


def _holds(said: Statement, seen: Seen) -> str:
    due = (seen.stamp > said.begin) & (seen.stamp < said.begin + said.notice + STOPPING)
    if not (seen.speed[due] < HOVERS).any():
        return "did not stop"
    if said.end < math.inf:
        return _goes_on(said, seen)
    stopped = said.begin + said.notice + STOPPING
    noticed = said.begin + said.notice
    offboard = seen.modes(noticed, noticed + 0.5 * said.patience)
    if offboard != [FlightMode.OFFBOARD]:
        return f"does not hover: {', '.join(offboard)}"
    return _landed(seen, said.begin, stopped + said.patience + PROMPT)


def _refuses(said: Statement, seen: Seen) -> str:
    moved = float(np.abs(seen.position[-1, :2] - seen.position[0, :2]).max())
    return "was armed" if seen.armed else f"has moved by {moved:.2f} m" if moved > DOWN else ""


def _lands(said: Statement, seen: Seen) -> str:
    return _landed(seen, said.begin, due(said))


def _landed(seen: Seen, begin: float, by: float) -> str:
    flown = [s for s in seen.statuses if s.armed and s.stamp > begin]
    first = next((i for i, s in enumerate(flown) if s.mode in LANDING), None)
    if first is None:
        return "does not land"
    if (asked := flown[first].stamp) > by:
        return f"lands only {asked - begin:.1f} s later"
    if others := sorted({s.mode for s in flown[first:]} - set(LANDING)):
        return f"lands, then {', '.join(others)}"
    return "" if seen.down else "is not on the ground in the end"


def _kills(said: Statement, seen: Seen) -> str:
    by = said.begin + said.notice + PROMPT
    return "its motors still turn" if any(s.armed for s in seen.statuses if s.stamp > by) else ""


def _hands_back(said: Statement, seen: Seen) -> str:
    if seen.last_command > said.begin + LET_GO:
        return f"commands are sent {seen.last_command - said.begin:.2f} s later"
    flown = seen.modes(said.begin + LET_GO)
    return "" if flown == [FlightMode.POSITION, FlightMode.LAND] else f"after the pilot's mode: {', '.join(flown)}"


_JUDGES = {
    Reaction.CONTINUE: _goes_on,
    Reaction.SLOW: _slows_down,
    Reaction.HOLD: _holds,
    Reaction.REFUSE: _refuses,
    Reaction.LAND: _lands,
    Reaction.KILL: _kills,
    Reaction.HAND_BACK: _hands_back,
}


@dataclass(slots=True)
class Cell:
    """Flights with one fault in one stage."""

    kind: FaultKind
    stage: Stage
    reaction: Reaction
    runs: int = 0
    as_stated: int = 0
    crashes: int = 0
    """That the fault does not force."""
    forced: int = 0
    """Flights in which something was hit that the fault forces on the vehicle."""
    departures: list[tuple[int, str]] = field(default_factory=list)
    """Seeds, and what was seen instead."""

    def add(self, seed: int, departure: str, crash: str, forced: bool = False) -> None:
        """Count one flight: what was not as stated, and what was hit without need; both are mostly empty."""
        self.runs += 1
        self.forced += forced
        self.as_stated += not departure
        self.crashes += bool(crash)
        if why := "; ".join(text for text in (departure, crash) if text):
            self.departures.append((seed, why))

    @property
    def good(self) -> bool:
        """Whether all is as stated, and nothing was hit."""
        return self.as_stated == self.runs and not self.crashes


def matrix_json(cells: Sequence[Cell]) -> dict[str, Any]:
    """The machine-readable matrix; intervals are Wilson's, 95 %, of the flights that were as stated."""
    return {
        "rows": [
            {
                "fault": cell.kind.value,
                "phase": cell.stage.value,
                "reaction": cell.reaction.value,
                "runs": cell.runs,
                "as_stated": cell.as_stated,
                "crashes": cell.crashes,
                "forced": cell.forced,
                "ci95": list(wilson_interval(cell.as_stated, cell.runs)),
                "departures": [{"seed": seed, "why": why} for seed, why in cell.departures],
            }
            for cell in cells
        ]
    }
