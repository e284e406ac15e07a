"""PX4's commander: arming, the user's intended mode and what becomes of it.

After src/modules/commander of PX4 v1.16 (Commander.cpp, UserModeIntention.cpp, HealthAndArmingChecks). Disarmed, any
mode may be intended; armed, only one that can run. Arming asks whether the intended mode can be armed in, and even a
forced arming by a command from outside runs these checks; a forced disarming doesn't ask anything.
"""

from collections import deque
from typing import NamedTuple

from sim.px4.failsafe import Action, Battery, Failsafe, Situation
from sim.px4.modes import NavState, Need, Reply, Result
from sim.px4.parameters import Parameters

CRITICAL, INFO = 2, 6
"""MAV_SEVERITY."""
TEXTS = 64
"""Texts that are kept for whoever reads them."""
PROBATION = 1.0
"""s that a position must be there before it counts (checkPosVelValidity in estimatorCheck.cpp)."""
ACCEPTED = Reply(Result.ACCEPTED)

_REASONS = {
    Need.LOCAL_ALTITUDE: "Navigation error: No valid altitude estimate",
    Need.LOCAL_POSITION: "Navigation error: No valid local position estimate",
    Need.LOCAL_POSITION_RELAXED: "Navigation error: No valid local position estimate",
    Need.GLOBAL_POSITION: "Navigation error: No valid global position estimate",
    Need.HOME_POSITION: "Home position not set",
    Need.MISSION: "No valid mission available",
    Need.OFFBOARD_SIGNAL: "No offboard signal",
    Need.MANUAL_CONTROL: "No manual control input",
    Need.NO_ARMING: "Mode not suitable for arming",
}
_BATTERY_TEXT = {
    Battery.LOW: "Low battery",
    Battery.CRITICAL: "Critical battery",
    Battery.EMERGENCY: "Emergency battery level",
}


class Text(NamedTuple):
    """A status text."""

    severity: int
    """MAV_SEVERITY."""
    text: str


def refused(text: str, result: Result = Result.TEMPORARILY_REJECTED) -> Reply:
    """A reply that says no."""
    return Reply(result, text)


class Commander:
    """Keeps the vehicle's state; what it has and where it is, it is told by `check`."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.texts: deque[Text] = deque(maxlen=TEXTS)
        """What PX4 sends as STATUSTEXT, oldest first; whoever reads takes them out."""
        self.broken = ""
        """Why arming is refused for good; empty when it isn't."""
        self.boot(0.0)

    def boot(self, now: float) -> None:
        """Begin anew: disarmed, meaning to hold."""
        self.armed = False
        self.armed_at = -1.0
        self.intention = self._after_disarm = NavState.AUTO_LOITER
        self.have = Need(0)
        self.battery = Battery.NONE
        self.origin = False
        """Whether the local frame's place on earth was told."""
        self.failsafe = Failsafe(self._parameters, self.tell)
        self.nav_state = self.intention
        self._requested = False
        self._position_failed = now

    def tell(self, severity: int, text: str) -> None:
        """Send a status text."""
        self.texts.append(Text(severity, text))

    def check(self, now: float, position: bool, altitude: bool, offboard: bool, manual: bool, battery: Battery) -> None:
        """Take in what the vehicle has at ``now``, then decide what is flown (`update`)."""
        if not position:
            self._position_failed = now
        valid = position and (Need.LOCAL_POSITION in self.have or now > self._position_failed + PROBATION)
        have = Need(0)
        if valid:
            have |= Need.LOCAL_POSITION | Need.LOCAL_POSITION_RELAXED
        if altitude:
            have |= Need.LOCAL_ALTITUDE
        if valid and altitude and self.origin:
            have |= Need.GLOBAL_POSITION
        if offboard:
            have |= Need.OFFBOARD_SIGNAL
        if manual:
            have |= Need.MANUAL_CONTROL
        self.have = have
        if battery > self.battery:
            self.tell(CRITICAL, _BATTERY_TEXT[battery])
        # In flight a warning never becomes less (batteryCheck.cpp).
        self.battery = max(battery, self.battery) if self.armed else battery
        self.update(now)

    def hear_offboard(self, now: float) -> None:
        """A setpoint came; where there was none, it counts at once (offboardControlCheck in Commander.cpp)."""
        if Need.OFFBOARD_SIGNAL not in self.have:
            self.have |= Need.OFFBOARD_SIGNAL
            self.update(now)

    def update(self, now: float) -> None:
        """Decide on the mode that is flown."""
        situation = Situation(self.armed, self.intention, self.have, self.battery)
        action = self.failsafe.update(now, situation, self._requested)
        self._requested = False
        if action in (Action.DISARM, Action.TERMINATE) and self.armed:
            self._disarm("failsafe")
        self.nav_state = self.failsafe.mode(self.intention)

    def can_run(self, mode: NavState) -> bool:
        """Whether the user may have ``mode`` in flight."""
        return not mode.needs & ~(self.have | Need.NO_ARMING)

    def request(self, mode: NavState, now: float) -> Reply:
        """The user's wish for ``mode``."""
        if self.failsafe.action is Action.TERMINATE or (self.armed and not self.can_run(mode)):
            missing = "; ".join(self._missing(mode))
            return refused(f"Switching to {mode.label} is currently not available: {missing}")
        self.intention = mode
        self._requested = True
        if Need.NO_ARMING not in mode.needs:
            self._after_disarm = mode
        self.update(now)
        return ACCEPTED

    def _missing(self, mode: NavState) -> list[str]:
        lacking = mode.needs & ~(self.have | Need.NO_ARMING)
        return list(dict.fromkeys(_REASONS[need] for need in lacking))

    def arming_failures(self) -> list[str]:
        """Why it can't be armed in the intended mode; nothing when it can."""
        failures = self._health_failures()
        needs = self.nav_state.needs
        if Need.NO_ARMING in needs:
            failures.append(_REASONS[Need.NO_ARMING])
        failures += self._missing(self.nav_state)
        positioned = needs & (Need.LOCAL_POSITION | Need.GLOBAL_POSITION)
        if positioned and self._parameters["EKF2_GPS_CTRL"] and not self._parameters["COM_ARM_WO_GPS"]:
            failures.append("GPS fix too low")
        return failures

    def _health_failures(self) -> list[str]:
        failures = [self.broken] if self.broken else []
        if self.battery >= Battery.CRITICAL:
            failures.append(_BATTERY_TEXT[self.battery])
        return failures

    def arm(self, now: float) -> Reply:
        """Arm in the intended mode."""
        if self.armed:
            return ACCEPTED
        failures = self.arming_failures()
        if failures:
            for failure in self._health_failures():
                self.tell(CRITICAL, f"Preflight Fail: {failure}")
            text = "Arming denied: Resolve system health failures first"
            self.tell(CRITICAL, text)
            return refused(f"{text} ({'; '.join(failures)})")
        self.armed, self.armed_at = True, now
        self.tell(INFO, "Armed by external command")
        self.update(now)
        return ACCEPTED

    def disarm(self, now: float, reason: str, landed: bool, force: bool) -> Reply:
        """Disarm, if ``landed`` or forced."""
        if not self.armed:
            return ACCEPTED
        if not landed and not force:
            self.tell(CRITICAL, "Disarming denied: not landed")
            return refused("Disarming denied: not landed")
        self._disarm(reason)
        self.update(now)
        return ACCEPTED

    def _disarm(self, reason: str) -> None:
        self.armed = False
        self.intention = self._after_disarm
        self.tell(INFO, f"Disarmed by {reason}")
