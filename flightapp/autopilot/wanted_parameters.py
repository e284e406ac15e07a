"""The PX4 parameters that an indoor flight on external vision and offboard body rates wants.

Short descriptions are those of PX4's parameter reference (v1.16 and main).
"""

import math
from collections.abc import Sequence
from enum import StrEnum

from flightapp.autopilot.parameters import Bits, Kind, Parameter, Severity, Wanted, Within, exactly
from flightapp.config import Config

INT, FLOAT = Kind.INT, Kind.FLOAT
MUST, SHOULD, NOTE = Severity.MUST, Severity.SHOULD, Severity.NOTE

POSITION_HEIGHT_YAW, WITH_VELOCITY = 11, 15
"""EKF2_EV_CTRL for poses without and with a velocity."""
DELAY_TOLERANCE = 5.0
"""ms, about one step of EKF2 at 100 Hz."""
HOVER_TOLERANCE = 0.1
"""Relative; PX4 estimates the rest in flight."""
TILT_MARGIN_DEG = 15.0
"""° that a tilt overshoots what the controller asks for."""
FREEST_TILT_DEG = 180.0
USB_UNCHECKED = 197848
TERMINATION_OFF = 121212
"""Magic numbers of PX4's circuit breakers."""
OPTIONAL_SENSOR = "this firmware was built without it"


class Profile(StrEnum):
    """Who else has a hand on the vehicle."""

    CAGE = "cage"
    """Nobody: no remote control and no ground station, in a cage."""
    PILOT = "pilot"
    """A safety pilot with a remote control, whose failsafes stay on."""


def wanted_parameters(config: Config, profile: Profile = Profile.CAGE) -> tuple[Parameter, ...]:
    """The table for ``config``'s vehicle, in the order in which it reads best."""
    hands = _cage() if profile == Profile.CAGE else _pilot()
    return (*_vision(config), *_estimator(config), *_offboard(config), *hands, *_vehicle(config), *_checks(config))


def _vision(config: Config) -> Sequence[Parameter]:
    vision = config.external_vision
    control = POSITION_HEIGHT_YAW if vision.message == "position" else WITH_VELOCITY
    delay = 0.0 if vision.timesync else 1e3 * vision.delay
    late = Within(max(delay - DELAY_TOLERANCE, 0.0), delay + DELAY_TOLERANCE, write=delay)
    noises = (
        ("EKF2_EVP_NOISE", vision.position_noise, "position"),
        ("EKF2_EVV_NOISE", vision.velocity_noise, "velocity"),
        ("EKF2_EVA_NOISE", vision.attitude_noise, "angle"),
    )
    return (
        Parameter("EKF2_EV_CTRL", INT, exactly(control), MUST, "External vision (EV) sensor aiding",
                  f"the tracker is the only source of position; external_vision.message = {vision.message} carries"
                  f" what these bits fuse"),
        Parameter("EKF2_EV_DELAY", FLOAT, late, SHOULD, "Vision Position Estimator delay relative to IMU measurements",
                  "poses arrive with the stamps of their capture (external_vision.timesync)" if vision.timesync else
                  "PX4 stamps poses on arrival, so it must know how old they are then (external_vision.delay, here"
                  " in ms)", reboot=True),
        Parameter("EKF2_EV_NOISE_MD", INT, exactly(1), SHOULD, "External vision (EV) noise mode",
                  "the noise parameters then count, and not what a tracker claims of itself"),
        *(Parameter(name, FLOAT, Within(0.5 * noise, 2.0 * noise, write=noise), SHOULD,
                    f"Measurement noise for vision {what} measurements",
                    f"external_vision has {noise:g}; PX4's default trusts the tracker less than its own integration")
          for name, noise, what in noises),
        *(Parameter(f"EKF2_EV_POS_{axis}", FLOAT, Within(-0.02, 0.02, write=0.0), SHOULD,
                    f"{axis} position of VI sensor focal point in body frame",
                    "the poses that are sent are the body's already, with the tracker's mount taken out")
          for axis in "XYZ"),
    )  # fmt: skip


