"""From specific force to PX4's collective thrust 0..1, and back."""

import math

from flightapp.frames import GRAVITY


class ThrustMap:
    """What the flight side believes of the motors: hover thrust and the curve between thrust command and thrust.

    PX4's model (THR_MDL_FAC, parameter reference): relative thrust = ``curve`` u² + (1 - ``curve``) u of the command
    u in 0..1, scaled here so that ``hover_thrust`` gives one g. ``curve`` is what is left of the motors' curve after
    PX4's own compensation: 0 where THR_MDL_FAC is set right, or the motors are linear.
    """

    def __init__(self, hover_thrust: float, curve: float = 0.0) -> None:
        if not (0.0 < hover_thrust <= 1.0 and 0.0 <= curve <= 1.0):
            raise ValueError(f"hover thrust must be in (0, 1] and curve in [0, 1], not {hover_thrust} and {curve}")
        self._curve = curve
        self._scale = GRAVITY / self._relative(hover_thrust)

    def _relative(self, throttle: float) -> float:
        return throttle * (self._curve * throttle + 1.0 - self._curve)

    def throttle(self, specific_force: float) -> float:
        """The command 0..1 for a collective ``specific_force`` in m/s²; saturates at both ends."""
        relative = min(max(specific_force / self._scale, 0.0), 1.0)
        if relative == 0.0:
            return 0.0
        linear = 1.0 - self._curve
        # The root of the quadratic that stays exact as the curve goes to 0.
        return min(2.0 * relative / (linear + math.sqrt(linear * linear + 4.0 * self._curve * relative)), 1.0)

    def specific_force(self, throttle: float) -> float:
        """The collective specific force in m/s² of a command ``throttle``, which is held to 0..1."""
        return self._scale * self._relative(min(max(throttle, 0.0), 1.0))
