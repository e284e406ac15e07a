"""PX4's cascaded position controller, as a model: position P, velocity PI, attitude P.

Structure and gains: PX4 user guide, "Multicopter controller diagrams" and the parameter reference (defaults of
MPC_XY_P, MPC_Z_P, MPC_*_VEL_*_ACC, MC_ROLL_P, MC_YAW_P, MPC_TILTMAX_AIR, MC_ROLLRATE_MAX).
"""

import math

import numpy as np

from flightapp.autopilot.thrust import ThrustMap
from flightapp.frames import (
    GRAVITY,
    Vector,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
    quat_to_rotvec,
)
from flightapp.jit import kernel

POSITION_P = (0.95, 0.95, 1.0)
"""1/s."""
VELOCITY_P = (1.8, 1.8, 4.0)
"""1/s."""
VELOCITY_I = (0.4, 0.4, 2.0)
"""1/s²."""
CORRECTION_MAX = 2.0
"""m/s, of the position loop."""
FORCE_MIN = 0.3 * GRAVITY
"""m/s², least upward force asked for, so that the attitude stays defined."""
TILT_MAX = math.radians(45.0)
ATTITUDE_P = (6.5, 6.5, 2.8)
"""1/s."""
RATE_MAX = math.radians(220.0)
THRUST_MIN = 0.12
"""MPC_THR_MIN."""
ACCELERATION = 3.0
"""m/s², MPC_ACC_HOR, with which the setpoint's velocity changes."""


@kernel
def _force(setpoint: Vector, position: Vector, velocity: Vector, integral: Vector, dt: float) -> Vector:
    """Specific force (3,), world, towards the ``setpoint`` (6,) (position, velocity); moves ``integral`` on."""
    force, error = np.empty(3), np.empty(3)
    for i in range(3):
        correction = POSITION_P[i] * (setpoint[i] - position[i])
        error[i] = setpoint[3 + i] + min(max(correction, -CORRECTION_MAX), CORRECTION_MAX) - velocity[i]
        force[i] = VELOCITY_P[i] * error[i] + integral[i]
    force[2] = max(force[2] + GRAVITY, FORCE_MIN)
    sideways, steepest = math.hypot(force[0], force[1]), force[2] * math.tan(TILT_MAX)
    if sideways > steepest:
        force[:2] *= steepest / sideways
    else:
        for i in range(3):
            integral[i] = min(max(integral[i] + VELOCITY_I[i] * error[i] * dt, -GRAVITY), GRAVITY)
    return force


@kernel
def turn(wanted: Vector, orientation: Vector) -> Vector:
    """Body rates (3,) in rad/s that turn ``orientation`` (4,) into ``wanted`` (4,): PX4's attitude P controller."""
    error = quat_to_rotvec(quat_multiply(quat_conjugate(orientation), wanted))
    for i in range(3):
        error[i] = min(max(ATTITUDE_P[i] * error[i], -RATE_MAX), RATE_MAX)
    return error


@kernel
def _rates(force: Vector, yaw: float, orientation: Vector) -> Vector:
    """Body rates (3,) that turn body z towards ``force`` (3,) and body x towards ``yaw``."""
    z = force / math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    y = np.array((-z[2] * math.sin(yaw), z[2] * math.cos(yaw), z[0] * math.sin(yaw) - z[1] * math.cos(yaw)))
    y /= math.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2)
    R_wb = np.empty((3, 3))
    R_wb[:, 0] = (y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0])
    R_wb[:, 1] = y
    R_wb[:, 2] = z
    return turn(quat_from_matrix(R_wb), orientation)


@kernel
def control(
    setpoint: Vector, yaw: float, position: Vector, velocity: Vector, orientation: Vector, integral: Vector, dt: float
) -> tuple[float, float, float, float]:
    """Body rates in rad/s (FLU) and specific force in m/s² towards ``setpoint`` (6,), from the estimate."""
    force = _force(setpoint, position, velocity, integral, dt)
    rates = _rates(force, yaw, orientation)
    return rates[0], rates[1], rates[2], math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)