def _estimator(config: Config) -> Sequence[Parameter]:
    period = 1e6 / config.link.odometry_rate
    return (
        Parameter("EKF2_HGT_REF", INT, exactly(3), MUST,
                  "Determines the reference source of height data used by the EKF",
                  "height comes from the tracker too; the barometer feels doors and propellers", reboot=True),
        Parameter("EKF2_GPS_CTRL", INT, exactly(0), MUST, "GNSS sensor aiding",
                  "indoors a satellite fix is a reflection", absent=OPTIONAL_SENSOR),
        Parameter("EKF2_MAG_TYPE", INT, exactly(5), MUST, "Type of magnetometer fusion",
                  "steel and motors turn the compass; heading comes from the tracker", reboot=True,
                  absent=OPTIONAL_SENSOR),
        Parameter("EKF2_BARO_CTRL", INT, exactly(1), SHOULD, "Barometric sensor height aiding",
                  "without the tracker it is what PX4 comes down by and notices the ground with; beside the tracker,"
                  " which is the reference, only its bias is learnt", absent=OPTIONAL_SENSOR),
        Parameter("EKF2_RNG_CTRL", INT, exactly(0), SHOULD, "Range sensor height aiding",
                  "a range finder takes a gate or a box for the floor", absent=OPTIONAL_SENSOR),
        Parameter("EKF2_PREDICT_US", INT, Within(1000, period, write=min(4000, math.floor(period))), SHOULD,
                  "EKF prediction period", "it bounds the rate of the autopilot's own estimate, of which"
                  f" link.odometry_rate asks for {config.link.odometry_rate:g} Hz (4000 µs give 250 Hz)"),
        Parameter("SYS_HAS_GPS", INT, exactly(0), SHOULD, "Control if the vehicle has a GPS",
                  "arming does not wait for a receiver that indoors finds nothing", reboot=True),
        Parameter("SYS_HAS_MAG", INT, exactly(0), SHOULD, "Control if and how many magnetometers are expected",
                  "arming does not wait for a compass that is not used", reboot=True),
        Parameter("COM_ARM_WO_GPS", INT, Within(choices=(1, 2), write=2), MUST, "Arming without GNSS configuration",
                  "there is no satellite fix to arm with", absent="this version does not ask for satellites"),
    )  # fmt: skip


def _offboard(config: Config) -> Sequence[Parameter]:
    return (
        Parameter("MAV_SYS_ID", INT, exactly(config.link.system_id), MUST, "MAVLink system ID",
                  "commands go to link.system_id and to no other vehicle", reboot=True, own=True),
        Parameter("MAV_FWDEXTSP", INT, exactly(1), MUST, "Forward external setpoint messages",
                  "without it PX4 ignores every setpoint that is sent to it",
                  absent="this version always takes setpoints"),
        Parameter("COM_OF_LOSS_T", FLOAT, Within(0.1, 0.5, write=0.5), MUST, "Offboard connection loss timeout",
                  "it is how long the last body rates are flown on after this computer has died"),
        Parameter("COM_LOW_BAT_ACT", INT, Within(choices=(2, 3), write=2), SHOULD, "Battery failsafe mode",
                  "PX4 then lands on a critical battery whatever this computer does (3, return, lands too where there"
                  " is no global position)"),
        Parameter("COM_DISARM_LAND", FLOAT, Within(0.1, 10.0, write=2.0), SHOULD,
                  "Time-out for auto disarm after landing",
                  "a landing is over when PX4 has disarmed"),
        Parameter("MPC_LAND_SPEED", FLOAT, Within(0.3, 0.65, write=0.6), SHOULD, "Landing descend rate",
                  "out of a climb that is broken off low PX4 sinks faster than it means to by more than half of that"),
        Parameter("COM_ARMABLE", INT, exactly(1), MUST, "Flag to allow arming", "0 keeps the vehicle on the ground",
                  absent="this version has no such lock"),
    )  # fmt: skip


