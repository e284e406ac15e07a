"""Which faults there are, from plain readings: each condition must hold for a while, and be gone for a while."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import FlightMode
from flightapp.planning.geofence import Geofence
from flightapp.safety.faults import Fault, FaultKind, Stage

OURS = frozenset({FlightMode.LAND, FlightMode.DESCEND, FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD})
"""Modes that the application asks for, or that PX4 falls back to after that."""
LYING = 0.3
"""m/s, slower than this the vehicle does not move."""
OVERLOADED, OVERLOADED_BEFORE = 1.1, 2.1
"""s of overload: ticks are counted by the second, and one bad second (finding the link, say) is none; before the
vehicle is armed two are none, as there everything else begins too."""
STARTUP = 5.0
"""s that the first image may take."""


@dataclass(frozen=True, slots=True)
class Readings:
    """What is known of the application and the vehicle at one moment; NaN, or infinite, where nothing is."""

    stamp: float
    stage: Stage
    commanded: bool = False
    """Whether there is a line to follow, so that the guard sees to commands and states."""
    state_age: float = math.nan
    """s; NaN before the first state."""
    doubt: str = ""
    pose_age: float = math.nan
    """s since the last pose of the tracker; NaN before the first."""
    position: Vector | None = None
    """(3,) m, world."""
    speed: float = 0.0
    """m/s."""
    tilt: float = 0.0
    """rad between body z and up."""
    line_error: float = 0.0
    """m off the reference on the worst axis."""
    image_age: float = 0.0
    """s since the last new image, or since the beginning."""
    images: int = 1
    """Images so far."""
    detection_lag: float = 0.0
    """s by which sightings are behind the images."""
    ticks_missed: float = 0.0
    """Share of the last second's control ticks."""
    plans_refused: int = 0
    """In a row."""
    at_rest: bool = False
    """Whether the line that is flown is over."""
    armed: bool = False
    mode: FlightMode | None = None
    status_age: float = math.nan
    """s since anything was heard of the autopilot; NaN before the first."""
    charge: float = math.nan
    """0..1 of the battery."""
    disk_free: float = math.inf
    """MB."""
    clock_moved: float = 0.0
    """s by which the wall clock has moved against the monotonic one since the last readings."""
    log_error: str = ""


Look = Callable[[Readings], str]
"""What is wrong, in words; empty where nothing is."""


@dataclass(frozen=True, slots=True)
class Condition:
    """One thing to look at."""

    kind: FaultKind
    look: Look
    after: float = 0.0
    """s for which it must be wrong."""
    clear: float = 0.5
    """s for which it must be right to be over; infinite where it never is."""
    before: float | None = None
    """s for which it must be wrong before the vehicle is armed; None: as after that."""

    def patience(self, stage: Stage) -> float:
        """s for which it must be wrong in ``stage``."""
        return self.before if self.before is not None and stage is Stage.PREFLIGHT else self.after


class _Watched:
    """One condition over time."""

    def __init__(self, condition: Condition) -> None:
        self._condition = condition
        self._wrong_since = self._right_since = math.nan
        self._present = False

    def look(self, readings: Readings) -> Fault | None:
        condition, now = self._condition, readings.stamp
        text = condition.look(readings)
        if text:
            self._right_since = math.nan
            self._wrong_since = now if math.isnan(self._wrong_since) else self._wrong_since
            if self._present or now - self._wrong_since < condition.patience(readings.stage):
                return None
            self._present = True
            return Fault(now, condition.kind, text)
        self._wrong_since = math.nan
        self._right_since = now if math.isnan(self._right_since) else self._right_since
        if not self._present or now - self._right_since < condition.clear:
            return None
        self._present = False
        return Fault(now, condition.kind, "", over=True)


class Monitor:
    """Tells of each fault once when it begins, and once when it is over. Stamps ascend."""

    def __init__(self, config: Config, gates: bool) -> None:
        self._watched = [_Watched(condition) for condition in conditions(config, gates)]

    def look(self, readings: Readings) -> list[Fault]:
        """What has begun or is over."""
        return [fault for watched in self._watched if (fault := watched.look(readings)) is not None]


def conditions(config: Config, gates: bool) -> tuple[Condition, ...]:
    """Everything that is looked at; ``gates`` says whether there are any, so that a camera is needed."""
    own = Conditions(config)
    kinds = (
        Condition(FaultKind.STATE_UNTRUSTED, own.doubt, config.safety.doubt_time),
        Condition(FaultKind.POSE_MISSING, own.gap, clear=1.0),
        Condition(FaultKind.POSE_LOST, own.pose),
        Condition(FaultKind.PLANNER_FAILING, own.planner),
        Condition(FaultKind.OFF_THE_LINE, own.line),
        Condition(FaultKind.GEOFENCE_LEFT, own.fence, 0.1),
        Condition(FaultKind.OUT_OF_ENVELOPE, own.envelope, 0.25),
        Condition(FaultKind.TIPPED_OVER, own.tipped, 0.5),
        Condition(FaultKind.BATTERY_LOW, own.battery_low, 1.0, math.inf),
        Condition(FaultKind.BATTERY_CRITICAL, own.battery_critical, 1.0, math.inf),
        Condition(FaultKind.LINK_LOST, own.link, clear=0.0),
        Condition(FaultKind.TAKEN_OVER, own.pilot, 0.1, math.inf),
        Condition(FaultKind.OVERLOAD, own.overload, OVERLOADED, 1.0, OVERLOADED_BEFORE),
        Condition(FaultKind.DISK_FULL, own.disk),
        Condition(FaultKind.LOG_FAILING, own.log, 0.0, math.inf),
        Condition(FaultKind.CLOCK_JUMP, own.clock, 0.0, 1.0),
    )
    return (*kinds, Condition(FaultKind.CAMERA_LOST, own.camera)) if gates else kinds


