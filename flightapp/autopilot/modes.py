"""PX4's flight modes on the wire (px4_custom_mode.h) and as the application knows them."""

from flightapp.messages import FlightMode

AUTO = 4
TAKEOFF = (AUTO, 2)
LOITER = (AUTO, 3)
LAND = (AUTO, 6)
OFFBOARD = (6, 0)
"""Main and sub mode of what the application asks for."""

_MAIN = {
    1: FlightMode.MANUAL,
    2: FlightMode.ALTITUDE,
    3: FlightMode.POSITION,
    5: FlightMode.ACRO,
    6: FlightMode.OFFBOARD,
    7: FlightMode.STABILIZED,
}
_AUTO = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
}


def flight_mode(custom_mode: int) -> FlightMode:
    """The mode that HEARTBEAT's or CURRENT_MODE's ``custom_mode`` stands for."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == AUTO:
        return _AUTO.get(sub, FlightMode.OTHER)
    return _MAIN.get(main, FlightMode.OTHER)
