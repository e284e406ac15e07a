"""What the vehicle's streams tell of one moment, in PX4's own terms: NED, body FRD, time since boot."""

import math
from collections.abc import Callable
from functools import cached_property

from flightapp.frames import Vector, flip_yz, quat_to_euler
from sim.px4.estimator import Estimate
from sim.px4.model import Px4
from sim.px4.modes import NavState

Numbers = tuple[float, ...]


class Snapshot:
    """The moment that the vehicle has come to.

    ``unknown`` makes NaN of every measured or estimated number, as a broken estimator would.
    """

    def __init__(self, px4: Px4, unknown: bool = False) -> None:
        self.px4 = px4
        self._now = px4.plant.time
        self._unknown = unknown

    @property
    def microseconds(self) -> int:
        """Since boot."""
        return max(int(1e6 * (self._now - self.px4.boot_time)), 0)

    @property
    def milliseconds(self) -> int:
        """Since boot."""
        return self.microseconds // 1000

    @cached_property
    def estimate(self) -> Estimate:
        """EKF2's, FLU."""
        return self.px4.estimate()

    @cached_property
    def position(self) -> Numbers:
        """m, NED."""
        return self._told(flip_yz(self.estimate.position))

    @cached_property
    def velocity(self) -> Numbers:
        """m/s, NED."""
        return self._told(flip_yz(self.estimate.velocity))

    @cached_property
    def rates(self) -> Numbers:
        """rad/s, body FRD."""
        return self._told(flip_yz(self.estimate.angular_velocity))

    @cached_property
    def orientation(self) -> Numbers:
        """w, x, y, z: body FRD to NED."""
        w, x, y, z = self._told(self.estimate.orientation)
        return w, x, -y, -z

    @cached_property
    def euler(self) -> Numbers:
        """rad, roll, pitch and yaw of body FRD in NED."""
        if self._unknown:
            return (math.nan,) * 3
        roll, pitch, yaw = quat_to_euler(self.estimate.orientation)
        return roll, -pitch, -yaw

    @cached_property
    def specific_force(self) -> Numbers:
        """m/s², body FRD."""
        return self._told(flip_yz(self.px4.plant.specific_force))

    @property
    def battery_warning(self) -> int:
        """0 none, 1 low, 2 critical, 3 emergency."""
        left, parameters = self.px4.battery, self.px4.parameters
        return sum(left < float(parameters[f"BAT_{level}_THR"]) for level in ("LOW", "CRIT", "EMERGEN"))

    def _told(self, vector: Vector) -> Numbers:
        return (math.nan,) * len(vector) if self._unknown else tuple(vector.tolist())


def custom_mode(state: NavState) -> int:
    """Of HEARTBEAT and CURRENT_MODE (px4_custom_mode.h)."""
    main, sub = state.custom_mode
    return main << 16 | sub << 24


Builder = Callable[[Snapshot], bytes | None]
"""Makes a message's payload; None where PX4 would send none."""
