"""The last look at every command before the autopilot gets it.

Whatever a controller asks for, what leaves here is finite, fresh and within bounds, or nothing leaves. And
nothing leaves once somebody else has taken the vehicle over: the order of trust is safety pilot, autopilot,
guard, application.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flightapp.config import Config
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand

_OFFBOARD = FlightMode.OFFBOARD
"""Looking a member up in its enumeration takes longer than all else that is asked of the mode."""


class Refusal(StrEnum):
    """Why a command was not passed on."""

    MALFORMED = "not three body rates and a thrust"
    NOT_FINITE = "not finite"
    STALE = "stale"
    NO_STATUS = "the autopilot's mode is not known"
    TAKEN_OVER = "the vehicle was taken over"


class GuardTrippedError(Exception):
    """A command cannot be made safe; `refusal` says why, the text in more detail."""

    def __init__(self, refusal: Refusal, detail: str) -> None:
        super().__init__(f"{refusal}: {detail}")
        self.refusal = refusal


@dataclass(frozen=True, slots=True)
class GuardCounts:
    """What the guard has done since it was made."""

    passed: int
    """Commands passed on, clipped ones included."""
    clipped: int
    refused: int


class CommandGuard:
    """Checks commands between controller and autopilot; see `check`."""

    def __init__(self, config: Config) -> None:
        vehicle = config.vehicle
        self._rate_max, self._yaw_rate_max = vehicle.rate_max, vehicle.yaw_rate_max
        self._thrust_max = vehicle.thrust_max
        self._late, self._thrust_min = config.guard.late, config.guard.thrust_min
        self._rate_slew, self._thrust_slew = config.guard.rate_slew, config.guard.thrust_slew
        self._last: tuple[float, tuple[float, float, float, float]] | None = None
        self._engaged = False
        self._was_armed = False
        self._taken_over = ""
        self._passed = self._clipped = self._refused = 0

    @property
    def counts(self) -> GuardCounts:
        """How many commands were passed, clipped and refused."""
        return GuardCounts(self._passed, self._clipped, self._refused)

    @property
    def taken_over(self) -> bool:
        """Whether another hand holds the vehicle; nothing is passed until `release`."""
        return bool(self._taken_over)

    def release(self) -> None:
        """A new mission begins: forget that the vehicle was taken over, and wait for OFFBOARD anew."""
        self._engaged = self._was_armed = False
        self._taken_over = ""
        self._last = None

    def check(self, command: RateCommand, now: float, status: AutopilotStatus | None) -> RateCommand:
        """``command`` as it may be sent at ``now`` (s): the same one, or one within bounds.

        Rates are bounded by the vehicle's, thrust by `guard.thrust_min` (in flight) and the vehicle's
        full thrust, both in value and in how fast they change from one command to the next. Before the
        autopilot is in OFFBOARD commands pass, since it wants a stream of them to enter that mode; once it
        was, leaving the mode or disarming is taken as another hand's doing.

        Raises `GuardTrippedError` for a command that is not finite, malformed, or older than `guard.late`,
        when the mode is not known, and for every command after a takeover.
        """
        try:
            self._follow(status)
            wanted = _numbers(command)
            age = now - command.stamp
            if not abs(age) <= self._late:
                raise GuardTrippedError(Refusal.STALE, f"{age:.3f} s old, at most {self._late:g} s")
        except GuardTrippedError:
            self._refused += 1
            raise
        flying = status is not None and status.armed and not status.landed
        safe = self._bounded(wanted, now, self._thrust_min if flying else 0.0)
        self._last = (now, safe)
        self._passed += 1
        if safe == wanted:
            return command
        self._clipped += 1
        return RateCommand(command.stamp, np.array(safe[:3]), safe[3])

    def _follow(self, status: AutopilotStatus | None) -> None:
        """Keep up with the autopilot's mode; raises once another hand is on the vehicle."""
        if self._taken_over:
            raise GuardTrippedError(Refusal.TAKEN_OVER, self._taken_over)
        if status is None:
            raise GuardTrippedError(Refusal.NO_STATUS, "no status has come yet")
        offboard = status.mode is _OFFBOARD
        if self._engaged and not offboard:
            self._taken_over = f"mode {status.mode} while commands were followed"
        elif self._engaged and self._was_armed and not status.armed:
            self._taken_over = "disarmed while commands were followed"
        if self._taken_over:
            raise GuardTrippedError(Refusal.TAKEN_OVER, self._taken_over)
        self._engaged = offboard
        self._was_armed = offboard and status.armed

    def _bounded(
        self, wanted: tuple[float, float, float, float], now: float, thrust_min: float
    ) -> tuple[float, float, float, float]:
        """``wanted`` within the slew limits since the last command, then within the bounds."""
        x, y, z, thrust = wanted
        if self._last is not None:
            sent, (x0, y0, z0, thrust0) = self._last
            elapsed = max(now - sent, 0.0)
            turn, lift = elapsed * self._rate_slew, elapsed * self._thrust_slew
            if abs(x - x0) > turn or abs(y - y0) > turn or abs(z - z0) > turn:
                x, y, z = (_clamp(v, v0 - turn, v0 + turn) for v, v0 in ((x, x0), (y, y0), (z, z0)))
            if abs(thrust - thrust0) > lift:
                thrust = _clamp(thrust, thrust0 - lift, thrust0 + lift)
        most, yaw_most = self._rate_max, self._yaw_rate_max
        if abs(x) > most or abs(y) > most or abs(z) > yaw_most:
            x, y, z = _clamp(x, -most, most), _clamp(y, -most, most), _clamp(z, -yaw_most, yaw_most)
        return x, y, z, _clamp(thrust, thrust_min, self._thrust_max)


def _clamp(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _numbers(command: RateCommand) -> tuple[float, float, float, float]:
    """Rates and thrust of ``command`` as floats; raises `GuardTrippedError` where they are none."""
    try:
        x, y, z = map(float, command.rates.tolist())
        thrust = float(command.thrust)
        late = float(command.stamp)
    except (AttributeError, TypeError, ValueError):
        raise GuardTrippedError(Refusal.MALFORMED, repr(command)) from None
    if not math.isfinite(x + y + z + thrust + late):
        raise GuardTrippedError(Refusal.NOT_FINITE, f"rates {x}, {y}, {z} rad/s, thrust {thrust} m/s²")
    return x, y, z, thrust
