"""The last look at every command before the autopilot gets it.

Whatever a controller asks for, what leaves here is finite, fresh and within bounds. Where there is no such command
in flight, the attitude is held for a moment; if none comes then either, nothing leaves any more and the autopilot
shall land. And nothing leaves once somebody else has taken the vehicle over: the order of trust is safety pilot,
autopilot, guard, application.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flightapp.autopilot.holding import Patience, holding_thrust
from flightapp.config import Config
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand, VehicleState

_OFFBOARD = FlightMode.OFFBOARD
"""Looking a member up in its enumeration takes longer than all else that is asked of the mode."""
SETTLE = 0.02
"""s after a stall in which what comes in of the autopilot may have been waiting since before."""


class Refusal(StrEnum):
    """Why a command was not passed on."""

    NO_COMMAND = "the controller failed"
    STATE_OLD = "the state is too old"
    MALFORMED = "not three body rates and a thrust"
    NOT_FINITE = "not finite"
    STALE = "stale"
    NO_STATUS = "the autopilot's mode is not known"
    LINK_LOST = "nothing is heard of the autopilot"
    STALLED = "the sender stalled"
    TAKEN_OVER = "the vehicle was taken over"
    HANDED_OVER = "no sound command for too long"


class GuardTrippedError(Exception):
    """A command cannot be made safe; `refusal` says why, the text in more detail.

    `cause` is what was wrong in the first place, where that was for too long.
    """

    def __init__(self, refusal: Refusal, detail: str, cause: Refusal | None = None) -> None:
        super().__init__(f"{refusal}: {detail}")
        self.refusal = refusal
        self.cause = refusal if cause is None else cause


@dataclass(frozen=True, slots=True)
class GuardCounts:
    """What the guard has done since it was made."""

    passed: int
    """Commands passed on, clipped ones included."""
    clipped: int
    refused: int
    held: int
    """Commands of the guard's own, which hold the attitude."""
    recovered: int
    """Times that sound commands came back before the patience was at its end."""
    reasons: Mapping[Refusal, int]
    """Refused commands by their reason; the reasons that occurred."""


