"""How each fault of the table is provoked in the simulation, in each stage of a flight."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random

from flightapp.evaluation.fault_matrix import Stages
from flightapp.safety.faults import FaultKind as Kind
from flightapp.safety.faults import Stage

Entry = tuple[float, str, float | str]
"""As in sim.faults."""
LASTING = 1000.0
"""s, beyond the end of any flight."""
AFTER, BEFORE = 0.3, 1.2
"""s after and before a gate that are near one."""
DRAWS = 200
"""Moments that are drawn until one is not."""
FOLLOWED = 0.6
"""s after the climb until the autopilot follows commands, of which it wants a stream first: before, none is missing."""
SPOOLED = 1.5
"""s after arming at which the vehicle is in the air."""
BLIND = 0.9
"""s from the last pose to the autopilot's landing: estimation.coast, safety.state_timeout and guard.hold."""
DOUBTING = 0.3
"""s in which poses that contradict the state are noticed, and safety.doubt_time."""
CUT_OFF = 0.6
"""s from the last command to the autopilot's landing: COM_OF_LOSS_T and its next check."""


@dataclass(frozen=True, slots=True)
class Provocation:
    """What is done in one flight, once its moment is known."""

    entries: tuple[Entry, ...]
    lasts: float = math.inf
    """s from the moment until it is over."""
    blind: float | None = None
    """s from the moment for which nobody slows the vehicle down before the autopilot does by itself, so that it can't
    but hit what is nearer than that (`evaluation.forced`); None where the application goes on flying it."""
    held: float = 0.0
    """s from the moment for which the autopilot flies on the last command's body rates."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One fault in one stage."""

    provoke: Callable[[float, Random], Provocation]
    """From the moment (s of the flight's clock)."""
    notice: float
    """s from the moment until it can be noticed."""
    settings: tuple[str, ...] = ()
    """section.key=value, that make the fault likely: thresholds and walls that are nearer."""
    within: float = math.inf
    """s after the earliest moment of the latest one."""
    begin: float = 0.0
    """s after the stage's begin of the earliest moment."""
    before_end: float = 0.0
    """s before the stage's end of the latest moment, beyond `notice`."""
    from_end: float = math.inf
    """s before the stage's end of the earliest moment."""
    clear_of_gates: bool = False
    """Whether the moment is not near a gate, whose frame the vehicle would be blown into."""
    forced: bool = False
    """Whether the fault itself has the vehicle touch something."""
    pushed: bool = False
    """Whether the fault moves the vehicle away from where it would have landed."""
    at: float | None = None
    """The moment, where it can't be drawn: there from the start."""

    def moment(self, stage: Stage, stages: Stages, random: Random) -> float:
        """A random moment of ``stage``, early enough to be noticed in it where it is long enough."""
        if self.at is not None:
            return self.at
        begin, end = stages.window(stage)
        earliest = max(begin + self.begin, end - self.from_end)
        latest = max(min(end - self.notice - self.before_end, earliest + self.within), earliest)
        for _ in range(DRAWS):
            moment = random.uniform(earliest, latest)
            if not self.clear_of_gates or all(not -AFTER < gate - moment < BEFORE for gate in stages.passages):
                return moment
        return earliest


def _one(
    name: str, value: float | str, lasts: float = math.inf, blind: float | None = None, held: float = 0.0
) -> Callable[[float, Random], Provocation]:
    return lambda t, _: Provocation(((t, name, value),), lasts, blind, held)


def _for_a_while(name: str, seconds: float) -> Callable[[float, Random], Provocation]:
    return _one(name, seconds, seconds)


def _passing_or_not(name: str, seconds: float) -> Callable[[float, Random], Provocation]:
    """Over after ``seconds`` in half of the flights, never in the others."""

    def provoke(t: float, random: Random) -> Provocation:
        passing = random.random() < 0.5
        return Provocation(((t, name, seconds if passing else LASTING),), seconds if passing else math.inf)

    return provoke


def _gust(speed: float, seconds: float, along: bool = False) -> Callable[[float, Random], Provocation]:
    """Along the course, or from either side."""

    def provoke(t: float, random: Random) -> Provocation:
        side = speed * random.choice((-1.0, 1.0))
        return Provocation(((t, "gust", f"{speed}:0:{seconds}" if along else f"0:{side}:{seconds}"),), seconds)

    return provoke


def _battery(before: float, after: float) -> Callable[[float, Random], Provocation]:
    """Nearly empty from the start, and then a little more."""
    return lambda t, _: Provocation(((0.0, "battery", before), (t, "battery", after)))


def _pilot(t: float, _: Random) -> Provocation:
    """Takes the vehicle over, brakes, flies clear and lands."""
    return Provocation(((t, "pilot", "POSCTL"), (t, "pilot_lands", 1.5)), blind=0.0)


def _driver(t: float, random: Random) -> Provocation:
    source = random.choice(("camera", "tracker"))
    return Provocation(((t, "task_failing", source),), blind=BLIND if source == "tracker" else None)


def _each(
    provoke: Callable[[float, Random], Provocation], notice: float, settings: tuple[str, ...] = ()
) -> dict[Stage, Trial]:
    return {stage: Trial(provoke, notice, settings) for stage in Stage}


def _later(trials: dict[Stage, Trial], **others: Trial) -> dict[Stage, Trial]:
    return trials | {Stage(name): trial for name, trial in others.items()}


