"""PX4's land detector, as a model.

After the multicopter land detector of PX4 (user guide, "Land detector"): on the ground the vehicle does not move up
or down although it is asked to descend, or is given next to no thrust. It is airborne once it has risen.
"""

import math

STILL = 0.2
"""m/s, vertical speed below which it may stand."""
DESCENDING = -0.3
"""m/s, setpoint that counts as being asked to descend."""
TOUCH_TIME = 0.35
"""s, ground contact: standing still against a descent."""
LANDED_TIME = 0.3
"""s, from contact to being landed."""
RISEN = 0.15
"""m above where it stood, airborne."""
LOW_THRUST = 0.3
"""Share of the hover thrust below which the vehicle cannot fly."""
BLIND_TIME = 8.0
"""s with so little thrust that count as landed where the vertical velocity is not known."""


class LandDetector:
    """Judges from what PX4 knows: its estimate, its setpoint and its throttle."""

    def __init__(self, hover_thrust: float) -> None:
        self._low = LOW_THRUST * hover_thrust
        self.reset()

    def reset(self) -> None:
        """Stand on the ground, at a height that the next `update` tells."""
        self.landed = True
        self.touched = False
        self.ground: float | None = None
        """m, where it stood when it was armed."""
        self._still_since = self._landed_since = math.inf

    def update(self, now: float, height: float, climb: float, climb_wanted: float, throttle: float | None) -> None:
        """Take in the estimated ``height`` m and ``climb`` m/s, and what is asked for.

        That is ``throttle`` 0..1, or, where it is None, the vertical velocity ``climb_wanted`` m/s.
        """
        if self.ground is None:
            self.ground = height
        if self.landed:
            if height > self.ground + RISEN and not self.touched:
                self.landed = False
                self._still_since = self._landed_since = math.inf
            return
        sinking = climb_wanted < DESCENDING if throttle is None else throttle < self._low
        if not sinking or abs(climb) > STILL:
            self._still_since = math.inf
            self.touched = False
            return
        self._still_since = min(self._still_since, now)
        still = now - self._still_since
        self.touched = throttle is None and still >= TOUCH_TIME
        if still >= TOUCH_TIME + LANDED_TIME:
            self.landed, self._landed_since = True, now

    def update_blind(self, now: float, throttle: float | None) -> None:
        """As `update` without a vertical velocity: PX4 then takes it that the vehicle moves.

        Only a ``throttle`` that stays too low to fly ends that; None where PX4 gives it by itself.
        """
        self.touched = False
        if throttle is None or throttle >= self._low:
            self.landed = False
            self._still_since = self._landed_since = math.inf
            return
        self._still_since = min(self._still_since, now)
        if not self.landed and now - self._still_since >= BLIND_TIME:
            self.landed, self._landed_since = True, now

    def landed_for(self, now: float) -> float:
        """s since the landing was detected; negative before any."""
        return now - self._landed_since if self.landed else -math.inf
