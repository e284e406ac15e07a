"""Finding a tracker's delay from files."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flightapp.evaluation.flight import Flight
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.recording.reader import read_flight
from flightapp.sensors.delay import Delay, find_delay
from flightapp.sensors.pose_files import read_poses, read_turning

RESPONSE = (
    "against the commands that were sent, so the vehicle's own response lag is in it: an upper bound;"
    " a log with the autopilot's IMU, or --against a gyroscope's file, tells the tracker's alone"
)


@dataclass(frozen=True, slots=True)
class FoundDelay:
    """A delay, and what it was found from."""

    found: Delay
    reference: str
    """imu, commands, or the file."""
    configured: float
    """s, the delay that was taken out of the poses when they were recorded."""

    @property
    def setting(self) -> float:
        """s, what sensors.delay should be."""
        return self.configured + self.found.delay


def calibrate_delay(path: Path, against: Path | None = None) -> FoundDelay:
    """The delay of the poses in ``path``; against the turning in ``against``, or in the same flight log.

    Raises `BadInputError`.
    """
    recording = read_poses(path)
    flight = read_flight(path) if recording.of_body else Flight()
    if against is not None:
        reference, (stamp, turning) = str(against), _turning(against)
    elif not recording.of_body:
        raise BadInputError(
            f"{path}: only poses are in it; give --against FILE, with the angular velocity of a gyroscope"
        )
    else:
        reference, stamp, turning = _recorded(path, flight)
    poses = recording.poses
    speed, other = np.linalg.norm(poses.angular_velocity, axis=1), np.linalg.norm(turning, axis=1)
    try:
        found = find_delay(poses.stamp, speed, stamp, other)
    except BadInputError as error:
        raise BadInputError(f"{path}: no delay can be told: {error}") from None
    return FoundDelay(found, reference, _configured(flight))


def _turning(path: Path) -> tuple[Vector, Vector]:
    if path.suffix != ".mcap":
        return read_turning(path)
    _, stamp, turning = _recorded(path, read_flight(path))
    return stamp, turning


def _recorded(path: Path, flight: Flight) -> tuple[str, Vector, Vector]:
    """What else in ``flight`` tells how the vehicle turned."""
    if flight.imu.stamp.size:
        return "imu", flight.imu.stamp, flight.imu.angular_velocity
    if flight.commands.stamp.size:
        return "commands", flight.commands.stamp, flight.commands.rates
    raise BadInputError(
        f"{path}: the flight log has neither the autopilot's IMU nor commands to compare the poses with"
    )


def _configured(flight: Flight) -> float:
    try:
        sensors = tomllib.loads(flight.header.get("config", "")).get("sensors", {})
    except tomllib.TOMLDecodeError:
        return 0.0
    return 0.0 if sensors.get("poses") == "autopilot" else float(sensors.get("delay", 0.0))


def delay_json(result: FoundDelay) -> dict[str, Any]:
    """``result`` for other programs; SI units."""
    found = result.found
    return {
        "delay": found.delay,
        "error": found.error,
        "correlation": found.correlation,
        "duration": found.duration,
        "reference": result.reference,
        "configured": result.configured,
        "setting": result.setting,
        "includes_response": result.reference == "commands",
    }


def delay_lines(result: FoundDelay) -> tuple[str, ...]:
    """``result`` in words."""
    found = result.found
    lines = [
        f"the poses' stamps are late by {1e3 * found.delay:.1f} ms ± {1e3 * found.error:.1f} ms"
        f" (against {result.reference}, {found.duration:.0f} s, correlation {found.correlation:.2f})"
    ]
    if result.configured:
        lines.append(f"{1e3 * result.configured:.1f} ms had been taken out when they were recorded")
    if result.reference == "commands":
        lines.append(RESPONSE)
    else:
        lines.append(f"set sensors.delay = {result.setting:.4f}")
    return tuple(lines)
