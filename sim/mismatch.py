"""Vehicles that are not what their files say: heavier, weaker, slower."""

from dataclasses import dataclass

import numpy as np

from flightapp.config import Simulation
from sim.vehicles import VehicleParameters, load_vehicle

MASS = THRUST = 0.1
"""Greatest relative deviation drawn."""
DRAG = 2.0
"""Greatest factor drawn, and the inverse of the least."""
MOTOR = 0.3
"""Greatest relative deviation of the time constants drawn."""
DELAY = 0.010
"""s, greatest deviation drawn."""


@dataclass(frozen=True, slots=True)
class Mismatch:
    """How a vehicle differs from its file: factors, and s of delay."""

    mass: float = 1.0
    thrust: float = 1.0
    drag: float = 1.0
    motor: float = 1.0
    delay: float = 0.0

    def times(self, other: "Mismatch") -> "Mismatch":
        """Both together."""
        return Mismatch(
            self.mass * other.mass,
            self.thrust * other.thrust,
            self.drag * other.drag,
            self.motor * other.motor,
            self.delay + other.delay,
        )

    def of(self, vehicle: VehicleParameters) -> VehicleParameters:
        """``vehicle`` with this mismatch. Its inertia stays; a delay cannot become negative."""
        changes = {
            "mass": self.mass * vehicle.mass,
            # Rotors that give more thrust at the same speed: their speeds, and so their torque over thrust, stay.
            "thrust_max": self.thrust * vehicle.thrust_max,
            "thrust_coefficient": self.thrust * vehicle.thrust_coefficient,
            "linear_drag": tuple(self.drag * d for d in vehicle.linear_drag),
            "drag_area": self.drag * vehicle.drag_area,
            "motor_up": self.motor * vehicle.motor_up,
            "motor_down": self.motor * vehicle.motor_down,
            "delay": max(vehicle.delay + self.delay, 0.0),
        }
        return vehicle.model_copy(update=changes)


def drawn(seed: int, size: float = 1.0) -> Mismatch:
    """A mismatch uniform within ``size`` times the greatest deviations, of the drag's factor in its logarithm."""
    mass, thrust, drag, motor, delay = size * np.random.default_rng([seed, 0x315]).uniform(-1.0, 1.0, 5)
    return Mismatch(
        1.0 + MASS * mass, 1.0 + THRUST * thrust, float(DRAG**drag), 1.0 + MOTOR * motor, float(DELAY * delay)
    )


def mismatched(sim: Simulation, seed: int) -> VehicleParameters:
    """The vehicle that ``sim`` describes, with what it draws from ``seed``; raises `BadInputError` if there is none."""
    vehicle = load_vehicle(sim.vehicle)
    given = Mismatch(sim.mass_factor, sim.thrust_factor, sim.drag_factor, sim.motor_factor, sim.delay_extra)
    return given.times(drawn(seed, sim.mismatch)).of(vehicle)
