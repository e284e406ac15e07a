"""PX4's flight modes: their numbers, their codes on the link and what each needs of the vehicle.

Sources in PX4 v1.16: msg/versioned/VehicleStatus.msg (numbers), src/modules/commander/px4_custom_mode.h (codes) and
src/modules/commander/ModeUtil/mode_requirements.cpp (needs, for a multicopter).
"""

from dataclasses import dataclass
from enum import Flag, IntEnum, auto

_AUTO = 4
"""PX4_CUSTOM_MAIN_MODE_AUTO."""


class NavState(IntEnum):
    """Flight modes with the numbers of vehicle_status.nav_state."""

    MANUAL = 0
    ALTCTL = 1
    POSCTL = 2
    AUTO_MISSION = 3
    AUTO_LOITER = 4
    AUTO_RTL = 5
    ACRO = 10
    DESCEND = 12
    TERMINATION = 13
    OFFBOARD = 14
    STAB = 15
    AUTO_TAKEOFF = 17
    AUTO_LAND = 18

    @property
    def custom_mode(self) -> tuple[int, int]:
        """Main and sub mode, as in DO_SET_MODE and in the upper half of HEARTBEAT.custom_mode."""
        return _CUSTOM[self]

    @staticmethod
    def from_custom_mode(main: int, sub: int) -> "NavState | None":
        """The mode that DO_SET_MODE asks for; None where PX4 knows none, or none that can be chosen."""
        if main == _AUTO and sub == 0:
            return NavState.AUTO_MISSION
        return _CHOSEN.get((main, sub if main == _AUTO else 0))

    @property
    def needs(self) -> "Need":
        """What the vehicle must have for this mode to run."""
        return _NEEDS[self]

    @property
    def label(self) -> str:
        """PX4's name of the mode, as in its texts."""
        return _LABELS[self]


class Need(Flag):
    """Mode requirements; angular velocity and attitude are always there."""

    LOCAL_ALTITUDE = auto()
    LOCAL_POSITION = auto()
    LOCAL_POSITION_RELAXED = auto()
    GLOBAL_POSITION = auto()
    HOME_POSITION = auto()
    MISSION = auto()
    OFFBOARD_SIGNAL = auto()
    MANUAL_CONTROL = auto()
    NO_ARMING = auto()
    """Not a need: the mode prevents arming."""


class Landed(IntEnum):
    """MAV_LANDED_STATE, as in EXTENDED_SYS_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Result(IntEnum):
    """MAV_RESULT of a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a command; ``text`` says why it was refused."""

    result: Result
    text: str = ""

    @property
    def accepted(self) -> bool:
        """Whether PX4 does it."""
        return self.result is Result.ACCEPTED


_CUSTOM = {
    NavState.MANUAL: (1, 0),
    NavState.ALTCTL: (2, 0),
    NavState.POSCTL: (3, 0),
    NavState.AUTO_TAKEOFF: (_AUTO, 2),
    NavState.AUTO_LOITER: (_AUTO, 3),
    NavState.AUTO_MISSION: (_AUTO, 4),
    NavState.AUTO_RTL: (_AUTO, 5),
    NavState.AUTO_LAND: (_AUTO, 6),
    NavState.ACRO: (5, 0),
    NavState.OFFBOARD: (6, 0),
    NavState.STAB: (7, 0),
    # On the link these two look like others.
    NavState.DESCEND: (_AUTO, 6),
    NavState.TERMINATION: (1, 0),
}
_CHOSEN = {code: mode for mode, code in _CUSTOM.items() if mode not in (NavState.DESCEND, NavState.TERMINATION)}
_LABELS = {
    NavState.MANUAL: "Manual",
    NavState.ALTCTL: "Altitude",
    NavState.POSCTL: "Position",
    NavState.AUTO_MISSION: "Mission",
    NavState.AUTO_LOITER: "Hold",
    NavState.AUTO_RTL: "Return",
    NavState.ACRO: "Acro",
    NavState.DESCEND: "Descend",
    NavState.TERMINATION: "Termination",
    NavState.OFFBOARD: "Offboard",
    NavState.STAB: "Stabilized",
    NavState.AUTO_TAKEOFF: "Takeoff",
    NavState.AUTO_LAND: "Land",
}
_GLOBAL = Need.GLOBAL_POSITION | Need.LOCAL_POSITION | Need.LOCAL_ALTITUDE
_NEEDS = {
    NavState.MANUAL: Need.MANUAL_CONTROL,
    NavState.ALTCTL: Need.LOCAL_ALTITUDE | Need.MANUAL_CONTROL,
    NavState.POSCTL: Need.LOCAL_ALTITUDE | Need.LOCAL_POSITION_RELAXED | Need.MANUAL_CONTROL,
    NavState.AUTO_MISSION: _GLOBAL | Need.MISSION,
    NavState.AUTO_LOITER: _GLOBAL,
    NavState.AUTO_RTL: _GLOBAL | Need.HOME_POSITION | Need.NO_ARMING,
    NavState.ACRO: Need.MANUAL_CONTROL,
    NavState.DESCEND: Need.NO_ARMING,
    NavState.TERMINATION: Need.NO_ARMING,
    NavState.OFFBOARD: Need.OFFBOARD_SIGNAL,
    NavState.STAB: Need.MANUAL_CONTROL,
    NavState.AUTO_TAKEOFF: Need.LOCAL_ALTITUDE | Need.LOCAL_POSITION,
    NavState.AUTO_LAND: Need.LOCAL_ALTITUDE | Need.LOCAL_POSITION_RELAXED | Need.NO_ARMING,
}
