"""The fault table: what is done about each fault in each stage of a flight, and why. docs/faults.md is made of it."""

from collections.abc import Mapping
from dataclasses import dataclass

from flightapp.safety.faults import FaultKind, Reaction, Stage

CONTINUE, SLOW, HOLD = Reaction.CONTINUE, Reaction.SLOW, Reaction.HOLD
REFUSE, LAND, KILL, HAND_BACK = Reaction.REFUSE, Reaction.LAND, Reaction.KILL, Reaction.HAND_BACK


@dataclass(frozen=True, slots=True)
class Row:
    """One fault."""

    what: str
    """When there is this fault, with the keys of the configuration that decide."""
    reactions: Mapping[Stage, Reaction]
    why: str
    """Why these reactions."""
    cannot: str = ""
    """Why it can't occur in the stages that are not named."""
    stands: bool = False
    """Whether the vehicle stands already, so that to hold what is under way may go on trying."""
    by_race: bool = False
    """Whether the race itself sees to it, whose result the mission may judge, and the supervisor only logs it."""
    adrift: bool = False
    """Whether state, line or commands are lost with it, so that a landing begins right where the vehicle is."""


def _row(
    what: str,
    why: str,
    preflight: Reaction | None = None,
    takeoff: Reaction | None = None,
    flying: Reaction | None = None,
    landing: Reaction | None = None,
    cannot: str = "",
    stands: bool = False,
    by_race: bool = False,
    adrift: bool = False,
) -> Row:
    named = zip(Stage, (preflight, takeoff, flying, landing), strict=True)
    return Row(
        what,
        {stage: reaction for stage, reaction in named if reaction is not None},
        why,
        cannot,
        stands,
        by_race,
        adrift,
    )


