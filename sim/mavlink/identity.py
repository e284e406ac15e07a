"""Who the vehicle says it is."""

from sim.mavlink.codec import encode, named

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
VERSION = (1, 16, 1)
"""PX4's release that is modelled."""
_OFFICIAL = 0xFF
"""FIRMWARE_VERSION_TYPE_OFFICIAL."""
_CAPABILITIES = 1 | 2 | 4 | 8 | 16 | 64 | 128 | 2048 | 8192
"""MAV_PROTOCOL_CAPABILITY: missions, byte-wise parameters, COMMAND_INT, offboard, MAVLink 2; no FTP."""
_MAVLINK = 200
"""MAVLink 2.0 in hundredths."""


def autopilot_version(system: int) -> bytes:
    """AUTOPILOT_VERSION."""
    major, minor, patch = VERSION
    packed = major << 24 | minor << 16 | patch << 8 | _OFFICIAL
    return encode(
        named("AUTOPILOT_VERSION"),
        capabilities=_CAPABILITIES,
        flight_sw_version=packed,
        middleware_sw_version=packed,
        vendor_id=0x26AC,
        uid=0x5CA1AB1E0000 + system,
    )


def protocol_version() -> bytes:
    """PROTOCOL_VERSION."""
    return encode(named("PROTOCOL_VERSION"), version=_MAVLINK, min_version=100, max_version=_MAVLINK)