def _cage() -> Sequence[Parameter]:
    return (
        Parameter("COM_OBL_RC_ACT", INT, exactly(4), MUST, "Set offboard loss failsafe mode",
                  "when this computer dies PX4 lands; the other modes need a pilot or a global position"),
        Parameter("COM_FAIL_ACT_T", FLOAT, Within(0.0, 1.0, write=0.0), SHOULD,
                  "Delay between failsafe condition triggered and failsafe reaction",
                  "the delay gives a pilot time to take over, and here there is none"),
        Parameter("COM_RC_IN_MODE", INT, exactly(4), MUST, "Manual control input source configuration",
                  "with no remote control PX4 would refuse to arm, or take its absence for a loss"),
        Parameter("COM_RCL_EXCEPT", INT, Bits(on=7), MUST, "Manual control loss exceptions",
                  "no remote control is no failsafe in mission, hold and offboard"),
        Parameter("NAV_DLL_ACT", INT, exactly(0), MUST, "Set GCS connection loss failsafe mode",
                  "there is no ground station whose loss could mean anything"),
        Parameter("COM_DLL_EXCEPT", INT, Bits(on=7), SHOULD, "Datalink loss exceptions",
                  "no ground station is no failsafe in mission, hold and offboard",
                  absent="this version knows NAV_DLL_ACT alone"),
    )  # fmt: skip


def _pilot() -> Sequence[Parameter]:
    return (
        Parameter("COM_OBL_RC_ACT", INT, Within(choices=(0, 4), write=4), MUST, "Set offboard loss failsafe mode",
                  "when this computer dies PX4 lands, or (0) the pilot has it in position mode"),
        Parameter("COM_FAIL_ACT_T", FLOAT, Within(0.0, 5.0, write=5.0), NOTE,
                  "Delay between failsafe condition triggered and failsafe reaction",
                  "it is the pilot's time to take over before PX4 acts"),
        Parameter("COM_RC_IN_MODE", INT, Within(choices=(0, 2, 3, 5, 6, 7, 8), write=0), MUST,
                  "Manual control input source configuration", "the safety pilot's remote control must be listened to"),
        Parameter("NAV_RCL_ACT", INT, Within(1, 6, write=3), MUST, "Set manual control loss failsafe mode",
                  "a pilot who has lost the link cannot help any more, so PX4 must land (hold and return land too"
                  " where there is no global position)"),
        Parameter("COM_RCL_EXCEPT", INT, Bits(off=4), MUST, "Manual control loss exceptions",
                  "losing the remote control must not be ignored in offboard"),
        Parameter("COM_RC_LOSS_T", FLOAT, Within(0.1, 1.0, write=0.5), SHOULD, "Manual control loss timeout",
                  "until then the sticks count as they last were"),
        Parameter("COM_RC_OVERRIDE", INT, Bits(on=2), SHOULD, "Enable manual control stick override",
                  "moving a stick then takes the vehicle out of offboard, without looking for a switch"),
        Parameter("RC_MAP_KILL_SW", INT, Within(1, 18), MUST, "Emergency Kill switch channel",
                  "the pilot must be able to stop the motors at once; assign the switch of your transmitter"),
        Parameter("RC_MAP_FLTMODE", INT, Within(1, 18), SHOULD, "Single channel flight mode selection",
                  "the pilot takes over with the mode switch; assign the switch of your transmitter"),
        Parameter("NAV_DLL_ACT", INT, exactly(0), NOTE, "Set GCS connection loss failsafe mode",
                  "anything else needs a ground station during the whole flight"),
    )  # fmt: skip


