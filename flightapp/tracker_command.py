"""Finding a tracker's mount from files."""

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from flightapp.calibration.tracker_mount import Felt, Tracked, TrackerFound, find_tracker
from flightapp.config import Sensors
from flightapp.evaluation.flight import Flight
from flightapp.frames import Vector
from flightapp.inputs import BadInputError, validate
from flightapp.recording.reader import read_flight
from flightapp.results import log_of
from flightapp.sensors.pose_files import read_poses, read_turning


@dataclass(frozen=True, slots=True)
class TrackerAnswer:
    """What was found, and what had been taken out of the poses when they were recorded."""

    found: TrackerFound
    before: Sensors

    @property
    def R_bt(self) -> Vector:  # noqa: N802
        """(3, 3) the tracker's axes to the body's, with what had been taken out."""
        rotation: Vector = self.found.R_bt @ _mount(self.before).as_matrix()
        return rotation

    @property
    def position(self) -> list[float] | None:
        """m, the tracker in the body frame, with what had been taken out; None where it is not known."""
        if self.found.place is None or self.found.place_shortfall:
            return None
        return [float(value) for value in self.found.place + self.found.R_bt @ np.array(self.before.mount_position)]

    @property
    def settings(self) -> dict[str, Any]:
        """As the sensors section has them."""
        yaw, pitch, roll = Rotation.from_matrix(self.R_bt).as_euler("ZYX", degrees=True)
        settings: dict[str, Any] = {"mount_rpy_deg": [round(float(angle), 3) for angle in (roll, pitch, yaw)]}
        if (position := self.position) is not None:
            settings["mount_position"] = [round(value, 4) for value in position]
        return settings


def _mount(sensors: Sensors) -> Rotation:
    return Rotation.from_euler("ZYX", sensors.mount_rpy_deg[::-1], degrees=True)


def calibrate_tracker(path: Path, against: Path | None = None) -> TrackerAnswer:
    """The mount of the tracker whose poses are in ``path``; against the gyroscope in ``against``, or the log's own.

    Raises `BadInputError`.
    """
    file = log_of(path)
    recording = read_poses(file)
    flight = read_flight(file) if recording.of_body else Flight()
    before = _configured(file, flight) if recording.of_body else Sensors()
    felt = _felt(file, flight, against)
    poses = recording.poses
    tracked = Tracked(poses.stamp, poses.orientation, poses.velocity, poses.angular_velocity)
    try:
        return TrackerAnswer(find_tracker(tracked, felt), before)
    except BadInputError as error:
        raise BadInputError(f"{path}: no mount can be told: {error}") from None


def _felt(path: Path, flight: Flight, against: Path | None) -> Felt:
    if against is not None and against.suffix != ".mcap":
        stamp, turning = read_turning(against)
        return Felt(stamp, turning, None)
    source, other = (path, flight) if against is None else (against, read_flight(against))
    if not other.imu.stamp.size:
        raise BadInputError(f"{source}: the autopilot's inertial sensors are not in it; give --against FILE")
    return Felt(other.imu.stamp, other.imu.angular_velocity, other.imu.specific_force)


def _configured(path: Path, flight: Flight) -> Sensors:
    try:
        told = tomllib.loads(flight.header.get("config", "")).get("sensors", {})
    except tomllib.TOMLDecodeError as error:
        raise BadInputError(f"{path}: its configuration cannot be read: {error}") from None
    sensors = validate(Sensors, told, str(path))
    if sensors.poses == "autopilot":
        raise BadInputError(f"{path}: the poses are the autopilot's own (sensors.poses): there is no tracker to mount")
    return sensors


def tracker_json(answer: TrackerAnswer) -> dict[str, Any]:
    """``answer`` for other programs; SI units but the angles of the settings."""
    found = answer.found
    return {
        "settings": answer.settings,
        "rotation_deviation": found.rotation_deviation.tolist(),
        "place_deviation": None if found.place_deviation is None else found.place_deviation.tolist(),
        "late": found.late,
        "late_deviation": found.late_deviation,
        "shortfalls": list(found.shortfalls),
        "place_shortfall": found.place_shortfall,
    }


def tracker_lines(answer: TrackerAnswer) -> tuple[str, ...]:
    """``answer`` in words."""
    found = answer.found
    angles = ", ".join(f"{math.degrees(value):.2f}" for value in found.rotation_deviation)
    off = math.degrees(Rotation.from_matrix(found.R_bt).magnitude())
    lines = [f"the tracker is turned by {off:.2f}° from what was configured; standard deviations {angles}°"]
    if found.place_shortfall:
        lines.append(f"where it sits cannot be told: {found.place_shortfall}")
    elif found.place_deviation is not None:
        places = ", ".join(f"{1e3 * value:.1f}" for value in found.place_deviation)
        lines.append(f"where it sits: standard deviations {places} mm")
    lines += [f"set sensors.{key} = {value}" for key, value in answer.settings.items()]
    if abs(found.late) > 2.0 * found.late_deviation:
        late, error, delay = 1e3 * found.late, 1e3 * found.late_deviation, answer.before.delay + found.late
        lines.append(f"its stamps are {late:.1f} ms ± {error:.1f} ms late: set sensors.delay = {delay:.4f}")
    return (*lines, *(f"not to be relied on: {text}" for text in found.shortfalls))
