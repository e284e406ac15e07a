"""PX4's telemetry messages, filled in as its streams do (src/modules/mavlink/streams of PX4 v1.16)."""

import math
from random import Random

from sim.imu import FORCE_NOISE, RATE_NOISE
from sim.mavlink.codec import encode, named
from sim.mavlink.snapshot import Builder, Snapshot, custom_mode
from sim.px4.modes import NavState

NED = 1
"""MAV_FRAME_LOCAL_NED."""
AUTOPILOT_ESTIMATE = 8
"""MAV_ESTIMATOR_TYPE_AUTOPILOT."""
QUADROTOR, PX4 = 2, 12
"""MAV_TYPE and MAV_AUTOPILOT."""
CUSTOM, ARMED = 1, 128
_AUTO_FLAGS, _MANUAL_FLAGS = 4 | 8 | 16, 16 | 64
_STANDBY, _ACTIVE, _CRITICAL = 3, 4, 5
"""MAV_MODE_FLAG and MAV_STATE."""
GYRO, ACCELEROMETER, GPS, MOTORS, RADIO = 1 << 0, 1 << 1, 1 << 5, 1 << 15, 1 << 16
AHRS, BATTERY, PREARM, EXTENDED = 1 << 21, 1 << 25, 1 << 28, 1 << 31
"""MAV_SYS_STATUS_SENSOR."""
ATTITUDE_OK, VELOCITY_OK, VERTICAL_VELOCITY_OK, RELATIVE_OK, HEIGHT_OK, CONSTANT = 1, 2, 4, 8, 32, 128
"""ESTIMATOR_STATUS_FLAGS."""
VARIANCES = (4e-4, 4e-4, 4e-4)
"""m² and rad² that EKF2 claims for itself on external vision of 2 cm."""
STATUS_PERIOD = 0.5
"""s, at least so often vehicle_status is published (Commander.cpp); else when it changes."""
NO_VALUE = 65535

_ODOMETRY, _ATTITUDE, _QUATERNION = named("ODOMETRY"), named("ATTITUDE"), named("ATTITUDE_QUATERNION")
_LOCAL, _IMU, _HEARTBEAT = named("LOCAL_POSITION_NED"), named("HIGHRES_IMU"), named("HEARTBEAT")
_NAN = math.nan
_NO_OFFSET = (0.0,) * 4


def _triangle(first: tuple[float, ...], second: tuple[float, ...]) -> tuple[float, ...]:
    """21 numbers of the upper right triangle of a (6, 6) covariance of which only the diagonal is known."""
    cells = [_NAN] * 21
    for place, value in zip((0, 6, 11, 15, 18, 20), (*first, *second), strict=True):
        cells[place] = value
    return tuple(cells)


_POSE_COVARIANCE = _triangle(VARIANCES, VARIANCES)
_TWIST_COVARIANCE = _triangle((4e-3, 4e-3, 4e-3), (_NAN, _NAN, _NAN))


def heartbeat(s: Snapshot) -> bytes:
    """HEARTBEAT."""
    px4, state = s.px4, s.px4.nav_state
    flags = CUSTOM | (_AUTO_FLAGS if state.custom_mode[0] in (4, 6) else _MANUAL_FLAGS) | (ARMED if px4.armed else 0)
    status = _STANDBY if not px4.armed else _CRITICAL if px4.failsafe else _ACTIVE
    return _HEARTBEAT.layout.pack(custom_mode(state), QUADROTOR, PX4, flags, status, 3)


def odometry(s: Snapshot) -> bytes:
    """ODOMETRY: position and velocity in NED, which child_frame_id says too."""
    return _ODOMETRY.layout.pack(
        s.microseconds, *s.position, *s.orientation, *s.velocity, *s.rates, *_POSE_COVARIANCE, *_TWIST_COVARIANCE,
        NED, NED, s.estimate.resets, AUTOPILOT_ESTIMATE, 0,
    )  # fmt: skip


def attitude(s: Snapshot) -> bytes:
    """ATTITUDE."""
    return _ATTITUDE.layout.pack(s.milliseconds, *s.euler, *s.rates)


def attitude_quaternion(s: Snapshot) -> bytes:
    """ATTITUDE_QUATERNION."""
    return _QUATERNION.layout.pack(s.milliseconds, *s.orientation, *s.rates, *_NO_OFFSET)


def local_position(s: Snapshot) -> bytes | None:
    """LOCAL_POSITION_NED, which PX4 sends only while position and velocity are valid: MAVSDK's sign of that."""
    if not s.estimate.position_valid:
        return None
    return _LOCAL.layout.pack(s.milliseconds, *s.position, *s.velocity)


def system_status(s: Snapshot) -> bytes:
    """SYS_STATUS: sensors are healthy where no check complains of them, also where there are none."""
    px4 = s.px4
    present = GYRO | ACCELEROMETER | MOTORS | BATTERY | AHRS
    healthy = GYRO | ACCELEROMETER | GPS | MOTORS | RADIO
    if px4.parameters.get("SYS_HAS_GPS", 0):
        healthy &= ~GPS
    if px4.ready:
        healthy |= AHRS
    if s.battery_warning == 0:
        healthy |= BATTERY
    enabled = present | (GPS & ~healthy)
    return encode(
        named("SYS_STATUS"),
        onboard_control_sensors_present=present | EXTENDED,
        onboard_control_sensors_enabled=enabled | EXTENDED,
        onboard_control_sensors_health=healthy | (PREARM if px4.armable else 0) | EXTENDED,
        load=300,
        voltage_battery=_millivolts(s),
        current_battery=-1,
        battery_remaining=_percent(s),
    )