class Conditions:
    """The conditions' thresholds, and each condition as a `Look`."""

    def __init__(self, config: Config) -> None:
        self._safety, self._link_timeout = config.safety, config.link.lost_after
        self._fence, self._margin = Geofence.of(config.geofence), config.geofence.margin
        self._fastest = config.race.v_max + config.safety.speed_margin
        self._tilt = math.radians(config.control.tilt_max_deg + config.safety.tilt_margin_deg)

    def doubt(self, r: Readings) -> str:
        """See `FaultKind.STATE_UNTRUSTED`, and so on."""
        return r.doubt

    def gap(self, r: Readings) -> str:
        """Whatever bridges it."""
        missing = r.pose_age > self._safety.pose_timeout
        return f"no pose for {r.pose_age:.2f} s" if missing else ""

    def pose(self, r: Readings) -> str:
        """Where commands are wanted the guard looks at the state's age."""
        late = not r.commanded and r.state_age > self._safety.state_timeout
        return f"the state is {r.state_age:.2f} s old" if late else ""

    def camera(self, r: Readings) -> str:
        """The first image may take longer than the next."""
        late = r.image_age > (self._safety.camera_timeout if r.images else STARTUP)
        return f"no new image for {r.image_age:.1f} s" if late else ""

    def planner(self, r: Readings) -> str:
        """Refusals don't matter while there is a line to fly on."""
        failing = r.commanded and r.at_rest and r.plans_refused >= self._safety.plan_failures
        return f"{r.plans_refused} plans in a row were refused" if failing else ""

    def line(self, r: Readings) -> str:
        """A NaN of the state is the guard's."""
        return f"off the line by {r.line_error:.2f} m" if r.line_error > self._safety.tracking_error else ""

    def fence(self, r: Readings) -> str:
        """By the estimated position."""
        outside = -math.inf if r.position is None else self._fence.outside(r.position)
        return f"{outside:.2f} m outside the geofence" if outside > self._margin else ""

    def envelope(self, r: Readings) -> str:
        """How fast the autopilot flies by itself is its own affair."""
        if r.stage is Stage.PREFLIGHT:
            return ""
        if r.tilt > self._tilt:
            return f"tilted by {math.degrees(r.tilt):.0f}°, at most {math.degrees(self._tilt):.0f}° are expected"
        fast = r.stage is Stage.FLYING and r.speed > self._fastest
        return f"{r.speed:.1f} m/s, at most {self._fastest:.1f} m/s are expected" if fast else ""

    def tipped(self, r: Readings) -> str:
        """In the air nothing stays where it is so tilted; with the motors off it is not in the air."""
        lying = math.degrees(r.tilt) > self._safety.tipped_deg and (r.speed < LYING or not r.armed)
        return f"it lies there, tilted by {math.degrees(r.tilt):.0f}°" if lying else ""

    def battery_low(self, r: Readings) -> str:
        """Unknown is not low."""
        return self._charge(r, self._safety.battery_low)

    def battery_critical(self, r: Readings) -> str:
        """Unknown is not critical."""
        return self._charge(r, self._safety.battery_critical)

    def _charge(self, r: Readings, least: float) -> str:
        return f"{100.0 * r.charge:.0f} % is left" if r.charge < least else ""

    def link(self, r: Readings) -> str:
        """Anything that is heard counts."""
        return f"nothing heard of the autopilot for {r.status_age:.2f} s" if r.status_age > self._link_timeout else ""

    def pilot(self, r: Readings) -> str:
        """While commands are followed the guard notices every other mode at once."""
        other = r.armed and r.stage is not Stage.PREFLIGHT and r.mode is not None and r.mode not in OURS
        return f"the mode is {r.mode}" if other else ""

    def overload(self, r: Readings) -> str:
        """The sender and the detection."""
        if r.ticks_missed > self._safety.overload_share:
            return f"{100.0 * r.ticks_missed:.0f} % of the control ticks were missed"
        behind = r.detection_lag > self._safety.overload_lag
        return f"detection is {r.detection_lag:.2f} s behind the camera" if behind else ""

    def disk(self, r: Readings) -> str:
        """Where the log is written."""
        return f"{r.disk_free:.0f} MB are free" if r.disk_free < self._safety.disk_free else ""

    def log(self, r: Readings) -> str:
        """What could not be written is lost."""
        return r.log_error

    def clock(self, r: Readings) -> str:
        """Either way."""
        jumped = abs(r.clock_moved) > self._safety.clock_jump
        return f"the wall clock has moved by {r.clock_moved:+.2f} s" if jumped else ""