class CommandGuard:
    """Checks commands between controller and autopilot, and stands in for those that are missing.

    Each tick `check` sees the controller's command; where it, or the controller, has refused, `hold` says what to send
    instead. Both raise `GuardTrippedError`; from `hold` it is final: nothing passes until `release`.
    """

    def __init__(self, config: Config) -> None:
        vehicle, guard = config.vehicle, config.guard
        self._rate_max, self._yaw_rate_max = vehicle.rate_max, vehicle.yaw_rate_max
        self._thrust_max = vehicle.thrust_max
        self._late, self._thrust_min = guard.late, guard.thrust_min
        self._rate_slew, self._thrust_slew = guard.rate_slew, guard.thrust_slew
        self._state_timeout, self._lost_after = config.safety.state_timeout, config.link.lost_after
        self._attitude_age = config.safety.state_timeout + guard.hold
        self._stall, self._stall_end = guard.late + guard.hold, guard.stall
        self._asked = math.nan
        self._stalled = 0.0
        self._heard_from = -math.inf
        self._patience = Patience(guard.hold, 1.0 / config.control.rate)
        self._last: tuple[float, tuple[float, float, float, float]] | None = None
        self._engaged = False
        self._was_armed = False
        self._taken_over = self._handed_over = ""
        self._passed = self._clipped = self._held = 0
        self._reasons = dict.fromkeys(Refusal, 0)

    @property
    def counts(self) -> GuardCounts:
        """What was passed, clipped, refused and held."""
        reasons = {refusal: count for refusal, count in self._reasons.items() if count}
        refused, recovered = sum(reasons.values()), self._patience.episodes
        return GuardCounts(self._passed, self._clipped, refused, self._held, recovered, reasons)

    @property
    def taken_over(self) -> bool:
        """Whether another hand holds the vehicle; nothing is passed until `release`."""
        return bool(self._taken_over)

    @property
    def handed_over(self) -> bool:
        """Whether sound commands were missing for so long that the autopilot shall land; as final."""
        return bool(self._handed_over)

    def take_report(self) -> str:
        """What there is to log of the last episode of refusals that ended well, once; mostly empty."""
        report = self._patience.report
        if report:
            self._patience.report = ""
        return report

    def release(self) -> None:
        """A new mission begins: forget that the vehicle was taken or handed over, and wait for OFFBOARD anew."""
        self._engaged = self._was_armed = False
        self._taken_over = self._handed_over = ""
        self._last = None
        self._heard_from = -math.inf
        self._patience.forget()

    def rest(self) -> None:
        """No commands are wanted for now, so none is missing."""
        self._asked = math.nan
        self._patience.rest()

    def refused(self, refusal: Refusal, detail: str) -> GuardTrippedError:
        """Count a command that did not even get here; what to raise and to give to `hold`."""
        self._reasons[refusal] += 1
        return GuardTrippedError(refusal, detail)

    def check_state(self, state: VehicleState, now: float) -> None:
        """Raise `GuardTrippedError` where ``state`` is older than `safety.state_timeout`, or of the future."""
        age = now - state.stamp
        if not abs(age) <= self._state_timeout:
            raise self.refused(Refusal.STATE_OLD, f"{age:.3f} s, at most {self._state_timeout:g} s can be bridged")

    def check(self, command: RateCommand, now: float, status: AutopilotStatus | None) -> RateCommand:
        """``command`` as it may be sent at ``now`` (s): the same one, or one within bounds.

        Rates are bounded by the vehicle's, thrust by `guard.thrust_min` (in flight) and the vehicle's
        full thrust, both in value and in how fast they change from one command to the next. Before the
        autopilot is in OFFBOARD commands pass, since it wants a stream of them to enter that mode; once it
        was, leaving the mode or disarming is taken as another hand's doing.

        Raises `GuardTrippedError` for a command that is not finite, malformed, or older than `guard.late`,
        when the mode is not known or nothing was heard of the autopilot for `link.lost_after`, and for every command
        after a takeover or a handing over. After a stall of the sender, in which PX4 may have ended OFFBOARD and would
        resume it at the next command, nothing passes until the autopilot was heard anew; after one of more than
        `guard.stall`, in which it has ended OFFBOARD, nothing passes at all. That it lands then is nobody's takeover.
        """
        self._pace(now, status)
        try:
            self._follow(status)
            self._hear(status, now)
            wanted = _numbers(command)
            age = now - command.stamp
            if not abs(age) <= self._late:
                raise GuardTrippedError(Refusal.STALE, f"{age:.3f} s old, at most {self._late:g} s")
        except GuardTrippedError as error:
            self._reasons[error.refusal] += 1
            raise
        flying = status is not None and status.armed and not status.landed
        safe = self._bounded(wanted, now, self._thrust_min if flying else 0.0)
        self._last = (now, safe)
        self._passed += 1
        self._patience.sound(now)
        if safe == wanted:
            return command
        self._clipped += 1
        return RateCommand(command.stamp, np.array(safe[:3]), safe[3])

    def hold(
        self, error: GuardTrippedError, now: float, status: AutopilotStatus | None, state: VehicleState | None
    ) -> RateCommand | None:
        """What to send at ``now`` (s) in place of the command that ``error`` refused, for at most `guard.hold` s.

        In flight that holds the attitude: no body rates, and the thrust that keeps the height in the attitude of
        ``state``. On the ground and before OFFBOARD, where the autopilot needs no help, and after a stall, where its
        mode is not known, it is None: send nothing.

        Raises `GuardTrippedError` when the patience is at its end, at once when the vehicle was taken over, and at once
        after a stall of more than `guard.stall`: what was on its way then may have the autopilot in OFFBOARD again.
        """
        self._pace(now, status)
        try:
            self._follow(status)
        except GuardTrippedError as final:
            if final.refusal is not error.refusal:
                self._reasons[final.refusal] += 1
            raise
        over = self._heard_from == math.inf
        if over:
            error = GuardTrippedError(Refusal.STALLED, f"for {self._stalled:.2f} s, which ends OFFBOARD")
        if self._patience.refused(now, str(error)) or over:
            self._patience.forget()
            self._handed_over = str(error)
            raise GuardTrippedError(Refusal.HANDED_OVER, self._handed_over, error.refusal)
        if status is None or status.mode is not _OFFBOARD or not status.armed or status.landed:
            return None
        if not status.stamp >= self._heard_from:
            return None
        thrust = holding_thrust(state, now, self._attitude_age, self._thrust_max)
        x, y, z, thrust = self._bounded((0.0, 0.0, 0.0, thrust), now, self._thrust_min)
        self._last = (now, (x, y, z, thrust))
        self._held += 1
        return RateCommand(now, np.array((x, y, z)), thrust)

    def _follow(self, status: AutopilotStatus | None) -> None:
        """Keep up with the autopilot's mode; raises once another hand is on the vehicle, or shall be."""
        if self._taken_over:
            raise GuardTrippedError(Refusal.TAKEN_OVER, self._taken_over)
        if self._handed_over:
            raise GuardTrippedError(Refusal.HANDED_OVER, self._handed_over)
        if status is None:
            return
        offboard = status.mode is _OFFBOARD
        failsafe = self._heard_from == math.inf and status.mode is FlightMode.LAND
        if self._engaged and not (offboard or failsafe):
            self._taken_over = f"mode {status.mode} while commands were followed"
        elif self._engaged and self._was_armed and not status.armed:
            self._taken_over = "disarmed while commands were followed"
        if self._taken_over:
            self._patience.forget()
            raise GuardTrippedError(Refusal.TAKEN_OVER, self._taken_over)
        self._engaged = offboard
        self._was_armed = offboard and status.armed

    def _pace(self, now: float, status: AutopilotStatus | None) -> None:
        """Notice that the sender has stalled, be it since before OFFBOARD was seen here."""
        engaged = self._engaged or (status is not None and status.mode is _OFFBOARD)
        if engaged and now - self._asked > self._stall:
            self._stalled = now - self._asked
            self._heard_from = math.inf if self._stalled > self._stall_end else now + SETTLE
        self._asked = now

    def _hear(self, status: AutopilotStatus | None, now: float) -> None:
        """Raise unless the autopilot was heard lately."""
        if status is None:
            raise GuardTrippedError(Refusal.NO_STATUS, "no status has come yet")
        age = now - status.stamp
        if not abs(age) <= self._lost_after:
            raise GuardTrippedError(Refusal.LINK_LOST, f"for {age:.2f} s, at most {self._lost_after:g} s")
        if status.stamp < self._heard_from:
            since = "which ends OFFBOARD" if self._heard_from == math.inf else f"the autopilot heard {age:.2f} s ago"
            raise GuardTrippedError(Refusal.STALLED, f"for {self._stalled:.2f} s, {since}")

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
