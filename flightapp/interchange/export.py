"""A flight in the formats of other programs."""

from enum import StrEnum
from pathlib import Path

from flightapp.inputs import BadInputError
from flightapp.interchange.bag_writer import write_bag
from flightapp.interchange.extra import load
from flightapp.interchange.sources import read_any_flight
from flightapp.interchange.text_files import write_csv, write_tum


class Format(StrEnum):
    """What can be written."""

    CSV = "csv"
    TUM = "tum"
    ROSBAG2 = "rosbag2"


def export(run: Path, form: Format, out: Path | None) -> Path:
    """Write the flight in ``run`` to the new directory ``out`` (in or beside the run, if None); the directory.

    Raises `BadInputError`, also where ``out`` has something in it.
    """
    flight = read_any_flight(run)
    if form is Format.ROSBAG2:
        load("rosbags", "writing a ROS 2 bag")
    directory = out or (run if run.is_dir() else run.parent) / form.value
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise BadInputError(f"--out {directory}: exists; name a new directory")
    try:
        if form is Format.ROSBAG2:
            if directory.exists():
                directory.rmdir()
            write_bag(flight, directory)
        else:
            directory.mkdir(parents=True, exist_ok=True)
            (write_csv if form is Format.CSV else write_tum)(flight, directory)
    except OSError as error:
        raise BadInputError(f"--out {directory}: cannot be written: {error.strerror or error}") from None
    return directory
