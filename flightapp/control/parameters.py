"""The numbers that the control kernels work with."""

import math
from collections.abc import Collection
from typing import NamedTuple

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.jit import shared

LEAST_LAG = 1e-4
"""s, a lag that is none."""


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
    disturbance: float
    """rad/s, bandwidth of the disturbance's observer."""
    drift: float
    """rad/s, bandwidth of the observer of what the velocity lacks."""
    trim_rate: float
    """1/s, rate at which what of the disturbance lasts along the thrust is put down to the thrust."""
    push_max: float
    """m/s², greatest disturbance learnt."""
    trim_max: float
    """Greatest relative error of the thrust learnt."""
    drag_trim_max: float
    """Greatest relative error of the drag learnt."""
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
    foresight: float
    """Share of the time from the state to the command's effect that is predicted."""
    acceleration: float
    """Shares of the trajectory's acceleration, jerk and snap that are fed forward."""
    jerk: float
    snap: float
    error_rate: float
    """Share of the correction's rate of change that is fed forward."""
    rate_lead: float
    """s, by which roll and pitch rates lead, for the rate loop's lag."""
    yaw_lead: float
    """s, the same of the yaw rate."""
    thrust_lead: float
    """s, the same of the thrust."""
    rate_pole: float
    """1/s, the inverses of the lags: the kernel multiplies rather than divides."""
    yaw_pole: float
    motor_pole: float


SWITCHES: dict[str, dict[str, float]] = {
    "acceleration": {"acceleration": 0.0},
    "jerk": {"jerk": 0.0},
    "snap": {"snap": 0.0},
    "drag": {"drag_x": 0.0, "drag_y": 0.0, "drag_z": 0.0},
    "prediction": {"foresight": 0.0, "delay": 0.0},
    "rate_lead": {"rate_lead": 0.0, "yaw_lead": 0.0},
    "thrust_lead": {"thrust_lead": 0.0},
    "error_rate": {"error_rate": 0.0},
    "disturbance": {"disturbance": 0.0, "trim_rate": 0.0},
    "drift": {"drift": 0.0},
}
"""What switches each term of the control law off."""


def parameters_of(config: Config, without: Collection[str] = ()) -> Parameters:
    """The control kernels' numbers from ``config``, without the terms that it names and those in ``without``.

    A loop of bandwidth ω and damping ζ has the gains ω² and 2ζω.
    """
    parameters = _all_terms(config)
    for term in {*without, *config.control.without}:
        parameters = parameters._replace(**SWITCHES[term])
    return parameters


def _all_terms(config: Config) -> Parameters:
    vehicle, control = config.vehicle, config.control
    return Parameters(
        delay=vehicle.delay,
        rate_lag=max(vehicle.rate_lag, LEAST_LAG),
        yaw_rate_lag=max(vehicle.yaw_rate_lag, LEAST_LAG),
        motor_lag=max(vehicle.motor_lag, LEAST_LAG),
        drag_x=vehicle.drag[0],
        drag_y=vehicle.drag[1],
        drag_z=vehicle.drag[2],
        kp_xy=control.position_bandwidth**2,
        kd_xy=2.0 * control.position_damping * control.position_bandwidth,
        kp_z=control.height_bandwidth**2,
        kd_z=2.0 * control.height_damping * control.height_bandwidth,
        disturbance=control.disturbance_bandwidth,
        drift=control.drift_bandwidth,
        trim_rate=control.trim_rate,
        push_max=control.push_max,
        trim_max=control.trim_max,
        drag_trim_max=control.drag_trim_max,
        airborne_height=control.airborne_height,
        error_max=control.error_max,
        attitude_gain=control.attitude_bandwidth,
        yaw_gain=control.yaw_bandwidth,
        tilt_cotangent=1.0 / math.tan(math.radians(control.tilt_max_deg)),
        rate_max=vehicle.rate_max,
        yaw_rate_max=vehicle.yaw_rate_max,
        thrust_min=config.guard.thrust_min,
        thrust_max=vehicle.thrust_max,
        foresight=1.0,
        acceleration=1.0,
        jerk=1.0,
        snap=1.0,
        error_rate=1.0,
        rate_lead=vehicle.rate_lag,
        yaw_lead=vehicle.yaw_rate_lag,
        thrust_lead=vehicle.motor_lag,
        rate_pole=1.0 / max(vehicle.rate_lag, LEAST_LAG),
        yaw_pole=1.0 / max(vehicle.yaw_rate_lag, LEAST_LAG),
        motor_pole=1.0 / max(vehicle.motor_lag, LEAST_LAG),
    )


@shared
def unpacked(a: Vector) -> Parameters:
    """The `Parameters` whose values are the first of ``a`` (37,), in order.

    Handing an array to a kernel takes a tenth of the time that handing it the tuple would.
    """
    return Parameters(
        *(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10]),
        *(a[11], a[12], a[13], a[14], a[15], a[16], a[17], a[18], a[19], a[20], a[21]),
        *(a[22], a[23], a[24], a[25], a[26], a[27], a[28], a[29], a[30], a[31], a[32]),
        *(a[33], a[34], a[35], a[36]),
    )