@kernel
def _level(force: float, yaw: float, orientation: Vector) -> tuple[float, float, float]:
    """Body rates in rad/s (FLU) that keep the vehicle upright, facing ``yaw``."""
    rates = _rates(np.array((0.0, 0.0, force)), yaw, orientation)
    return rates[0], rates[1], rates[2]


class PositionController:
    """Follows a moving position setpoint, or stays level; all in the frame of the estimate that it is given."""

    def __init__(self, thrust: ThrustMap) -> None:
        self.thrust = thrust
        self._integral = np.zeros(3)
        self._setpoint = np.zeros(6)
        self.yaw = 0.0

    @property
    def position(self) -> Vector:
        """Setpoint's position (3,), m."""
        return self._setpoint[:3]

    @property
    def climb(self) -> float:
        """Setpoint's vertical velocity, m/s."""
        return float(self._setpoint[5])

    def reset(self, position: Vector, velocity: Vector, yaw: float) -> None:
        """As `begin`, and forget what was integrated, as on the ground."""
        self._integral[:] = 0.0
        self.begin(position, velocity, yaw)

    def begin(self, position: Vector, velocity: Vector, yaw: float) -> None:
        """Start with the setpoint at ``position`` moving with ``velocity`` (3,), facing ``yaw``.

        What was integrated before stays, such as what a weak battery takes (MulticopterPositionControl.cpp).
        """
        self._setpoint[:3], self._setpoint[3:], self.yaw = position, velocity, yaw

    def shift(self, move: Vector, turned: float) -> None:
        """Move the setpoint by ``move`` (3,) m and ``turned`` rad, with an estimate that was reset."""
        self._setpoint[:3] += move
        self.yaw += turned

    def steer(self, wanted: tuple[float, float, float], dt: float) -> None:
        """Bring the setpoint's velocity to ``wanted`` m/s, acceleration bounded, and move it on by ``dt``."""
        velocity = self._setpoint[3:].tolist()
        change = (wanted[0] - velocity[0], wanted[1] - velocity[1], wanted[2] - velocity[2])
        size = math.hypot(*change)
        share = min(ACCELERATION * dt / size, 1.0) if size > 0.0 else 0.0
        for i in range(3):
            moved = velocity[i] + share * change[i]
            self._setpoint[3 + i] = moved
            self._setpoint[i] += moved * dt

    def sink(self, height: float, speed: float) -> None:
        """Go down with ``speed`` m/s from the ``height`` m where it is: no setpoint runs ahead."""
        self._setpoint[2], self._setpoint[5] = height, -speed

    def command(
        self, position: Vector, velocity: Vector, orientation: Vector, dt: float
    ) -> tuple[tuple[float, float, float], float]:
        """Body rates in rad/s, FLU, and throttle 0..1 towards the setpoint."""
        p, q, r, force = control(self._setpoint, self.yaw, position, velocity, orientation, self._integral, dt)
        return (p, q, r), self._throttle(force)

    def command_level(
        self, climb_wanted: float, climb: float, orientation: Vector, dt: float
    ) -> tuple[tuple[float, float, float], float]:
        """As `command`, but upright, rising at ``climb_wanted`` m/s with the estimated ``climb``."""
        self._setpoint[5] = climb_wanted
        error = climb_wanted - climb
        self._integral[2] = min(max(self._integral[2] + VELOCITY_I[2] * error * dt, -GRAVITY), GRAVITY)
        return self.command_force(max(GRAVITY + VELOCITY_P[2] * error + self._integral[2], FORCE_MIN), orientation)

    def command_force(self, force: float, orientation: Vector) -> tuple[tuple[float, float, float], float]:
        """As `command`, but upright with a specific ``force`` in m/s², whatever comes of it."""
        return _level(force, self.yaw, orientation), self._throttle(force)

    def _throttle(self, force: float) -> float:
        return max(self.thrust.throttle(force), THRUST_MIN)
