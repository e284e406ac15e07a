"""PX4's telemetry as the application's own messages; pure, from MAVLink fields as dictionaries."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flightapp.autopilot.modes import flight_mode
from flightapp.autopilot.vision import LOCAL_FRD, NED
from flightapp.frames import Vector, flip_yz, quat_normalize, quat_rotate
from flightapp.messages import AutopilotStatus, FlightMode, ImuSample, PoseSample

Fields = Mapping[str, Any]

ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED."""
HEARD_PERIOD = 0.1
"""s, least time between two statuses that differ in their stamp only."""
POSITION_KEPT = 1.0
"""s that a local position counts: PX4 tells it only while it has one."""
PROBATION = 1.2
"""s that it must have been there: PX4 trusts it only after 1 s (checkPosVelValidity in estimatorCheck.cpp)."""
ON_GROUND = 1
"""MAV_LANDED_STATE_ON_GROUND."""
POOR, GOOD = 1, 3
"""Confidence of a pose, as the trackers report it."""


class StatusBoard:
    """Puts together what several messages say of the autopilot.

    Each method takes one message's fields and returns the status as it then stands, or None where the message said
    nothing new. PX4 tells its arming state once a second and other things when they change, so a status is as old as
    the last message of any kind: its stamp says when the autopilot was heard.
    """

    def __init__(self) -> None:
        self._status: AutopilotStatus | None = None
        self._landed = True
        self._positioned = self._positioned_since = -math.inf
        self._mode_told = -math.inf
        self._voltage = self._battery = math.nan

    def heard(self, stamp: float) -> AutopilotStatus | None:
        """Any message came at ``stamp``."""
        if self._status is None or stamp - self._status.stamp < HEARD_PERIOD:
            return None
        self._status = replace(self._status, stamp=stamp, ready=self._ready(stamp))
        return self._status

    def heartbeat(self, stamp: float, fields: Fields) -> AutopilotStatus | None:
        """HEARTBEAT: mode and arming state."""
        mode, armed = flight_mode(int(fields["custom_mode"])), bool(int(fields["base_mode"]) & ARMED)
        self._mode_told = stamp
        ready = self._ready(stamp)
        self._status = AutopilotStatus(stamp, mode, armed, self._landed, ready, self._voltage, self._battery)
        return self._status

    def current_mode(self, stamp: float, fields: Fields) -> AutopilotStatus | None:
        """CURRENT_MODE, which PX4 sends when the mode changes; one that a newer HEARTBEAT overtook says nothing."""
        if stamp < self._mode_told:
            return None
        self._mode_told = stamp
        return self._changed(mode=flight_mode(int(fields["custom_mode"])))

    def landed(self, fields: Fields) -> AutopilotStatus | None:
        """EXTENDED_SYS_STATE."""
        self._landed = int(fields["landed_state"]) in (0, ON_GROUND)
        return self._changed(landed=self._landed)

    def local_position(self, stamp: float) -> AutopilotStatus | None:
        """LOCAL_POSITION_NED came at ``stamp``: there is a position to fly by."""
        if stamp - self._positioned > POSITION_KEPT:
            self._positioned_since = stamp
        self._positioned = stamp
        return self._changed(ready=self._ready(stamp))

    def _ready(self, stamp: float) -> bool:
        return stamp - self._positioned <= POSITION_KEPT and stamp - self._positioned_since >= PROBATION

    def battery(self, fields: Fields) -> AutopilotStatus | None:
        """BATTERY_STATUS; unknown values become NaN."""
        cells = [v for v in (fields.get("voltages") or []) if 0 < v < 65535]
        remaining = number(fields.get("battery_remaining"))
        self._voltage = 1e-3 * sum(cells) if cells else math.nan
        self._battery = 0.01 * remaining if 0.0 <= remaining <= 100.0 else math.nan
        return self._changed(voltage=self._voltage, battery=self._battery)

    def _changed(self, **changes: FlightMode | bool | float) -> AutopilotStatus | None:
        before = self._status
        if before is None:
            return None
        self._status = replace(before, **changes)  # type: ignore[arg-type]
        return self._status if self._status != before else None


def number(value: Any) -> float:
    """``value`` as a float; NaN for null, text and what else is no number."""
    return float(value) if isinstance(value, int | float) else math.nan


def odometry(stamp: float, fields: Fields) -> PoseSample | None:
    """PX4's own estimate from ODOMETRY, in its local frame turned to x ahead (its north), y left, z up.

    ``stamp`` is the time of the estimate by our clock. PX4 gives the velocity in the frame that child_frame_id names:
    NED or body. Its resets are epochs. None where anything is not finite, or the frames are others.
    """
    position, velocity = _vector(fields, "x", "y", "z"), _vector(fields, "vx", "vy", "vz")
    rates = _vector(fields, "rollspeed", "pitchspeed", "yawspeed")
    q = np.array([number(v) for v in fields["q"]])
    if fields["frame_id"] not in (NED, LOCAL_FRD) or q.shape != (4,):
        return None
    if not np.isfinite(np.concatenate((position, velocity, rates, q))).all():
        return None
    orientation = quat_normalize(q * (1.0, 1.0, -1.0, -1.0))
    if fields["child_frame_id"] not in (NED, LOCAL_FRD):
        velocity = quat_rotate(orientation, velocity)
    confidence = GOOD if fields.get("quality", 0) >= 0 else POOR
    resets = int(fields.get("reset_counter") or 0)
    return PoseSample(stamp, position, orientation, velocity, rates, confidence, None, resets)


def inertial(stamp: float, fields: Fields) -> ImuSample | None:
    """Accelerometer and gyroscope from HIGHRES_IMU, measured at ``stamp``; None where anything is not finite."""
    force = _vector(fields, "xacc", "yacc", "zacc")
    rates = _vector(fields, "xgyro", "ygyro", "zgyro")
    if not np.isfinite(np.concatenate((force, rates))).all():
        return None
    return ImuSample(stamp, force, rates)


def _vector(fields: Fields, *names: str) -> Vector:
    """Three fields of an FRD or NED vector as FLU."""
    return flip_yz(np.array([number(fields[name]) for name in names]))


@dataclass(frozen=True, slots=True)
class Identity:
    """Which vehicle it is."""

    system_id: int
    version: str
    """PX4's release, such as 1.16.1; empty when it didn't say."""
    git: str
    """First digits of the commit it was built from."""
    uid: str


def identity(system_id: int, fields: Fields) -> Identity:
    """From AUTOPILOT_VERSION."""
    packed = int(fields["flight_sw_version"])
    version = ".".join(str(packed >> shift & 0xFF) for shift in (24, 16, 8)) if packed else ""
    git = bytes(int(v) for v in fields.get("flight_custom_version") or [])[::-1].hex()
    return Identity(system_id, version, git, f"{int(fields.get('uid') or 0):x}")
