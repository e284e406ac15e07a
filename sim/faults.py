"""Faults that a world in the same process can have, from sim.faults: (s, name, value).

The time is that of the flight's clock, which starts at 0 when the world is made; a sample or an image is affected by
the time at which it was captured. What lasts, lasts to the end of the flight where no duration is given.

| fault             | value         | what happens                                                                  |
| ----------------- | ------------- | ----------------------------------------------------------------------------- |
| pose_silent       | s             | the tracker measures nothing                                                  |
| pose_jump         | m             | poses for `JUMP_TIME` are off by as much, along their frame's x               |
| pose_relocalised  | m or m:deg    | the tracker's frame moves (along its x) and turns (about the vehicle)         |
| pose_frozen       | s             | the tracker tells the same pose again and again, with new stamps              |
| pose_slipping     | m/s           | velocities are off by as much, along their frame's x; positions are right     |
| camera_silent     | s             | the camera delivers nothing                                                   |
| camera_frozen     | s             | the camera delivers the same image again and again, with new stamps           |
| camera_black      | s             | its images are black                                                          |
| camera_slow       | Hz            | images come no more often                                                     |
| camera_late       | s             | images come later by as much                                                  |
| sightings_wrong   | share         | of the images are as if taken from another place (`ASIDE`, `TURNED`)          |
| calibration_wrong | share         | the focal length is believed to be greater by as much; from the start         |
| gate_missing      | id            | the gate does not stand; from the start                                       |
| gate_moved        | id:m          | the gate moves to the left of its direction of passage, or right if negative  |
| gates_swapped     | id:id         | two gates change places                                                       |
| gust              | vx:vy:s       | wind of so many m/s (world) besides the others, for so long                    |
| tipped            | deg           | it is held, and turned about its x axis within `TIPPING`; rotors survive the   |
|                   |               | ground                                                                        |
| battery           | 0..1          | that is left of the charge                                                    |
| pilot             | mode          | a pilot with a transmitter chooses a mode by its name in PX4, such as POSCTL   |
| pilot_lands       | s             | who has taken over brakes for so long at least, flies clear, and lands        |
| link_silent       | s             | nothing gets through to the autopilot or back                                 |
| loop_stall        | s             | the application's event loop has no turn                                      |
| loop_busy         | s             | for so long it has no turn for `BUSY` of every `BUSY` + `IDLE`                 |
| compute_slow      | factor        | whatever runs in the worker takes as many times longer                        |
| planner_failing   | s             | every plan fails                                                              |
| task_failing      | source        | the camera's or the tracker's driver raises an exception                      |
| disk_full         | MB            | that are left where the log is written                                        |
| log_failing       | s             | what is written to the log is refused                                         |
| clock_jump        | s             | by which the wall clock jumps                                                 |

What flight code shall do about the sensors and the gates (about the others: flightapp/safety/table.py):

| fault                       | reaction                                                                               |
| --------------------------- | -------------------------------------------------------------------------------------- |
| pose_silent, pose_frozen    | coasts for estimation.coast and flies on where poses are back by then; else it hands   |
|                             | over to the autopilot, which lands                                                     |
| pose_jump, pose_relocalised | flies on; nothing else is visible                                                      |
| camera_silent,              | flies on if it is short; after safety.camera_timeout stops along the line, goes on     |
| camera_frozen               | when images are back, and lands after safety.hold_time                                 |
| camera_black                | flies on through gates that are known; stops before others, or where a gate ought to   |
|                             | be in sight, searches, and lands when race.search_timeout is over: WRONG_PROGRESS      |
| camera_slow, camera_late    | flies on                                                                               |
| sightings_wrong             | flies on: what contradicts the map is not used                                         |
| calibration_wrong           | flies on, off the gates' centres                                                       |
| gate_missing                | searches for it, and lands when race.search_timeout is over: WRONG_PROGRESS            |
| gate_moved                  | says so, learns the new place and flies through there                                  |
| gates_swapped               | says so as soon as one is seen in the other's place, takes the other to be in its own, |
|                             | and flies through all in their order                                                   |
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from flightapp.inputs import BadInputError
from sim.fault_values import Value, nav_state, number, numbers, pair, seconds, share, unknown

JUMP_TIME = 0.03
"""s, of a jump that comes back."""
LATEST = 0.4
"""s, greatest additional latency of the camera."""
TIPPING = 0.4
"""s in which a vehicle is turned over."""
BUSY, IDLE = 0.03, 0.01
"""s that a busy event loop has no turn, and then one."""

Amount = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault from ``begin`` to before ``end`` (s of the flight's clock); ``amount`` is its value."""

    begin: float
    end: float
    name: str
    amount: Amount

    def acts(self, stamp: float) -> bool:
        """Whether it does so at ``stamp``."""
        return self.begin <= stamp < self.end


