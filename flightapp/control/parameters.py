"""The numbers that the control kernels work with."""

import math
from typing import NamedTuple

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.jit import kernel


class Parameters(NamedTuple):
    """Vehicle, gains and limits in SI units."""

    delay: float
    """s, from sending a command to its taking effect."""
    rate_lag: float
    """s, first-order lag of the roll and pitch rates."""
    yaw_rate_lag: float
    """s, the same of the yaw rate."""
    motor_lag: float
    """s, first-order lag of the collective thrust."""
    drag_x: float
    """1/s, specific force per m/s along body x."""
    drag_y: float
    drag_z: float
    kp_xy: float
    """1/s², position gain."""
    kd_xy: float
    """1/s, velocity gain."""
    kp_z: float
    kd_z: float
    integral: float
    """1/s, rate at which a steady error is removed."""
    push_max: float
    """m/s², greatest horizontal disturbance learnt."""
    trim_max: float
    """Greatest relative error of the thrust learnt."""
    airborne_height: float
    """m, world height above which disturbances are learnt."""
    error_max: float
    """m, position errors count no more than this."""
    attitude_gain: float
    """1/s, tilt."""
    yaw_gain: float
    """1/s, heading."""
    tilt_cotangent: float
    """Cotangent of the greatest tilt."""
    rate_max: float
    """rad/s, length of the roll-pitch rate vector."""
    yaw_rate_max: float
    """rad/s."""
    thrust_min: float
    """m/s²."""
    thrust_max: float
    """m/s²."""


def parameters_of(config: Config) -> Parameters:
    """The control kernels' numbers from ``config``.

    A loop of bandwidth ω and damping ζ has the gains ω² and 2ζω.
    """
    vehicle, control = config.vehicle, config.control
    return Parameters(
        delay=vehicle.delay,
        rate_lag=vehicle.rate_lag,
        yaw_rate_lag=vehicle.yaw_rate_lag,
        motor_lag=vehicle.motor_lag,
        drag_x=vehicle.drag[0],
        drag_y=vehicle.drag[1],
        drag_z=vehicle.drag[2],
        kp_xy=control.position_bandwidth**2,
        kd_xy=2.0 * control.position_damping * control.position_bandwidth,
        kp_z=control.height_bandwidth**2,
        kd_z=2.0 * control.height_damping * control.height_bandwidth,
        integral=control.integral,
        push_max=control.push_max,
        trim_max=control.trim_max,
        airborne_height=control.airborne_height,
        error_max=control.error_max,
        attitude_gain=control.attitude_bandwidth,
        yaw_gain=control.yaw_bandwidth,
        tilt_cotangent=1.0 / math.tan(math.radians(control.tilt_max_deg)),
        rate_max=vehicle.rate_max,
        yaw_rate_max=vehicle.yaw_rate_max,
        thrust_min=config.guard.thrust_min,
        thrust_max=vehicle.thrust_max,
    )


@kernel
def unpacked(a: Vector) -> Parameters:
    """The `Parameters` whose values are ``a`` (23,), in order.

    Handing an array to a kernel takes a tenth of the time that handing it the tuple would.
    """
    return Parameters(
        *(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10]),
        *(a[11], a[12], a[13], a[14], a[15], a[16], a[17], a[18], a[19], a[20], a[21], a[22]),
    )
