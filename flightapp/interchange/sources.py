"""Whatever was recorded, as paths or as a flight."""

from collections.abc import Mapping
from pathlib import Path

from flightapp.evaluation.flight import Flight
from flightapp.evaluation.paths import TimedPath, path_of
from flightapp.evaluation.rotations import from_yaw
from flightapp.inputs import BadInputError
from flightapp.interchange.rosbag import bag_paths, is_bag
from flightapp.interchange.ulog import read_ulog, ulog_paths
from flightapp.recording.reader import mcap_profile, read_flight
from flightapp.recording.writer import PROFILE
from flightapp.sensors.pose_files import SUFFIXES as POSE_SUFFIXES
from flightapp.sensors.pose_files import read_poses

LOG = "flight.mcap"
KNOWN = "a run directory, flight.mcap, .ulg, .csv, .txt, .tum, or a ROS 2 bag"
BAG_SUFFIXES = (".db3",)


def read_any_flight(path: Path) -> Flight:
    """The flight in ``path``: a run directory, a flight log or a ULog; raises `BadInputError`."""
    if path.suffix == ".ulg":
        return read_ulog(path)
    return read_flight(path / LOG if path.is_dir() else path)


def paths_in(path: Path) -> Mapping[str, TimedPath]:
    """Every path that is recorded in ``path``, by topic; raises `BadInputError`.

    A run of this application has "truth", "state", "pose" and "setpoint"; a file of poses has "poses".
    """
    if not path.exists():
        raise BadInputError(f"{path}: there is no such file; compared are {KNOWN}")
    if path.suffix == ".ulg":
        return ulog_paths(path)
    if is_bag(path) or path.suffix in BAG_SUFFIXES or _is_foreign_mcap(path):
        return bag_paths(path)
    if path.is_dir() or path.suffix == ".mcap":
        return flight_paths(read_any_flight(path))
    if path.suffix in POSE_SUFFIXES:
        return {"poses": path_of("poses", read_poses(path).poses)}
    raise BadInputError(f"{path}: not known by its name; compared are {KNOWN}")


def read_path(spec: str) -> TimedPath:
    """The path that ``spec`` names: FILE that has but one, or FILE:TOPIC; raises `BadInputError` that lists them."""
    file, topic = _split(spec)
    paths = paths_in(file)
    found = {name: path for name, path in paths.items() if path.stamp.size}
    if not found:
        raise BadInputError(f"{file}: holds no path")
    listed = ", ".join(f"{name} ({path.stamp.size} poses)" for name, path in sorted(found.items()))
    if topic is None:
        if len(found) > 1:
            raise BadInputError(f"{file}: holds several paths; say which, as {file}:TOPIC, of {listed}")
        topic = next(iter(found))
    if topic not in found:
        raise BadInputError(f"{file}: has no path '{topic}'; there are {listed}")
    path = found[topic]
    return TimedPath(spec, path.stamp, path.position, path.orientation)


def flight_paths(flight: Flight) -> dict[str, TimedPath]:
    """The paths of a flight by topic; a reference's orientation is its yaw, level."""
    setpoint = path_of("setpoint", flight.setpoints)
    if setpoint.stamp.size == flight.setpoints.yaw.size:
        level = from_yaw(flight.setpoints.yaw)
        setpoint = TimedPath("setpoint", setpoint.stamp, setpoint.position, level)
    streams = {"truth": flight.truth, "state": flight.states, "pose": flight.poses}
    return {**{name: path_of(name, motion) for name, motion in streams.items()}, "setpoint": setpoint}


def _split(spec: str) -> tuple[Path, str | None]:
    """File and topic, at the first colon behind which the rest is no part of the file's name."""
    position = -1
    while (position := spec.find(":", position + 1)) >= 0:
        if Path(spec[:position]).exists():
            return Path(spec[:position]), spec[position + 1 :]
    return Path(spec), None


def _is_foreign_mcap(path: Path) -> bool:
    """Whether ``path`` is an MCAP file of another program, which ROS 2 may have written."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    profile = mcap_profile(path)
    return profile is not None and profile.partition("/")[0] != PROFILE.partition("/")[0]