def battery(s: Snapshot) -> bytes:
    """BATTERY_STATUS; the voltage of all cells stands in the first."""
    return encode(
        named("BATTERY_STATUS"),
        temperature=32767,
        voltages=(_millivolts(s), *(NO_VALUE,) * 9),
        current_battery=-1,
        current_consumed=-1,
        energy_consumed=-1,
        battery_remaining=_percent(s),
        charge_state=1 + s.battery_warning,
        type=1,
    )


def _millivolts(s: Snapshot) -> int:
    return min(max(round(1e3 * s.px4.voltage), 0), NO_VALUE - 1)


def _percent(s: Snapshot) -> int:
    return min(max(math.ceil(100.0 * s.px4.battery), 0), 100)


def extended_state(s: Snapshot) -> bytes:
    """EXTENDED_SYS_STATE."""
    return encode(named("EXTENDED_SYS_STATE"), landed_state=int(s.px4.landed))


def estimator_status(s: Snapshot) -> bytes:
    """ESTIMATOR_STATUS."""
    estimate, flags = s.estimate, ATTITUDE_OK
    if estimate.position_valid:
        flags |= VELOCITY_OK | VERTICAL_VELOCITY_OK | RELATIVE_OK
    else:
        flags |= CONSTANT
    if estimate.altitude_valid:
        flags |= VERTICAL_VELOCITY_OK | HEIGHT_OK
    accuracy = math.sqrt(VARIANCES[0]) if estimate.position_valid else 10.0
    return encode(
        named("ESTIMATOR_STATUS"),
        time_usec=s.microseconds,
        flags=flags,
        hagl_ratio=_NAN,
        tas_ratio=_NAN,
        pos_horiz_accuracy=accuracy,
        pos_vert_accuracy=accuracy,
    )


def system_time(s: Snapshot) -> bytes:
    """SYSTEM_TIME; without satellites the time of day isn't known."""
    return encode(named("SYSTEM_TIME"), time_boot_ms=s.milliseconds)


def altitude(s: Snapshot) -> bytes | None:
    """ALTITUDE: above the local origin."""
    if not s.estimate.altitude_valid:
        return None
    up = -s.position[2]
    return encode(
        named("ALTITUDE"),
        time_usec=s.microseconds,
        altitude_monotonic=up,
        altitude_amsl=_NAN,
        altitude_local=up,
        altitude_relative=up,
        altitude_terrain=_NAN,
        bottom_clearance=_NAN,
    )


def heads_up(s: Snapshot) -> bytes:
    """VFR_HUD."""
    north, east, down = s.velocity
    yaw = s.euler[2]
    return encode(
        named("VFR_HUD"),
        groundspeed=math.hypot(north, east),
        heading=0 if math.isnan(yaw) else round(math.degrees(yaw)) % 360,
        alt=-s.position[2],
        climb=-down,
    )


class Imu:
    """HIGHRES_IMU: accelerometer and gyroscope with the noise of PX4's simulated sensors."""

    FIELDS = 0b111111
    """HIGHRES_IMU_UPDATED: accelerations and rates."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)

    def __call__(self, s: Snapshot) -> bytes:
        """The message."""
        gauss = self._random.gauss
        force = [v + gauss(0.0, noise) for v, noise in zip(s.specific_force, FORCE_NOISE, strict=True)]
        rates = [v + gauss(0.0, noise) for v, noise in zip(s.rates, RATE_NOISE, strict=True)]
        return _IMU.layout.pack(
            s.microseconds, *force, *rates, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, 25.0, self.FIELDS, 0
        )


class CurrentMode:
    """CURRENT_MODE, which PX4 sends when vehicle_status was published since: on a change, and twice a second."""

    def __init__(self) -> None:
        self._told: tuple[NavState, NavState, bool, float] | None = None

    def __call__(self, s: Snapshot) -> bytes | None:
        """The message, if there is anything to tell."""
        px4 = s.px4
        state = (px4.nav_state, px4.intention, px4.armed, s.microseconds // int(1e6 * STATUS_PERIOD))
        if state == self._told:
            return None
        self._told = state
        return encode(
            named("CURRENT_MODE"),
            custom_mode=custom_mode(px4.nav_state),
            intended_custom_mode=custom_mode(px4.intention),
        )


BUILDERS: dict[str, Builder] = {
    "HEARTBEAT": heartbeat,
    "SYS_STATUS": system_status,
    "SYSTEM_TIME": system_time,
    "ATTITUDE": attitude,
    "ATTITUDE_QUATERNION": attitude_quaternion,
    "LOCAL_POSITION_NED": local_position,
    "VFR_HUD": heads_up,
    "ALTITUDE": altitude,
    "BATTERY_STATUS": battery,
    "ESTIMATOR_STATUS": estimator_status,
    "EXTENDED_SYS_STATE": extended_state,
    "ODOMETRY": odometry,
}
"""The streams that need nothing but the moment."""
