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
DISARM_TIME = 1.0
"""s, COM_DISARM_LAND: landed so long, it disarms."""


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

    def disarms(self, now: float) -> bool:
        """Whether it has been landed for long enough to disarm."""
        return self.landed and now - self._landed_since >= DISARM_TIME