def _duration(value: Value) -> Amount:
    return (seconds(value),)


def _one(value: Value) -> Amount:
    return (number(value),)


def _share(value: Value) -> Amount:
    return (share(value),)


def _rate(value: Value) -> Amount:
    if (read := number(value)) <= 0.0:
        raise ValueError(f"a rate is more than 0 Hz, not {read:g}")
    return (read,)


def _lateness(value: Value) -> Amount:
    if (read := seconds(value)) > LATEST:
        raise ValueError(f"at most {LATEST} s, not {read:g}")
    return (read,)


def _relative(value: Value) -> Amount:
    if abs(read := number(value)) > 0.5:
        raise ValueError(f"at most 0.5 more or less, not {read:g}")
    return (read,)


def _move_and_turn(value: Value) -> Amount:
    return pair(value) if isinstance(value, str) and ":" in value else (number(value), 0.0)


def _gust(value: Value) -> Amount:
    vx, vy, duration = numbers(value, 3)
    return vx, vy, seconds(duration)


def _mode(value: Value) -> Amount:
    return (float(nav_state(value)),)


SOURCES = ("camera", "tracker")
"""Whose drivers can fail."""


def _source(value: Value) -> Amount:
    if value not in SOURCES:
        raise ValueError(f"'{value}' is none of {', '.join(SOURCES)}")
    return (float(SOURCES.index(str(value))),)


KINDS: Mapping[str, Callable[[Value], Amount]] = MappingProxyType(
    {
        "pose_silent": _duration,
        "pose_jump": _one,
        "pose_relocalised": _move_and_turn,
        "pose_frozen": _duration,
        "pose_slipping": _one,
        "camera_silent": _duration,
        "camera_frozen": _duration,
        "camera_black": _duration,
        "camera_slow": _rate,
        "camera_late": _lateness,
        "sightings_wrong": _share,
        "calibration_wrong": _relative,
        "gate_missing": _one,
        "gate_moved": pair,
        "gates_swapped": pair,
        "gust": _gust,
        "tipped": _one,
        "battery": _share,
        "pilot": _mode,
        "pilot_lands": _duration,
        "link_silent": _duration,
        "loop_stall": _duration,
        "loop_busy": _duration,
        "compute_slow": _rate,
        "planner_failing": _duration,
        "task_failing": _source,
        "disk_full": _duration,
        "log_failing": _duration,
        "clock_jump": _one,
    }
)
"""All faults that there are, by name, with what reads their values."""
LASTING = {
    "pose_silent",
    "pose_frozen",
    "camera_silent",
    "camera_frozen",
    "camera_black",
    "link_silent",
    "loop_busy",
} | {
    "planner_failing",
    "log_failing",
}
"""Faults whose value is their duration."""
FROM_START = {"calibration_wrong", "gate_missing"}
"""Faults that are there from the start or not at all."""


def read_faults(entries: Sequence[tuple[float, str, float | str]]) -> tuple[Fault, ...]:
    """The faults that sim.faults tells, in the order of their times; raises `BadInputError`."""
    return tuple(sorted((_read(*entry) for entry in entries), key=lambda fault: fault.begin))


def _read(begin: float, name: str, value: float | str) -> Fault:
    if name not in KINDS:
        other = "faults of the link and of the vehicle behind it need --sim --mavlink"
        raise BadInputError(f"{unknown(name, KINDS)}; {other}")
    try:
        amount = KINDS[name](value)
    except ValueError as error:
        raise BadInputError(f"fault '{name}': {error}") from None
    if name in FROM_START and begin > 0.0:
        raise BadInputError(f"fault '{name}' is there from the start: its time must be 0, not {begin:g}")
    if name in LASTING:
        duration = amount[0]
    elif name == "gust":
        duration = amount[2]
    else:
        duration = JUMP_TIME if name == "pose_jump" else math.inf
    return Fault(begin, begin + duration, name, amount)


def named(faults: Sequence[Fault], *names: str) -> tuple[Fault, ...]:
    """Those of ``faults`` that have one of ``names``."""
    return tuple(fault for fault in faults if fault.name in names)


def acting(faults: Sequence[Fault], name: str, stamp: float) -> Fault | None:
    """The first of ``faults`` with that ``name`` that acts at ``stamp``."""
    return next((fault for fault in faults if fault.name == name and fault.acts(stamp)), None)