TABLE: Mapping[FaultKind, Row] = {
    FaultKind.STATE_UNTRUSTED: _row(
        "The estimator has doubted its own state for safety.doubt_time: what the tracker says contradicts it, or it is"
        " known worse than estimation.trusted_sigma or estimation.trusted_speed.",
        "Feedback from a wrong state flies into walls. The autopilot's own estimate is what is left; a takeoff and a"
        " landing are its own already. Poses that are doubted are kept from it.",
        REFUSE, LAND, LAND, CONTINUE, adrift=True,
    ),
    FaultKind.POSE_MISSING: _row(
        "No pose for safety.pose_timeout; the inertial sensors stand in for estimation.coast. It is over when poses"
        " have come for a second.",
        "Where none come back there is no state, soon, and the autopilot lands by what it has: the slower, the less"
        " room it takes. A takeoff and a landing are its own.",
        CONTINUE, CONTINUE, HOLD, CONTINUE,
    ),
    FaultKind.POSE_LOST: _row(
        "There is no state newer than safety.state_timeout; poses that are missing are bridged for estimation.coast"
        " before that. In flight the guard first holds the attitude for guard.hold.",
        "Without a state there is no command. The autopilot can still sink, with whatever position it has; its"
        " barometer (EKF2_BARO_CTRL) tells it of the ground.",
        REFUSE, LAND, LAND, CONTINUE, adrift=True,
    ),
    FaultKind.CAMERA_LOST: _row(
        "No new image for safety.camera_timeout, on a track with gates; the same image again is none.",
        "Where the gates are can't be seen any more, and the tracker drifts with the way: it waits where it is. The"
        " autopilot needs no camera.",
        REFUSE, CONTINUE, HOLD, CONTINUE,
    ),
    FaultKind.GATE_NOT_FOUND: _row(
        "A gate was searched for during race.search_timeout.",
        "What can't be found can't be flown through: the race ends as WRONG_PROGRESS. A mission may catch that and do"
        " something else; one that doesn't lands.",
        flying=LAND, cannot="gates are only searched for in flight", by_race=True,
    ),
    FaultKind.GATE_MISSED: _row(
        "A gate's plane was crossed beside its opening, or no way led to it.",
        "The race flies round to the gate's front and at it again, race.attempts times in all; then it ends as"
        " WRONG_PROGRESS, as above.",
        flying=CONTINUE, cannot="gates are only flown through in flight", by_race=True,
    ),
    FaultKind.PLANNER_FAILING: _row(
        "safety.plan_failures plans in a row were refused, were late or failed, and the line flown is over.",
        "The line ends at rest, so nothing presses: a map that changes may make a way. If none comes it lands.",
        flying=HOLD, cannot="nothing is planned while the autopilot flies by itself", stands=True,
    ),
    FaultKind.OFF_THE_LINE: _row(
        "The state is further than safety.tracking_error from the reference, on one axis.",
        "Whatever holds it away, the line was checked for obstacles and the place where it is was not.",
        flying=LAND, cannot="there is no line while the autopilot flies by itself", adrift=True,
    ),
    FaultKind.GEOFENCE_LEFT: _row(
        "The position is more than geofence.margin outside the geofence; plans never lead out.",
        "Beyond it nothing is known to be free. On the way down it is as near to the fence as it can be.",
        REFUSE, LAND, LAND, CONTINUE, adrift=True,
    ),
    FaultKind.OUT_OF_ENVELOPE: _row(
        "Tilted by more than safety.tilt_margin_deg beyond control.tilt_max_deg, or, where the application flies,"
        " faster than race.v_max by more than safety.speed_margin.",
        "Neither is ever planned: something pushes, or does not answer. The autopilot levels first.",
        takeoff=LAND, flying=LAND, landing=CONTINUE, cannot="it stands on the ground: see tipped over", adrift=True,
    ),
    FaultKind.TIPPED_OVER: _row(
        "Tilted by more than safety.tipped_deg, and not moving or its motors off: it lies on the ground.",
        "Motors that run then can only do harm.",
        REFUSE, KILL, KILL, KILL, adrift=True,
    ),
    FaultKind.BATTERY_LOW: _row(
        "Less than safety.battery_low of the charge is left.",
        "Enough to finish, gently; not enough to begin.",
        REFUSE, LAND, SLOW, CONTINUE,
    ),
    FaultKind.BATTERY_CRITICAL: _row(
        "Less than safety.battery_critical of the charge is left.",
        "The motors will soon be too weak to land softly.",
        REFUSE, LAND, LAND, CONTINUE,
    ),
    FaultKind.LINK_LOST: _row(
        "Nothing was heard of the autopilot for link.lost_after.",
        "No command may be sent to a vehicle whose mode is not known. PX4 lands by itself when commands end"
        " (COM_OF_LOSS_T); it is asked to as soon as it can be heard. On the ground a takeoff waits until then: an"
        " autopilot that boots is silent for a while.",
        CONTINUE, LAND, LAND, CONTINUE, adrift=True,
    ),
    FaultKind.TAKEN_OVER: _row(
        "The autopilot has left the mode that was asked for by another hand than ours, or was disarmed.",
        "The safety pilot comes first, then PX4.",
        takeoff=HAND_BACK, flying=HAND_BACK, landing=HAND_BACK,
        cannot="on the ground, disarmed, there is nothing to take over: a mode chosen there is no fault",
        adrift=True,
    ),
    FaultKind.NO_COMMAND: _row(
        "The guard had no sound command for guard.hold: the controller failed, told nonsense, or had no turn for"
        " guard.stall.",
        "Old commands are worse than none; the autopilot flies on by itself.",
        flying=LAND, cannot="no commands are sent while the autopilot flies by itself", adrift=True,
    ),
    FaultKind.OVERLOAD: _row(
        "More than safety.overload_share of a second's control ticks were missed, or detection is"
        " safety.overload_lag behind the camera.",
        "Slower flight needs less of everything; and the autopilot needs nothing of us to take off or land.",
        REFUSE, CONTINUE, SLOW, CONTINUE,
    ),
    FaultKind.DISK_FULL: _row(
        "Less than safety.disk_free is free where the log is written.",
        "A flight without a record teaches nothing; but one that has begun does not depend on it.",
        REFUSE, CONTINUE, CONTINUE, CONTINUE,
    ),
    FaultKind.LOG_FAILING: _row(
        "The log could not be written.",
        "As for a full disk.",
        REFUSE, CONTINUE, CONTINUE, CONTINUE,
    ),
    FaultKind.CLOCK_JUMP: _row(
        "The wall clock has moved by more than safety.clock_jump against the monotonic one.",
        "All stamps are monotonic; the wall clock's time only stands in the log's header.",
        CONTINUE, CONTINUE, CONTINUE, CONTINUE,
    ),
    FaultKind.TASK_FAILED: _row(
        "An exception ended one of the application's tasks.",
        "What it did is not done any more, and nobody knows what else is wrong.",
        REFUSE, LAND, LAND, CONTINUE,
    ),
}  # fmt: skip
"""All faults."""


def reaction_to(kind: FaultKind, stage: Stage) -> Reaction:
    """What is done about a fault in ``stage``; where it can't occur, what is under way goes on."""
    return TABLE[kind].reactions.get(stage, Reaction.CONTINUE)
