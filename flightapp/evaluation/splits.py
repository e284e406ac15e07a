"""Lap and split times of a race, and what was lost on each leg against a line that is the fastest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

FINISH = "finish"


@dataclass(frozen=True, slots=True)
class Split:
    """One leg: from the start or a gate to the next gate, or to the finish."""

    lap: int
    to: str
    """The gate's id, or `FINISH`."""
    time: float | None
    """s; None where the leg's beginning or end was missed."""


@dataclass(frozen=True, slots=True)
class Lap:
    """From the start, or the last gate of the lap before, to the last gate of this one."""

    lap: int
    time: float | None
    """s; None where one of the two gates was missed."""


@dataclass(frozen=True, slots=True)
class Loss:
    """A leg beside the same leg of the fastest line."""

    lap: int
    to: str
    flown: float | None
    """s."""
    least: float
    """s."""

    @property
    def lost(self) -> float | None:
        """s."""
        return None if self.flown is None else self.flown - self.least


def splits(gates: Sequence[Mapping[str, Any]], elapsed: float) -> tuple[Split, ...]:
    """Each leg of a race that took ``elapsed`` (s); ``gates`` are a summary's, in the order of passage."""
    legs, before = [], 0.0
    times = [(gate["lap"], str(gate["id"]), gate["time"]) for gate in gates]
    if times:
        times.append((times[-1][0], FINISH, elapsed))
    known: float | None = before
    for lap, name, time in times:
        legs.append(Split(lap, name, None if time is None or known is None else time - known))
        known = time
    return tuple(legs)


def laps(gates: Sequence[Mapping[str, Any]]) -> tuple[Lap, ...]:
    """Each lap; ``gates`` are a summary's, in the order of passage."""
    ends = {gate["lap"]: gate["time"] for gate in gates}
    found, before = [], 0.0
    known: float | None = before
    for lap, time in ends.items():
        found.append(Lap(lap, None if time is None or known is None else time - known))
        known = time
    return tuple(found)


def losses(flown: Sequence[Split], gate_times: Sequence[float], duration: float) -> tuple[Loss, ...]:
    """``flown`` beside a line that is at the same gates after ``gate_times`` (s) and at its end after ``duration`` (s).

    Raises ValueError where the line has not one time for each gate of the flight.
    """
    times = (*gate_times, duration)
    if len(times) != len(flown):
        raise ValueError(f"a line with {len(gate_times)} gates, and a flight with {len(flown) - 1}")
    least = [now - before for now, before in zip(times, (0.0, *times[:-1]), strict=True)]
    return tuple(Loss(leg.lap, leg.to, leg.time, best) for leg, best in zip(flown, least, strict=True))
