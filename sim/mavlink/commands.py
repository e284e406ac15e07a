"""Commands as PX4 v1.16 answers them (Commander::handle_command, MavlinkReceiver::handle_message_command_both)."""

import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple

from sim.mavlink.codec import Frame, kind, named
from sim.px4.model import Px4
from sim.px4.modes import NavState, Reply, Result

CUSTOM_MODE = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
FORCE = 21196
"""Magic number for arming and disarming that ask no questions."""
AUTO = 4
"""PX4_CUSTOM_MAIN_MODE_AUTO."""
CRITICAL = 2
"""MAV_SEVERITY."""
ACCEPTED, UNSUPPORTED = Reply(Result.ACCEPTED), Reply(Result.UNSUPPORTED)


class Code(IntEnum):
    """MAV_CMD."""

    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    DO_SET_MODE = 176
    DO_FLIGHTTERMINATION = 185
    DO_REPOSITION = 192
    PREFLIGHT_STORAGE = 245
    PREFLIGHT_REBOOT_SHUTDOWN = 246
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_PROTOCOL_VERSION = 519
    REQUEST_AUTOPILOT_CAPABILITIES = 520


_LEGACY: dict[int, str] = {
    Code.REQUEST_AUTOPILOT_CAPABILITIES: "AUTOPILOT_VERSION",
    Code.REQUEST_PROTOCOL_VERSION: "PROTOCOL_VERSION",
    Code.GET_HOME_POSITION: "HOME_POSITION",
}
"""Commands that are REQUEST_MESSAGE today."""


class Order(NamedTuple):
    """COMMAND_LONG or COMMAND_INT."""

    code: int
    parameters: tuple[float, ...]
    """Seven; 5 and 6 of a COMMAND_INT in its own units."""
    system: int
    component: int
    """Whom it is for."""


def order(frame: Frame) -> Order:
    """What a COMMAND_LONG or COMMAND_INT asks for."""
    values = frame.values()
    return Order(values[7], tuple(map(float, values[:7])), values[8], values[9])


class StreamControl(NamedTuple):
    """What commands can do to the link that they came by; each returns whether it could."""

    set_rate: Callable[[int, float | None], bool]
    """Of a message by its id, Hz; None is the default."""
    tell_interval: Callable[[int], bool]
    send_once: Callable[[int], bool]


class Commands:
    """Carries out commands; what the vehicle has to say to them goes to ``tell`` (severity, text)."""

    def __init__(self, px4: Px4, tell: Callable[[int, str], None]) -> None:
        self._px4 = px4
        self._tell = tell
        self._known: dict[int, Callable[[Sequence[float]], Reply]] = {
            Code.COMPONENT_ARM_DISARM: self._arm,
            Code.DO_SET_MODE: lambda p: self.set_mode(*p[:3]),
            Code.NAV_TAKEOFF: lambda _: px4.takeoff(),
            Code.NAV_LAND: lambda _: px4.land(),
            Code.NAV_RETURN_TO_LAUNCH: lambda _: self._switch(NavState.AUTO_RTL),
            Code.MISSION_START: lambda _: self._switch(NavState.AUTO_MISSION),
            Code.DO_REPOSITION: lambda _: self._switch(NavState.AUTO_LOITER),
            Code.DO_FLIGHTTERMINATION: lambda p: px4.kill() if p[0] > 1.5 else ACCEPTED,
            Code.PREFLIGHT_STORAGE: lambda _: ACCEPTED,
            Code.PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
        }

    def obey(self, given: Order, streams: StreamControl) -> Reply:
        """The vehicle's answer to a command that is meant for it."""
        parameters = given.parameters
        if given.code == Code.SET_MESSAGE_INTERVAL:
            return _done(self._set_interval(parameters, streams), Result.FAILED)
        if given.code == Code.GET_MESSAGE_INTERVAL:
            streams.tell_interval(_number(parameters[0]))
            return ACCEPTED
        message = _requested(given)
        if message is not None:
            return _done(streams.send_once(message), Result.DENIED)
        known = self._known.get(given.code)
        return UNSUPPORTED if known is None else known(parameters)

    def _set_interval(self, parameters: Sequence[float], streams: StreamControl) -> bool:
        message, interval = _number(parameters[0]), parameters[1]
        # Neither instances nor other addressees of a stream are known to PX4; the heartbeat's rate is fixed.
        if any(math.isfinite(p) and int(p + 0.5) for p in (parameters[2], parameters[3], parameters[6])):
            return False
        if message == named("HEARTBEAT").id or kind(message) is None or math.isnan(interval):
            return False
        rate = None if interval == 0.0 else 0.0 if interval < 0.0 else 1e6 / interval
        return streams.set_rate(message, rate)

    def _arm(self, p: Sequence[float]) -> Reply:
        forced = round(p[1]) == FORCE if math.isfinite(p[1]) else False
        if p[0] == 1.0:
            return self._px4.arm()
        if p[0] == 0.0:
            return self._px4.kill() if forced else self._px4.disarm()
        self._tell(CRITICAL, f"Unsupported ARM_DISARM param: {p[0]:.3f}")
        return UNSUPPORTED

    def set_mode(self, base: float, main: float, sub: float) -> Reply:
        """DO_SET_MODE, or a SET_MODE message."""
        if not _number(base) & CUSTOM_MODE:
            return self._rejected("Unsupported base mode")
        state = NavState.from_custom_mode(_number(main), _number(sub))
        if state is None:
            return self._rejected("Unsupported auto mode" if _number(main) == AUTO else "Unsupported main mode")
        return self._switch(state)

    def _switch(self, state: NavState) -> Reply:
        reply = self._px4.set_mode(state)
        if not reply.accepted:
            self._tell(CRITICAL, f"Switching to {state.label} is currently not available")
        return reply

    def _rejected(self, text: str) -> Reply:
        self._tell(CRITICAL, text)
        return Reply(Result.TEMPORARILY_REJECTED, text)

    def _reboot(self, p: Sequence[float]) -> Reply:
        if self._px4.armed:
            return self._rejected("Reboot denied: armed")
        if _number(p[0]) != 1:
            return Reply(Result.DENIED)
        self._px4.reboot()
        return ACCEPTED


def _requested(given: Order) -> int | None:
    """The id of the one message that is asked for."""
    if given.code == Code.REQUEST_MESSAGE:
        return _number(given.parameters[0])
    name = _LEGACY.get(given.code)
    return None if name is None else named(name).id


def _done(succeeded: bool, otherwise: Result) -> Reply:
    return ACCEPTED if succeeded else Reply(otherwise)


def _number(value: float) -> int:
    """A whole number that travelled as a float; -1 where it is none."""
    return round(value) if math.isfinite(value) else -1