def _vehicle(config: Config) -> Sequence[Parameter]:
    vehicle = config.vehicle
    hover = round(vehicle.hover_thrust, 4)
    near = Within((1.0 - HOVER_TOLERANCE) * hover, (1.0 + HOVER_TOLERANCE) * hover, write=hover)
    curve: Wanted = Within(0.0, 1.0) if vehicle.thrust_curve == 0.0 else exactly(0.0)
    compensated = (
        "vehicle.thrust_curve is 0, so PX4 must make thrust linear: 0 fits only motors that are linear themselves"
        if vehicle.thrust_curve == 0.0
        else f"vehicle.thrust_curve = {vehicle.thrust_curve:g} is compensated here, and must not be twice"
    )
    tilt = min(config.control.tilt_max_deg + TILT_MARGIN_DEG, FREEST_TILT_DEG)
    failing = Within(tilt, FREEST_TILT_DEG, choices=(0,), write=math.ceil(tilt))
    return (
        Parameter("MPC_THR_HOVER", FLOAT, near, SHOULD, "Vertical thrust required to hover",
                  "PX4's own takeoff, landing and land detection start from it (vehicle.hover_thrust)", own=True),
        Parameter("MPC_USE_HTE", INT, exactly(1), SHOULD, "Use hover thrust estimate for altitude control",
                  "PX4's own climb and descent then follow the sagging battery"),
        Parameter("THR_MDL_FAC", FLOAT, curve, SHOULD, "Thrust to motor control signal model parameter", compensated,
                  own=True),
        *((Parameter("MC_BAT_SCALE_EN", INT, exactly(0), MUST, "Battery power level scaler",
                     "vehicle.battery_scale does it here, and it must not be done twice", own=True),)
          if vehicle.battery_scale else ()),
        *(Parameter(f"FD_FAIL_{axis[0]}", INT, failing, SHOULD, f"FailureDetector Max {axis}",
                    f"control.tilt_max_deg = {config.control.tilt_max_deg:g} is no failure; soon after takeoff PX4"
                    " would disarm for it") for axis in ("Roll", "Pitch")),
        *(Parameter(f"MC_{axis.upper()}RATE_MAX", FLOAT, Within(-math.inf, math.inf), NOTE, f"Max {axis} rate",
                    "it does not limit offboard body rates (vehicle.rate_max and yaw_rate_max do), only PX4's own"
                    " takeoff, hold and landing") for axis in ("roll", "pitch", "yaw")),
        Parameter("BAT1_SOURCE", INT, Within(0, math.inf), NOTE, "Battery 1 monitoring source",
                  "without it neither PX4 nor this computer knows when to land", absent="no battery monitor"),
        Parameter("BAT1_N_CELLS", INT, Within(1, 16), NOTE, "Number of cells for battery 1",
                  "the charge that is left is told from the voltage of a cell", absent="no battery monitor"),
    )  # fmt: skip


def _checks(config: Config) -> Sequence[Parameter]:
    usb = config.link.connection.startswith(("serial:///dev/ttyACM", "serial:///dev/serial/by-id/usb"))
    return (
        *((Parameter("CBRK_USB_CHK", INT, exactly(USB_UNCHECKED), MUST, "Circuit breaker for USB link check",
                     "PX4 does not arm over the USB cable that link.connection names", reboot=True, own=True),)
          if usb else ()),
        Parameter("CBRK_FLIGHTTERM", INT, exactly(TERMINATION_OFF), NOTE, "Circuit breaker for flight termination",
                  "with 0 the failure detector may stop the motors in flight; choose FD_FAIL_R and FD_FAIL_P with care",
                  reboot=True),
        Parameter("CBRK_SUPPLY_CHK", INT, exactly(0), NOTE, "Circuit breaker for power supply check",
                  "PX4 then arms without looking at its power supply, as simulations must", reboot=True),
        Parameter("SYS_HITL", INT, exactly(0), NOTE, "Enable HITL/SIH mode on next boot",
                  "anything else is a simulation inside the autopilot: the motors stay still", reboot=True,
                  absent=OPTIONAL_SENSOR),
        Parameter("SDLOG_MODE", INT, Within(0, 4, write=0), SHOULD, "Logging Mode",
                  "after a crash PX4's own log is what explains it", reboot=True, absent="no log storage"),
    )  # fmt: skip
