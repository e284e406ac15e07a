"""What a doctor looks at besides parameters: the vehicle's own word, its telemetry, and what is set here."""

import math
import re
from collections.abc import Mapping

from flightapp.autopilot.clock import RoundTrip
from flightapp.autopilot.connection import parse_connection
from flightapp.autopilot.diagnosis import Light, Line
from flightapp.autopilot.telemetry import Identity
from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.messages import AutopilotStatus

VEHICLE, TELEMETRY, CONFIGURATION = "vehicle", "telemetry", "configuration"
KNOWN_VERSIONS = ((1, 16), (1, 17))
"""Releases between which all that the application relies on was measured."""
RATE_SHARE = 0.8
"""Of a rate that was asked for, less of it is worth a look."""
SLOW_TRIP = 0.02
"""s; a wired link takes under 1 ms, and a body rate that comes this late is felt."""
LOW_BATTERY = 0.3
VISION_RATES = (30.0, 50.0)
"""Hz at which EKF2 takes external vision well."""
HEADER = 12
SETPOINT = 39 + HEADER
POSES = {"odometry": 233 + HEADER, "odometry_frd": 233 + HEADER, "position": 117 + HEADER}
"""Bytes of a MAVLink 2 frame: SET_ATTITUDE_TARGET; ODOMETRY and VISION_POSITION_ESTIMATE."""
BITS = 10
"""On a serial line, per byte: start bit, eight, stop bit."""
FULL_LINE = 0.7


def unconnected(config: Config, why: str) -> Line:
    """Nobody there."""
    mend = (
        "look at power, wiring and the telemetry port's settings (MAV_0_CONFIG, its baud rate); link.connection and"
        " link.system_id must be the vehicle's"
    )
    return Line(VEHICLE, "link", Light.RED, why, config.link.connection, mend)


def identity(told: Identity | None, config: Config) -> Line:
    """Which autopilot, and whether its version is one that is known."""
    wanted = "PX4 " + " to ".join(f"v{major}.{minor}" for major, minor in KNOWN_VERSIONS)
    if told is None or not told.version:
        return Line(VEHICLE, "autopilot", Light.AMBER, "version not told", wanted, "ask again; else look at the link")
    found = f"system {told.system_id}, version {told.version}" + (f" ({told.git})" if told.git else "")
    numbers = re.match(r"(\d+)\.(\d+)", told.version)
    version = (int(numbers[1]), int(numbers[2])) if numbers else None
    if version is None or version < KNOWN_VERSIONS[0]:
        mend = "install PX4 v1.16; older ones were never flown with this"
        return Line(VEHICLE, "autopilot", Light.AMBER, found, wanted, mend)
    if version > KNOWN_VERSIONS[1]:
        mend = "newer than what was flown: fly it in PX4's simulation first"
        return Line(VEHICLE, "autopilot", Light.AMBER, found, wanted, mend)
    if told.system_id != config.link.system_id:
        mend = "set link.system_id to the vehicle that is meant"
        return Line(VEHICLE, "autopilot", Light.RED, found, f"system {config.link.system_id}", mend)
    return Line(VEHICLE, "autopilot", Light.GREEN, found, wanted)


def streams(rates: Mapping[str, float], config: Config) -> tuple[Line, ...]:
    """Rates that are reached against those that flying takes, Hz.

    PX4 sends mode, landed state and battery when they change, and seldom else, whatever rate is asked for.
    """
    wanted = {
        "HEARTBEAT": 1.0,
        "CURRENT_MODE": 1.0,
        "EXTENDED_SYS_STATE": 1.0,
        "BATTERY_STATUS": 0.5,
        "ODOMETRY": config.link.odometry_rate,
        "HIGHRES_IMU": config.link.imu_rate,
    }
    return tuple(_stream(name, rates.get(name, 0.0), rate) for name, rate in wanted.items())


def _stream(name: str, rate: float, wanted: float) -> Line:
    found, target = f"{rate:.1f} Hz", f"{wanted:g} Hz"
    if rate >= RATE_SHARE * wanted:
        return Line(TELEMETRY, name, Light.GREEN, found, target)
    if rate > 0.0:
        mend = "raise the link's baud rate and MAV_0_RATE; is another program asking for streams?"
        return Line(TELEMETRY, name, Light.AMBER, found, target, mend)
    if name == "HEARTBEAT":
        return Line(TELEMETRY, name, Light.RED, "none", target, "the link is silent: look at power and wiring")
    mend = "PX4 does not send it on this link: is it a version that has it, and a link that takes requests?"
    if name == "ODOMETRY":
        mend = "it begins with EKF2's first attitude; " + mend
    return Line(TELEMETRY, name, Light.AMBER, "none", target, mend)


def round_trip(trip: RoundTrip | None) -> Line:
    """How long the autopilot takes to answer."""
    wanted = f"p50 under {1e3 * SLOW_TRIP:g} ms"
    if trip is None:
        return Line(TELEMETRY, "round trip", Light.AMBER, "no answer", wanted, "PX4 must answer TIMESYNC on this link")
    found = f"p50 {1e3 * trip.p50:.1f} ms, longest {1e3 * trip.longest:.1f} ms, {trip.count} answers"
    if trip.p50 < SLOW_TRIP:
        return Line(TELEMETRY, "round trip", Light.GREEN, found, wanted)
    return Line(TELEMETRY, "round trip", Light.AMBER, found, wanted, "use a wired link: UART at 921600 baud, Ethernet")


