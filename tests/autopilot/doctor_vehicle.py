"""A vehicle for a doctor, without a link: parameters, telemetry, and what can be wrong with them."""

import asyncio
import math

from flightapp.autopilot.clock import RoundTrip
from flightapp.autopilot.parameter_store import ParameterMissingError
from flightapp.autopilot.parameters import Kind
from flightapp.autopilot.telemetry import Identity
from flightapp.autopilot.wanted_parameters import Profile, wanted_parameters
from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus, FlightMode

RATES = {
    "HEARTBEAT": 1.0,
    "CURRENT_MODE": 2.0,
    "EXTENDED_SYS_STATE": 2.0,
    "BATTERY_STATUS": 2.0,
    "ODOMETRY": 50.0,
    "HIGHRES_IMU": 246.0,
}
BY_HAND = {"BAT1_N_CELLS": 4, "RC_MAP_KILL_SW": 6, "RC_MAP_FLTMODE": 5}
"""Good values of what no table can know."""


def good_values(config=None, profile=Profile.CAGE):
    """Every wanted parameter at a value that is right."""
    values = {}
    for parameter in wanted_parameters(config or Config(), profile):
        value = parameter.wanted.mended(None)
        value = BY_HAND.get(parameter.name, 0) if value is None else value
        values[parameter.name] = int(value) if parameter.kind is Kind.INT else float(value)
    return values


class FakeVehicle:
    """A `doctor.DoctorLink`, and its own parameters; good in every respect, until a test spoils it."""

    def __init__(self, values=None):
        self.values = good_values() if values is None else values
        self.status = Topic("status")
        self.identity = Identity(1, "1.16.1", "c0ffee", "1")
        self.round_trip = RoundTrip(6, 0.0006, 0.0011)
        self.streams = dict(RATES)
        self.state = {"armed": False, "landed": True, "ready": True, "voltage": 16.1, "battery": 0.9}
        self.age = 0.01
        self.silent = False
        self.refuse_connection = ""
        self.refuse_writing = set()
        self.arms_after = math.inf
        self.read_names, self.written, self.closed = [], [], False

    @property
    def parameters(self):
        return self

    def rates(self):
        return {} if self.silent else self.streams

    async def connect(self):
        if self.refuse_connection:
            raise AutopilotError(self.refuse_connection)
        self.tell()

    def tell(self, **changes):
        self.state |= changes
        stamp = asyncio.get_running_loop().time() - self.age
        self.status.publish(AutopilotStatus(stamp, FlightMode.HOLD, **self.state))

    async def read(self, name):
        self.read_names.append(name)
        if self.silent or name not in self.values:
            raise ParameterMissingError(f"parameter {name} could not be read")
        return self.values[name]

    async def write(self, name, value):
        if self.silent or name in self.refuse_writing:
            raise AutopilotError(f"parameter {name} could not be set")
        self.written.append((name, value))
        self.values[name] = value
        if len(self.written) >= self.arms_after:
            self.tell(armed=True)

    async def close(self):
        self.closed = True
