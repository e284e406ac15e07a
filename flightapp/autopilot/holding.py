"""What the guard sends while there is no sound command, and for how long: pure, on the way to handing over."""

import math

from flightapp.frames import GRAVITY
from flightapp.messages import VehicleState

STEEPEST = 0.3
"""Cosine of the tilt beyond which no thrust keeps the height without throwing the vehicle sideways (73°)."""
REGAIN = 0.1
"""Seconds of patience regained per second of sound commands: a command that comes every other time is not sound."""


def holding_thrust(state: VehicleState | None, now: float, oldest: float, thrust_max: float) -> float:
    """Specific force (m/s²) along body z that keeps the height in the attitude of ``state``.

    Level flight is taken for granted where ``state`` is older than ``oldest`` s, missing or not finite. No more than
    ``thrust_max``; 0 beyond the steepest tilt, and upside down.
    """
    if state is None or not abs(now - state.stamp) <= oldest:
        return GRAVITY
    w, x, y, z = state.orientation.tolist()
    length = w * w + x * x + y * y + z * z
    if not 0.9 < length < 1.1:
        return GRAVITY
    upright = 1.0 - 2.0 * (x * x + y * y) / length
    return min(GRAVITY / upright, thrust_max) if upright > STEEPEST else 0.0


class Patience:
    """How long commands may be missing: ``limit`` s on end, spent by refusals and slowly regained.

    ``period`` (s) is what one refusal alone costs. An episode begins with a refusal and ends when all is regained,
    so that there is one line to log of however many refusals.
    """

    def __init__(self, limit: float, period: float) -> None:
        self._limit = limit
        self._period = period
        self._spent = 0.0
        self._judged = 0.0
        self._refusing = False
        self._began = self._until = math.nan
        self._count = 0
        self._first = ""
        self.episodes = 0
        """Those that ended well."""
        self.report = ""
        """What the last episode that ended well was; whoever has logged it empties it."""

    def refused(self, now: float, why: str) -> bool:
        """One more command is missing at ``now``; whether the patience is at its end."""
        if self._count == 0:
            self._began, self._first = now, why
        self._spent += now - self._judged if self._refusing else self._period
        self._judged = self._until = now
        self._refusing = True
        self._count += 1
        return self._spent > self._limit

    def sound(self, now: float) -> None:
        """A sound command has come at ``now``."""
        if self._count == 0:
            return
        self._spent -= REGAIN * (now - self._judged)
        self._judged, self._refusing = now, False
        if self._spent <= 0.0:
            self.rest()

    def rest(self) -> None:
        """No commands are wanted any more; the episode, if there is one, is over."""
        if self._count == 0:
            return
        lasted = self._until - self._began
        self.report = f"{self._count} commands refused within {lasted:.3f} s, flown on; the first: {self._first}"
        self.episodes += 1
        self.forget()

    def forget(self) -> None:
        """Begin anew, with all the patience."""
        self._spent, self._count, self._refusing = 0.0, 0, False