NARROW = ("geofence.corners=[[-5.0, -0.8], [20.0, 0.8]]", "geofence.margin=0.1")
SHORT = ("geofence.corners=[[-5.0, -5.0], [11.8, 5.0]]", "geofence.margin=0.1")
ELSEWHERE = ("geofence.corners=[[3.0, -5.0], [20.0, 5.0]]",)
NOT_LOW = ("safety.battery_low=0.1",)
PATIENT = ("safety.tracking_error=5.0", "safety.speed_margin=10.0")

TRIALS: Mapping[Kind, Mapping[Stage, Trial]] = {
    Kind.STATE_UNTRUSTED: _each(_one("pose_slipping", 3.0, blind=DOUBTING), 0.7),
    Kind.POSE_MISSING: _each(_for_a_while("pose_silent", 0.45), 0.35),
    Kind.POSE_LOST: _each(_one("pose_silent", LASTING, blind=BLIND), 1.0),
    Kind.CAMERA_LOST: _later(
        _each(_one("camera_silent", LASTING), 1.2),
        takeoff=Trial(_for_a_while("camera_silent", 1.3), 1.2, before_end=0.8),
        flying=Trial(_passing_or_not("camera_silent", 2.5), 1.2),
    ),
    Kind.GATE_NOT_FOUND: {Stage.FLYING: Trial(_one("gate_missing", 2.0), 30.0, at=0.0)},
    Kind.GATE_MISSED: {
        Stage.FLYING: Trial(_gust(45.0, 0.45), 1.0, PATIENT, begin=1.3, before_end=2.2),
    },
    Kind.PLANNER_FAILING: {
        Stage.FLYING: Trial(_passing_or_not("planner_failing", 2.5), 1.0, within=0.0),
    },
    Kind.OFF_THE_LINE: {
        Stage.FLYING: Trial(_gust(25.0, 0.6), 0.8, ("safety.tracking_error=0.4",), clear_of_gates=True)
    },
    Kind.GEOFENCE_LEFT: {
        Stage.PREFLIGHT: Trial(lambda t, _: Provocation(()), 1.0, ELSEWHERE, at=0.0),
        Stage.TAKEOFF: Trial(_gust(25.0, 1.2), 1.2, NARROW, begin=SPOOLED),
        Stage.FLYING: Trial(_gust(35.0, 0.7), 1.0, NARROW, clear_of_gates=True),
        Stage.LANDING: Trial(_gust(14.0, 0.8, along=True), 1.2, SHORT, before_end=1.5, pushed=True),
    },
    Kind.OUT_OF_ENVELOPE: {
        Stage.TAKEOFF: Trial(_one("tipped", 170.0), 0.6, begin=SPOOLED + 0.7, forced=True),
        Stage.FLYING: Trial(
            _gust(30.0, 0.6, along=True), 0.8, ("safety.speed_margin=0.3", "safety.tracking_error=5.0")
        ),
        Stage.LANDING: Trial(_one("tipped", 170.0), 0.6, within=0.2, forced=True, pushed=True),
    },
    Kind.TIPPED_OVER: {
        Stage.PREFLIGHT: Trial(_one("tipped", 180.0), 0.8, forced=True),
        Stage.TAKEOFF: Trial(_one("tipped", 180.0), 1.0, within=0.0, forced=True),
        Stage.FLYING: Trial(_one("tipped", 180.0), 2.5, ("mission.takeoff_height=0.6",), within=0.0, forced=True),
        Stage.LANDING: Trial(_one("tipped", 180.0), 1.5, from_end=1.9, forced=True),
    },
    Kind.BATTERY_LOW: _later(
        _each(_battery(0.26, 0.18), 1.2), landing=Trial(_battery(0.26, 0.18), 1.2, before_end=0.5)
    ),
    Kind.BATTERY_CRITICAL: _later(
        _each(_battery(0.17, 0.09), 1.2, NOT_LOW),
        landing=Trial(_battery(0.17, 0.09), 1.2, NOT_LOW, before_end=0.5),
    ),
    Kind.LINK_LOST: _each(_one("link_silent", 2.5, 2.5, CUT_OFF, CUT_OFF), 2.6),
    Kind.TAKEN_OVER: {
        Stage.TAKEOFF: Trial(_pilot, 0.3, begin=SPOOLED),
        Stage.FLYING: Trial(_pilot, 0.3),
        Stage.LANDING: Trial(_pilot, 0.3, before_end=1.8),
    },
    Kind.NO_COMMAND: {
        Stage.FLYING: Trial(
            _one("loop_stall", 0.2, blind=0.25, held=0.2), 0.6, ("guard.hold=0.05", "guard.stall=0.16"), begin=FOLLOWED
        )
    },
    Kind.OVERLOAD: _later(
        _each(_one("loop_busy", LASTING), 3.4),
        takeoff=Trial(_for_a_while("loop_busy", 2.4), 2.7, before_end=0.5),
        flying=Trial(_one("compute_slow", 60.0), 2.2),
    ),
    Kind.DISK_FULL: _each(_one("disk_full", 10.0), 0.6),
    Kind.LOG_FAILING: _each(_one("log_failing", LASTING), 0.8),
    Kind.CLOCK_JUMP: _each(_one("clock_jump", 5.0), 0.2),
    Kind.TASK_FAILED: _each(_driver, 0.2),
}
"""Every fault, in every stage that the table names."""
