"""MAVSDK's library: opened on one connection, its own log kept off the terminal."""

from collections import deque

import mavsdk.logging
from mavsdk.exceptions import ConnectionError as MavsdkConnectionError
from mavsdk.logging import LogLevel
from mavsdk.mavsdk import Configuration, Mavsdk

from flightapp.autopilot.connection import check_device, parse_connection
from flightapp.inputs import BadInputError

ONBOARD_COMPUTER = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""


def open_library(url: str, system_id: int) -> Mavsdk:
    """MAVSDK, listening on ``url`` only, as a component of the vehicle ``system_id``.

    Raises `BadInputError` where the connection is none or can't be opened.
    """
    connection = parse_connection(url)
    check_device(connection)
    complaints: deque[str] = deque(maxlen=1)

    def logged(level: LogLevel, text: str, _file: str | None, _line: int) -> bool:
        if level >= LogLevel.WARN:
            complaints.append(text)
        return True

    mavsdk.logging.log_subscribe(logged)
    library = Mavsdk(Configuration.create_manual(system_id, ONBOARD_COMPUTER, True))
    try:
        library.add_any_connection_with_handle(url)
    except MavsdkConnectionError as error:
        library.destroy()
        why = complaints[-1] if complaints else str(error)
        mend = ""
        if "in use" in why:
            mend = "; another program has this port: end it, or choose another with --set link.connection=udpin://…"
        raise BadInputError(f"link.connection = '{url}' cannot be opened: {why}{mend}") from None
    return library
