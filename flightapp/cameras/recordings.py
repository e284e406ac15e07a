"""Recorded images: directories, video files and flight logs, one after the other in the order of their stamps.

A directory is EuRoC's (https://projects.asl.ethz.ch/datasets/euroc-mav): `data.csv` with stamps in nanoseconds and the
names of files in `data/`; or one with images and, where there are, stamps in the same form in `timestamps.csv`. Without
them images are taken to follow each other at the camera's rate, as those of a video file are that tells no times.
"""

import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from flightapp.cameras.names import IMAGES, Kind, Source
from flightapp.inputs import BadInputError
from flightapp.interchange.sources import LOG
from flightapp.messages import Frame
from flightapp.recording.reader import read_flight

NANOSECONDS = 1e-9
STAMPS = ("data.csv", "timestamps.csv")


def recorded_frames(source: Source, rate: float) -> Iterator[Frame]:
    """The frames of a recording, grey, contiguous, with ascending stamps as they were recorded.

    ``rate`` (Hz) is taken for images without stamps. Raises `BadInputError`, also while it is read.
    """
    if source.kind is Kind.LOG:
        return _ascending(source.text, _of_log(Path(source.text)))
    if source.kind is Kind.VIDEO:
        return _ascending(source.text, _of_video(Path(source.text), rate))
    return _ascending(source.text, _of_directory(Path(source.text), rate))


def _ascending(name: str, frames: Iterator[Frame]) -> Iterator[Frame]:
    last, count = float("-inf"), 0
    for frame in frames:
        if not frame.stamp > last:
            raise BadInputError(f"{name}: image {count + 1} is stamped {frame.stamp:.6f} s, not after the one before")
        last, count = frame.stamp, count + 1
        yield frame
    if not count:
        raise BadInputError(f"{name}: there are no images in it")


def _of_log(path: Path) -> Iterator[Frame]:
    log = path / LOG if path.is_dir() else path
    pictures = read_flight(log).pictures
    if not pictures:
        raise BadInputError(f"{log}: the flight log has no images; fly with recording.images = true")
    for i, shown in enumerate(pictures):
        image = cv2.imdecode(np.frombuffer(shown.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise BadInputError(f"{log}: image {i + 1} is damaged")
        yield Frame(shown.stamp, i, np.ascontiguousarray(image, np.uint8))


def _of_video(path: Path, rate: float) -> Iterator[Frame]:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise BadInputError(f"{path}: is no video that FFmpeg can read")
        told = capture.get(cv2.CAP_PROP_FPS)
        period = 1.0 / (told if 0.5 < told < 1000.0 else rate)
        for i in itertools.count():
            ok, image = capture.read()
            if not ok:
                return
            stamp = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC)
            grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
            yield Frame(stamp if stamp > 0.0 else i * period, i, np.ascontiguousarray(grey, np.uint8))
    finally:
        capture.release()


def _of_directory(path: Path, rate: float) -> Iterator[Frame]:
    for i, (stamp, file) in enumerate(_listed(path, rate)):
        if not file.is_file():
            raise BadInputError(f"{file}: there is no such image, though {path} lists it")
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise BadInputError(f"{file}: is no image that can be read")
        yield Frame(stamp, i, np.ascontiguousarray(image, np.uint8))


def _listed(path: Path, rate: float) -> list[tuple[float, Path]]:
    """Stamps (s) and files of the images in a directory."""
    table = next((path / name for name in STAMPS if (path / name).is_file()), None)
    folder = path / "data" if (path / "data").is_dir() else path
    if table is None:
        files = sorted((file for file in folder.iterdir() if file.suffix.lower() in IMAGES), key=_natural)
        return [(i / rate, file) for i, file in enumerate(files)]
    try:
        lines = table.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"{table}: cannot be read: {error}") from None
    listed = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        stamp, _, name = (cell.strip() for cell in line.partition(","))
        if not stamp.isdigit() or not name:
            raise BadInputError(f"{table}:{number}: there must be a stamp in nanoseconds, a comma and a file's name")
        listed.append((int(stamp) * NANOSECONDS, folder / name))
    return listed


def _natural(file: Path) -> tuple[tuple[int, int, str], ...]:
    """So that image 10 comes after image 9."""
    parts = re.findall(r"\d+|\D+", file.name)
    return tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts)
