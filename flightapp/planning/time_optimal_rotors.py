"""What the four rotors of a quadrotor have to give: Euler's equation and the mixer.

Everything is per kilogram, so that thrusts are specific forces. A rotor gives a quarter of the collective thrust, more
or less what the torques need. Which of them gives more depends on the heading, so bounds are held for the heading
at which the torques ask most of one rotor. Yaw is left out: a mixer lets it go first where a rotor saturates.
"""

from dataclasses import dataclass

import numpy as np

from flightapp.config import Vehicle
from flightapp.frames import Vector

SIGNS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
"""Where the rotors are, ahead (+) or behind and left (+) or right: front left, front right, rear left, rear right.

A rotor's reaction torque has the sign of their product: front left and rear right turn clockwise, as PX4's quad X.
"""


@dataclass(frozen=True, slots=True)
class Airframe:
    """What turns torques into rotor thrusts."""

    inertia: tuple[float, float, float]
    """m², inertia over mass about the body axes."""
    rotor: tuple[float, float]
    """m, rotors ahead of and beside the centre of mass."""
    torque_ratio: float
    """m, reaction torque over thrust."""

    @classmethod
    def of(cls, vehicle: Vehicle) -> "Airframe":
        """The airframe of ``vehicle``."""
        x, y, z = (value / vehicle.mass for value in vehicle.inertia)
        return cls((x, y, z), vehicle.rotor, vehicle.torque_ratio)

    @property
    def tilt_share(self) -> float:
        """m: a rotor's specific thrust for an angular acceleration of 1 rad/s² across the thrust, at most."""
        return 0.25 * float(np.hypot(self.inertia[0] / self.rotor[1], self.inertia[1] / self.rotor[0]))

    @property
    def gyro_share(self) -> float:
        """m: a rotor's specific thrust for a body rate of 1 rad/s across the thrust, at most; it grows by the square.

        It keeps the body from turning about its thrust, as unequal inertias make it.
        """
        return abs(self.inertia[1] - self.inertia[0]) / (8.0 * self.torque_ratio)

    def thrusts(self, thrust: Vector, rates: Vector, spin_up: Vector) -> Vector:
        """(k, 4) specific thrust (m/s²) of each rotor in the order of `SIGNS`.

        For the collective specific ``thrust`` (k,), the ``rates`` of roll and pitch (k, 2) rad/s and their derivatives
        ``spin_up`` (k, 2), with no turn about the thrust.
        """
        x, y, _ = self.inertia
        shares = np.column_stack(
            (
                thrust,
                x * spin_up[:, 0] / self.rotor[1],
                -y * spin_up[:, 1] / self.rotor[0],
                (y - x) * rates[:, 0] * rates[:, 1] / self.torque_ratio,
            )
        )
        mixer = np.column_stack((np.ones(4), SIGNS[:, 1], SIGNS[:, 0], SIGNS.prod(axis=1)))
        thrusts: Vector = 0.25 * shares @ mixer.T
        return thrusts