def status(told: AutopilotStatus | None, now: float, config: Config) -> tuple[Line, ...]:
    """What the autopilot says of itself, at ``now`` of the clock that stamps it."""
    if told is None or not now - told.stamp < config.link.lost_after:
        found = "nothing" if told is None else f"silent for {now - told.stamp:.1f} s"
        return (
            Line(VEHICLE, "state", Light.RED, found, "a heartbeat", "the link is silent: look at power and wiring"),
        )
    return (_state(told), _ready(told), _battery(told))


def _state(told: AutopilotStatus) -> Line:
    found = f"{'armed' if told.armed else 'disarmed'}, {'landed' if told.landed else 'in the air'}, mode {told.mode}"
    if told.armed:
        return Line(VEHICLE, "state", Light.AMBER, found, "disarmed, landed", "disarm it; nobody is to be near")
    if not told.landed:
        mend = "put it down: PX4 must know that it stands"
        return Line(VEHICLE, "state", Light.AMBER, found, "disarmed, landed", mend)
    return Line(VEHICLE, "state", Light.GREEN, found, "disarmed, landed")


def _ready(told: AutopilotStatus) -> Line:
    if told.ready:
        return Line(VEHICLE, "local position", Light.GREEN, "valid", "valid")
    mend = "comes while a flight sends the tracker's poses; it must come before arming"
    return Line(VEHICLE, "local position", Light.AMBER, "none yet", "valid", mend)


def _battery(told: AutopilotStatus) -> Line:
    volts = f"{told.voltage:.2f} V" if math.isfinite(told.voltage) else "voltage not told"
    charge = f"{100.0 * told.battery:.0f} %" if math.isfinite(told.battery) else "charge not told"
    found, wanted = f"{volts}, {charge}", f"more than {100.0 * LOW_BATTERY:g} %"
    if not (math.isfinite(told.voltage) and math.isfinite(told.battery)):
        return Line(
            VEHICLE, "battery", Light.AMBER, found, wanted, "set up PX4's power module (BAT1_SOURCE, BAT1_N_CELLS)"
        )
    if told.battery < LOW_BATTERY:
        return Line(VEHICLE, "battery", Light.AMBER, found, wanted, "charge it")
    return Line(VEHICLE, "battery", Light.GREEN, found, wanted)


def consistency(config: Config) -> tuple[Line, ...]:
    """What is allowed by itself but doesn't go together."""
    return (_thrust(config), _vision(config), _line(config), _loss(config))


def _thrust(config: Config) -> Line:
    """Whether full throttle can give what plans use: thrust at hover over full thrust bounds thrust over weight."""
    vehicle = config.vehicle
    hover = vehicle.hover_thrust * (vehicle.thrust_curve * vehicle.hover_thrust + 1.0 - vehicle.thrust_curve)
    found = f"vehicle.thrust_to_weight {vehicle.thrust_to_weight:g}"
    wanted = f"at most {1.0 / hover:.2f} by vehicle.hover_thrust {vehicle.hover_thrust:g}"
    if vehicle.thrust_to_weight * hover <= 1.05:
        return Line(CONFIGURATION, "thrust", Light.GREEN, found, wanted)
    return Line(CONFIGURATION, "thrust", Light.RED, found, wanted, "identify both on the vehicle: plans count on it")


def _vision(config: Config) -> Line:
    low, high = VISION_RATES
    found, wanted = f"external_vision.rate {config.external_vision.rate:g} Hz", f"{low:g} to {high:g} Hz"
    if low <= config.external_vision.rate <= high:
        return Line(CONFIGURATION, "external vision", Light.GREEN, found, wanted)
    mend = "EKF2 was measured with rates in between"
    return Line(CONFIGURATION, "external vision", Light.AMBER, found, wanted, mend)


def _line(config: Config) -> Line:
    """Whether commands and poses fit the link."""
    name, link = "bandwidth", config.link.connection
    vision = config.external_vision
    needed = BITS * (config.control.rate * SETPOINT + vision.rate * POSES[vision.message])
    wanted = f"{needed / 1e3:.0f} kbit/s up"
    try:
        connection = parse_connection(link)
    except BadInputError as error:
        return Line(CONFIGURATION, name, Light.RED, str(error), wanted, "mend link.connection")
    if connection.device is None:
        return Line(CONFIGURATION, name, Light.GREEN, "network", wanted)
    share = needed / connection.number
    found = f"{connection.number} baud"
    if share < FULL_LINE:
        return Line(CONFIGURATION, name, Light.GREEN, found, wanted)
    mend = "raise the baud rate here and on the autopilot (SER_TEL2_BAUD) to 921600"
    return Line(CONFIGURATION, name, Light.RED if share >= 1.0 else Light.AMBER, found, wanted, mend)


def _loss(config: Config) -> Line:
    link = config.link
    heard = link.lost_after * link.odometry_rate
    found, wanted = f"link.lost_after {link.lost_after:g} s, {heard:.0f} messages", "10 messages or more"
    if heard >= 10.0:
        return Line(CONFIGURATION, "link loss", Light.GREEN, found, wanted)
    mend = "raise link.lost_after or link.odometry_rate: a few lost datagrams must not end a flight"
    return Line(CONFIGURATION, "link loss", Light.AMBER, found, wanted, mend)
