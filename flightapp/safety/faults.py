"""The words of the fault table: faults, stages of a flight, reactions; and the message that tells of a fault."""

from dataclasses import dataclass
from enum import StrEnum

from flightapp.messages import Phase


class FaultKind(StrEnum):
    """Everything that can go wrong."""

    STATE_UNTRUSTED = "state untrusted"
    POSE_MISSING = "pose missing"
    POSE_LOST = "pose lost"
    CAMERA_LOST = "camera lost"
    GATE_NOT_FOUND = "gate not found"
    GATE_MISSED = "gate missed"
    PLANNER_FAILING = "planner failing"
    OFF_THE_LINE = "off the line"
    GEOFENCE_LEFT = "geofence left"
    OUT_OF_ENVELOPE = "out of envelope"
    TIPPED_OVER = "tipped over"
    BATTERY_LOW = "battery low"
    BATTERY_CRITICAL = "battery critical"
    LINK_LOST = "link lost"
    TAKEN_OVER = "pilot takeover"
    NO_COMMAND = "no command"
    OVERLOAD = "compute overload"
    DISK_FULL = "disk full"
    LOG_FAILING = "log failing"
    CLOCK_JUMP = "clock jump"
    TASK_FAILED = "task failed"


class Stage(StrEnum):
    """The phases of a flight that reactions differ in."""

    PREFLIGHT = "preflight"
    TAKEOFF = "takeoff"
    FLYING = "flying"
    LANDING = "landing"

    @classmethod
    def of(cls, phase: Phase) -> "Stage":
        """The stage that a ``phase`` of the mission state machine belongs to."""
        return _STAGES.get(phase, cls.PREFLIGHT)


_STAGES = {
    Phase.ARMED: Stage.TAKEOFF,
    Phase.TAKEOFF: Stage.TAKEOFF,
    Phase.FLYING: Stage.FLYING,
    Phase.LANDING: Stage.LANDING,
    Phase.ABORTED: Stage.LANDING,
    # Whatever is not as it should be matters again when another takeoff is asked for.
    Phase.LANDED: Stage.LANDING,
}


class Reaction(StrEnum):
    """What is done about a fault, the gravest last; the pilot's word is above everything."""

    CONTINUE = "continue"
    SLOW = "slow"
    HOLD = "hold"
    REFUSE = "refuse"
    LAND = "land"
    KILL = "kill"
    HAND_BACK = "hand back"

    @property
    def gravity(self) -> int:
        """Place in that order."""
        return _ORDER[self]

    @property
    def final(self) -> bool:
        """Whether it ends the mission."""
        return self.gravity >= Reaction.REFUSE.gravity


_ORDER = {reaction: place for place, reaction in enumerate(Reaction)}

MEANINGS = {
    Reaction.CONTINUE: "it is logged, and what is under way goes on",
    Reaction.SLOW: "the line is flown at the pace planning.pace_min for as long as the fault lasts",
    Reaction.HOLD: "it stops along the line, where nothing stands below, and hovers until the fault is over, or for"
    " safety.hold_time; then it lands",
    Reaction.REFUSE: "the mission ends before the vehicle is armed",
    Reaction.LAND: "the mission ends; it stops along the line, beyond what stands below, where state, line and"
    " commands are sound; then the autopilot is asked to land, again and again until it answers",
    Reaction.KILL: "the motors are stopped at once",
    Reaction.HAND_BACK: "the mission ends; nothing is sent and nothing is asked of the autopilot any more",
}
"""What each reaction is, in words."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Something has gone wrong, or is over."""

    stamp: float
    kind: FaultKind
    text: str
    """How it was noticed."""
    over: bool = False
    """Whether this says that it has passed."""

    def __str__(self) -> str:
        return f"{self.kind} is over" if self.over else f"{self.kind}: {self.text}"
