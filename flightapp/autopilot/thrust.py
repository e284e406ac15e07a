"""From specific force to PX4's collective thrust 0..1, and back."""

import math
from typing import Self

from flightapp.config import Vehicle
from flightapp.frames import GRAVITY

PLAUSIBLE = (0.75, 1.25)
"""Voltages over the reference voltage that a battery in flight can have; others are a sensor's fault."""
SMOOTHING = 2.0
"""s, time constant of the voltage: it follows the charge, and not the dips of every climb."""


class ThrustMap:
    """What the flight side believes of the motors: hover thrust, the thrust command's curve, and the battery.

    PX4's model (THR_MDL_FAC, parameter reference): relative thrust = ``curve`` u² + (1 - ``curve``) u of the command
    u in 0..1, scaled here so that ``hover_thrust`` gives one g. ``curve`` is what is left of the motors' curve after
    PX4's own compensation: 0 where THR_MDL_FAC is set right, or the motors are linear.

    With a ``hover_voltage`` (V under load, at which ``hover_thrust`` was measured) the scale follows the voltages
    given to `observe_voltage`: a rotor's speed at a given command is proportional to the voltage, and its thrust to
    the speed's square. Leave it out where PX4 does this itself (MC_BAT_SCALE_EN).
    """

    def __init__(self, hover_thrust: float, curve: float = 0.0, hover_voltage: float | None = None) -> None:
        if not (0.0 < hover_thrust <= 1.0 and 0.0 <= curve <= 1.0):
            raise ValueError(f"hover thrust must be in (0, 1] and curve in [0, 1], not {hover_thrust} and {curve}")
        if hover_voltage is not None and not (hover_voltage > 0.0 and math.isfinite(hover_voltage)):
            raise ValueError(f"hover voltage must be positive and finite, not {hover_voltage}")
        self._curve, self._linear = curve, 1.0 - curve
        self._reference = hover_voltage
        self._voltage = math.nan
        self._observed = -math.inf
        self._battery = 1.0
        self._configured = GRAVITY / self.relative(hover_thrust)
        self._hover = hover_thrust
        self._learnt = 1.0
        self._scale = self._configured

    @classmethod
    def of(cls, vehicle: Vehicle) -> Self:
        """The map that the configured ``vehicle`` has before anything was learnt in flight."""
        voltage = vehicle.hover_voltage if vehicle.battery_scale else None
        return cls(vehicle.hover_thrust, vehicle.thrust_curve, voltage)

    @property
    def hover_thrust(self) -> float:
        """The command 0..1 that gives one g at the reference voltage, as it was learnt last."""
        return self._hover

    @property
    def battery_factor(self) -> float:
        """Thrust that the battery gives, over what it gave at the reference voltage; 1 where that isn't followed."""
        return self._battery

    def observe_voltage(self, voltage: float, now: float) -> None:
        """Take over the battery's ``voltage`` (V, under load), measured at ``now`` (s).

        What no battery in flight can have (NaN, 0 for "not known", outside of `PLAUSIBLE`) changes nothing: the last
        good voltage stays in force, and before the first there is no compensation.
        """
        if self._reference is None or not math.isfinite(now):
            return
        if not PLAUSIBLE[0] <= voltage / self._reference <= PLAUSIBLE[1]:
            return
        elapsed = now - self._observed
        if elapsed < 0.0:
            return
        weight = 1.0 if math.isinf(elapsed) else elapsed / (elapsed + SMOOTHING)
        self._voltage = voltage if weight == 1.0 else self._voltage + weight * (voltage - self._voltage)
        self._observed = now
        self._battery = (self._voltage / self._reference) ** 2
        self._scale = self._configured * self._battery * self._learnt

    def learn(self, hover_thrust: float) -> None:
        """Take ``hover_thrust`` (0..1, at the reference voltage) for what gives one g; NaN changes nothing."""
        if 0.0 < hover_thrust <= 1.0:
            self._hover = hover_thrust
            self._learnt = GRAVITY / (self._configured * self.relative(hover_thrust))
            self._scale = self._configured * self._battery * self._learnt

    def relative(self, throttle: float) -> float:
        """Thrust of the command ``throttle`` (0..1) over that of full throttle."""
        return throttle * (self._curve * throttle + self._linear)

    def throttle_of(self, relative: float) -> float:
        """The command 0..1 for a ``relative`` thrust, which is held to 0..1: the inverse of `relative`."""
        if not relative > 0.0:
            return 0.0
        if relative >= 1.0:
            return 1.0
        linear = self._linear
        # The root of the quadratic that stays exact as the curve goes to 0.
        return 2.0 * relative / (linear + math.sqrt(linear * linear + 4.0 * self._curve * relative))

    def throttle(self, specific_force: float) -> float:
        """The command 0..1 for a collective ``specific_force`` in m/s²; saturates at both ends, 0 for NaN."""
        return self.throttle_of(specific_force / self._scale)

    def specific_force(self, throttle: float) -> float:
        """The collective specific force in m/s² of a command ``throttle``, which is held to 0..1."""
        return self._scale * self.relative(min(max(throttle, 0.0), 1.0))

    def configured_force(self, throttle: float) -> float:
        """What `specific_force` would be, had nothing been learnt in flight: configuration and battery alone."""
        return self._configured * self._battery * self.relative(min(max(throttle, 0.0), 1.0))
