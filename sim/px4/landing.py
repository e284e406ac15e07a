"""PX4's land detector, as a model.

After src/modules/land_detector/MulticopterLandDetector.cpp of PX4 v1.16: ground contact, then maybe landed, then
landed, each once it has been so for a third of LNDMC_TRIG_TIME, and not any more as soon as it isn't. What is
asked there of the distance to the ground (there is no sensor for it) and of free fall is left out.
"""

import math
from typing import NamedTuple

STAGE = 1.0 / 3.0
"""s, LNDMC_TRIG_TIME / 3."""
RISING = 0.25
"""m/s, LNDMC_Z_VEL_MAX: vertical speed of a vehicle that moves up or down."""
SIDEWAYS = 1.5
"""m/s, LNDMC_XY_VEL_MAX."""
TURNING = math.radians(20.0)
"""rad/s, LNDMC_ROT_MAX."""
WIDER = 2.5
"""By which the speeds may be greater where it has landed."""
DESCENDING = 1.1 * RISING
"""m/s, downwards, that count as being asked to descend."""
LOW, LEAST = 0.6, 0.1
"""Shares of the throttle between the least and the hover's: too low to fly (where the hover thrust is estimated,
MPC_USE_HTE), and as good as none."""
BY_HAND_LEAST = 0.09
"""Throttle that is as good as none where it is given by hand: a little more than MPC_MANTHR_MIN."""
BLIND_TIME = 8.0
"""s with the least throttle that count as landed where the vertical velocity is not known."""


class Felt(NamedTuple):
    """How the vehicle moves by PX4's estimate; NaN where that is not known."""

    climb: float
    """m/s, upwards."""
    sideways: float
    """m/s."""
    turning: float
    """rad/s, of roll and pitch."""


class _Lasting:
    """Whether something has been so for long enough."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._since = -math.inf

    def update(self, now: float, so: bool) -> bool:
        self._since = min(self._since, now) if so else math.inf
        return now - self._since >= self._seconds


class LandDetector:
    """Judges from what PX4 knows: its estimate, its setpoint and its throttle."""

    def __init__(self, hover_thrust: float, least_thrust: float) -> None:
        span = hover_thrust - least_thrust
        self._low, self._least = least_thrust + LOW * span, least_thrust + LEAST * span
        self.reset()

    def reset(self) -> None:
        """Be disarmed, which counts as landed."""
        self.touched = self.maybe_landed = self.landed = True
        self._touching, self._maybe, self._surely = _Lasting(STAGE), _Lasting(STAGE), _Lasting(STAGE)
        self._idle = _Lasting(BLIND_TIME)
        self._landed_since = math.inf

    def update(self, now: float, felt: Felt, throttle: float, climb_wanted: float | None) -> None:
        """Take in what is ``felt``, the ``throttle`` 0..1 in force and the vertical velocity that is asked for.

        That is ``climb_wanted`` m/s: None where PX4 follows none, NaN where it has none to ask for.
        """
        was = self.landed
        self.touched = self._touching.update(now, self._touches(felt, throttle, climb_wanted))
        self.maybe_landed = self._maybe.update(now, self._rests(now, felt, throttle, climb_wanted))
        self.landed = self._surely.update(now, self.maybe_landed)
        if not self.landed:
            self._landed_since = math.inf
        elif not was:
            self._landed_since = now

    def _touches(self, felt: Felt, throttle: float, climb_wanted: float | None) -> bool:
        """Ground contact: too little throttle to fly, and no movement against a descent that is asked for."""
        still = abs(felt.climb) < (WIDER if self.landed else 1.0) * RISING and not felt.sideways > SIDEWAYS
        down = self.maybe_landed or self.landed or climb_wanted is None or climb_wanted <= -DESCENDING
        return throttle <= self._low and still and down

    def _rests(self, now: float, felt: Felt, throttle: float, climb_wanted: float | None) -> bool:
        """As good as no throttle, no rotation, and the ground; or, without a vertical velocity, for so long."""
        idle = throttle <= (BY_HAND_LEAST if climb_wanted is None else self._least)
        lasting = self._idle.update(now, idle)
        turning = felt.turning > (WIDER if self.landed else 1.0) * TURNING
        return idle and not turning and (lasting if math.isnan(felt.climb) else self.touched)

    def landed_for(self, now: float) -> float:
        """s since the landing was detected; negative before any."""
        return now - self._landed_since
