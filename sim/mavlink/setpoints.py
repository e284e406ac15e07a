"""SET_ATTITUDE_TARGET as PX4 v1.16 takes it (handle_message_set_attitude_target in mavlink_receiver.cpp)."""

import math
from struct import Struct
from typing import NamedTuple

import numpy as np

from sim.mavlink.codec import Frame
from sim.px4.model import Px4

IGNORE_ROLL_RATE, IGNORE_PITCH_RATE, IGNORE_YAW_RATE = 1, 2, 4
THRUST_BODY, IGNORE_THROTTLE, IGNORE_ATTITUDE = 32, 64, 128
"""ATTITUDE_TARGET_TYPEMASK."""
_THRUST_BODY = Struct("<3f")
"""An extension that follows the rest of the payload."""


class Setpoint(NamedTuple):
    """What was last asked for, in PX4's axes."""

    mask: int = 0
    orientation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    """w, x, y, z: body FRD to NED."""
    rates: tuple[float, ...] = (0.0, 0.0, 0.0)
    """rad/s, body FRD."""
    thrust: float = 0.0
    """0..1 as it was asked for; may be NaN."""
    stamp: float = 0.0
    """s, by the clock of who sent it."""


class Setpoints:
    """Hands setpoints to the vehicle; what isn't meant for it, it doesn't see."""

    def __init__(self, px4: Px4, system: int, component: int) -> None:
        self._px4 = px4
        self._targets = ((0, system), (0, component))
        self.last: Setpoint | None = None
        """The last one that was taken."""

    def take(self, frame: Frame) -> Setpoint | None:
        """Take one, if it is for this vehicle and asks for an attitude or for body rates."""
        sent, w, x, y, z, p, q, r, thrust, system, component, mask = frame.values()
        systems, components = self._targets
        if system not in systems or component not in components or not self._px4.parameters.get("MAV_FWDEXTSP", 1):
            return None
        attitude = not mask & IGNORE_ATTITUDE
        # The yaw rate may be left out, the others may not.
        if not attitude and mask & (IGNORE_ROLL_RATE | IGNORE_PITCH_RATE):
            return None
        if attitude and mask & THRUST_BODY:
            thrust = -_body_thrust(frame)
        elif mask & IGNORE_THROTTLE:
            thrust = 0.0
        self.last = Setpoint(mask, (w, x, y, z), (p, q, r), thrust, 1e-3 * sent)
        if attitude and math.isfinite(w + x + y + z) and math.hypot(w, x, y, z) > 1e-6:
            scale = 1.0 / math.hypot(w, x, y, z)
            self._px4.attitude_setpoint(np.array((w, x, -y, -z)) * scale, throttle(thrust))
        else:
            self._px4.attitude_target(self._rates(p, q, math.nan if mask & IGNORE_YAW_RATE else r), throttle(thrust))
        return self.last

    def _rates(self, p: float, q: float, r: float) -> tuple[float, float, float]:
        """FLU; a rate that isn't finite asks for the one that is flown (MulticopterRateControl.cpp)."""
        if math.isfinite(p + q + r):
            return p, -q, -r
        flown = self._px4.estimate().angular_velocity.tolist()
        wanted = (p, -q, -r)
        roll, pitch, yaw = (v if math.isfinite(v) else f for v, f in zip(wanted, flown, strict=True))
        return roll, pitch, yaw


def throttle(thrust: float) -> float:
    """What the motors can do of ``thrust``; one that isn't a number stops them."""
    return min(max(thrust, 0.0), 1.0) if not math.isnan(thrust) else 0.0


def _body_thrust(frame: Frame) -> float:
    """Thrust along body z, FRD; zero when the sender left trailing zeros out."""
    size = frame.kind.layout.size
    extension = frame.payload[size:]
    down: float = _THRUST_BODY.unpack(extension.ljust(_THRUST_BODY.size, b"\0")[: _THRUST_BODY.size])[2]
    return down
