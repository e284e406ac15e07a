"""PX4's failsafe state machine: which action the active conditions call for, and when.

After src/modules/commander/failsafe (framework.cpp, failsafe.cpp) of PX4 v1.16: each failed condition has an action,
the worst one wins; where Hold can run and the pilot may take over, the vehicle holds for COM_FAIL_ACT_T first; an
action whose mode can't run falls through to the next worse one. Losing the offboard signal is a fallback of the mode:
it never waits, and ends as soon as the signal is back.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from sim.px4.modes import NavState, Need
from sim.px4.parameters import Parameters


class Action(IntEnum):
    """Reactions, the worst last."""

    NONE = 0
    WARN = 1
    POSITION = 2
    ALTITUDE = 3
    STABILIZED = 4
    HOLD = 5
    RETURN = 6
    LAND = 7
    DESCEND = 8
    DISARM = 9
    TERMINATE = 10


class Battery(IntEnum):
    """Warnings of battery_status."""

    NONE = 0
    LOW = 1
    CRITICAL = 2
    EMERGENCY = 3


class _Takeover(IntEnum):
    """When the pilot may take over by changing the mode."""

    ALWAYS = 0
    BY_MODE = 1
    NEVER = 2


MODE_OF = {
    Action.POSITION: NavState.POSCTL,
    Action.ALTITUDE: NavState.ALTCTL,
    Action.STABILIZED: NavState.STAB,
    Action.HOLD: NavState.AUTO_LOITER,
    Action.RETURN: NavState.AUTO_RTL,
    Action.LAND: NavState.AUTO_LAND,
    Action.DESCEND: NavState.DESCEND,
    Action.TERMINATE: NavState.TERMINATION,
}
_BY_STICKS = (Action.POSITION, Action.ALTITUDE, Action.STABILIZED)
_CHAIN = (*_BY_STICKS, Action.HOLD, Action.RETURN, Action.LAND, Action.DESCEND)
_YIELDS = (Action.HOLD, Action.RETURN, Action.LAND, Action.DESCEND)
_OFFBOARD_LOSS = {
    0: Action.POSITION,
    1: Action.ALTITUDE,
    2: Action.STABILIZED,
    3: Action.RETURN,
    4: Action.LAND,
    5: Action.HOLD,
    6: Action.TERMINATE,
    7: Action.DISARM,
}
"""COM_OBL_RC_ACT."""
_MANUAL_LOSS = {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
"""NAV_RCL_ACT."""
_BATTERY = {
    (1, Battery.CRITICAL): Action.RETURN,
    (1, Battery.EMERGENCY): Action.RETURN,
    (2, Battery.CRITICAL): Action.LAND,
    (2, Battery.EMERGENCY): Action.LAND,
    (3, Battery.CRITICAL): Action.RETURN,
    (3, Battery.EMERGENCY): Action.LAND,
}
"""COM_LOW_BAT_ACT and the warning; anything else only warns."""
_STICKS_OFF = 4
"""COM_RC_IN_MODE, no manual control at all."""
_EXCEPT = {
    NavState.AUTO_MISSION: 1,
    NavState.AUTO_LOITER: 2,
    NavState.AUTO_TAKEOFF: 2,
    NavState.AUTO_LAND: 2,
    NavState.AUTO_RTL: 2,
    NavState.DESCEND: 2,
    NavState.OFFBOARD: 4,
}
"""Bits of COM_RCL_EXCEPT."""


@dataclass(slots=True)
class Situation:
    """What the state machine looks at."""

    armed: bool
    intention: NavState
    have: Need
    """What the vehicle has of what modes need."""
    battery: Battery


@dataclass(slots=True)
class _Active:
    action: Action
    takeover: _Takeover
    kept: bool
    """Until the mode changes or the vehicle is disarmed, even if the condition clears."""
    failing: bool = True
    checked: bool = True


def can_run(mode: NavState, have: Need) -> bool:
    """Whether a failsafe may use ``mode``; the lack of manual control is treated apart."""
    return not mode.needs & ~(have | Need.MANUAL_CONTROL | Need.NO_ARMING)


class Failsafe:
    """The state machine; ``tell`` takes the texts (severity, text) that the pilot is told."""

    def __init__(self, parameters: Parameters, tell: Callable[[int, str], None]) -> None:
        self._parameters = parameters
        self._tell = tell
        self._active: dict[str, _Active] = {}
        self._last = -1.0
        self._was_armed = False
        self._intention: NavState | None = None
        self._delay = 0.0
        self._start_delay = self._full_delay
        self._manual_optional = True
        self._battery_at_arming = Battery.NONE
        self._taken_over = False
        self.action = Action.NONE
        """What is done now."""

    @property
    def _full_delay(self) -> float:
        return float(self._parameters["COM_FAIL_ACT_T"])

    def update(self, now: float, situation: Situation, mode_requested: bool) -> Action:
        """The action at ``now`` s; ``mode_requested`` says that a mode was chosen since the last call."""
        dt = 0.0 if self._last < 0.0 else now - self._last
        if self._was_armed != situation.armed:
            self._forget()
            self._taken_over = False
            self._battery_at_arming = situation.battery
        mode_requested |= self._intention is not situation.intention
        if mode_requested or self._taken_over:
            self._forget()
        self._delay = max(self._delay - dt, 0.0)
        self._check_all(situation)
        hold = can_run(NavState.AUTO_LOITER, situation.have)
        if self.action > Action.HOLD or not hold or self._taken_over:
            self._delay = 0.0
        action, delayed = self._select(situation, mode_requested)
        if delayed:
            self._start_delay = max(self._start_delay - dt, 0.0)
        else:
            self._start_delay = min(self._start_delay + 0.25 * dt, self._full_delay)
        if action > self.action:
            self._notify(action, delayed)
        self._last, self._was_armed, self._intention, self.action = now, situation.armed, situation.intention, action
        return action

    def mode(self, intention: NavState) -> NavState:
        """The mode that is flown where ``intention`` is wanted."""
        return MODE_OF.get(self.action, intention)

    def _forget(self) -> None:
        self._active = {name: a for name, a in self._active.items() if a.failing or not a.kept}

    def _notify(self, action: Action, delayed: bool) -> None:
        if delayed:
            self._tell(2, f"Failsafe activated, entering Hold for {self._delay:.0f} seconds")
        else:
            self._tell(2, "Failsafe activated")

    def _check_all(self, s: Situation) -> None:
        p = self._parameters
        lost = Need.MANUAL_CONTROL not in s.have
        if not lost or not s.armed:
            self._manual_optional = lost
        excepted = bool(int(p["COM_RCL_EXCEPT"]) & _EXCEPT.get(s.intention, 0))
        if p["COM_RC_IN_MODE"] != _STICKS_OFF and not excepted and not self._manual_optional:
            self._check("manual control", lost, _MANUAL_LOSS.get(int(p["NAV_RCL_ACT"]), Action.NONE), kept=True)
        if s.battery > Battery.NONE:
            worse = s.battery > self._battery_at_arming
            setting = int(p["COM_LOW_BAT_ACT"]) if worse else 0
            self._check(f"battery {s.battery.name}", True, _BATTERY.get((setting, s.battery), Action.WARN))
        fallback = self._fallback(s)
        self._check("mode", fallback is not Action.NONE, fallback, waits=False)
        # A condition that was not even looked at counts as cleared.
        for name, active in list(self._active.items()):
            if not active.checked:
                self._clear(name, active)
            active.checked = False

    def _check(self, name: str, failed: bool, action: Action, kept: bool = False, waits: bool = True) -> None:
        active = self._active.get(name)
        if not failed:
            if active is not None:
                active.checked = True
                self._clear(name, active)
        elif active is not None:
            active.failing = active.checked = True
            active.action = action
        else:
            self._active[name] = self._new(action, kept, waits)

    def _clear(self, name: str, active: _Active) -> None:
        active.failing = False
        if not active.kept:
            del self._active[name]

    def _new(self, action: Action, kept: bool, waits: bool) -> _Active:
        takeover = _Takeover.NEVER if action >= Action.DISARM else _Takeover.ALWAYS
        if waits and takeover is _Takeover.ALWAYS:
            if self._full_delay <= 0.1:
                takeover = _Takeover.BY_MODE
            elif action is not Action.WARN and self._delay == 0.0:
                self._delay = self._start_delay
        if action >= Action.HOLD:
            self._taken_over = False
        return _Active(action, takeover, kept)

    def _fallback(self, s: Situation) -> Action:
        """What the intended mode's unmet needs call for."""
        action, mode = Action.NONE, s.intention
        if Need.OFFBOARD_SIGNAL in mode.needs and Need.OFFBOARD_SIGNAL not in s.have:
            action = _OFFBOARD_LOSS.get(int(self._parameters["COM_OBL_RC_ACT"]), Action.POSITION)
            if action is Action.DISARM:
                return action
            mode = MODE_OF[action]
        if mode is NavState.POSCTL and not can_run(mode, s.have):
            action, mode = Action.ALTITUDE, NavState.ALTCTL
        if mode is NavState.ALTCTL and not can_run(mode, s.have):
            action, mode = Action.STABILIZED, NavState.STAB
        if action in _BY_STICKS and Need.MANUAL_CONTROL not in s.have:
            action = _MANUAL_LOSS.get(int(self._parameters["NAV_RCL_ACT"]), Action.RETURN)
        return action if can_run(mode, s.have) else Action.RETURN

    def _select(self, s: Situation, mode_requested: bool) -> tuple[Action, bool]:
        """The action to take, and whether it is a Hold before a worse one."""
        if self.action is Action.TERMINATE:
            return Action.TERMINATE, False
        if not s.armed:
            return Action.NONE, False
        worst = max((a.action for a in self._active.values()), default=Action.NONE)
        takeover = max((a.takeover for a in self._active.values()), default=_Takeover.ALWAYS)
        delayed = False
        if self._delay > 0.0 and not self._taken_over and takeover < _Takeover.NEVER and worst < Action.DISARM:
            worst, takeover, delayed = Action.HOLD, _Takeover.BY_MODE, worst is not Action.NONE
        wanted = self._taken_over or (mode_requested and self.action is worst)
        self._taken_over = worst in _YIELDS and takeover < _Takeover.NEVER and wanted
        if self._taken_over:
            worst, delayed = max(Action.WARN, self._fallback(s)), False
        return self._possible(worst, s.have), delayed

    @staticmethod
    def _possible(action: Action, have: Need) -> Action:
        """``action``, or the next worse one whose mode can run."""
        if action not in _CHAIN:
            return action
        for candidate in _CHAIN[_CHAIN.index(action) :]:
            sticks = candidate not in _BY_STICKS or Need.MANUAL_CONTROL in have
            if sticks and can_run(MODE_OF[candidate], have):
                return candidate
        return Action.TERMINATE
