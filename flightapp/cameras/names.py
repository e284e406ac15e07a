"""What the configuration calls a camera, and which cameras there are."""

import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from flightapp.inputs import BadInputError

HOW = (
    "give /dev/videoN, csi:N (Jetson), a URL such as http://HOST/stream, a directory of images, a video file, or a"
    " flight log (.mcap)"
)
SYSFS = Path("/sys/class/video4linux")
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff", ".webp")
_DEVICE = re.compile(r"/dev/\S+")
_CSI = re.compile(r"csi:(\d)")
_URL = re.compile(r"(https?|rtsp|udp|tcp)://\S+")


class Kind(Enum):
    """What a source is."""

    V4L2 = "a video device"
    CSI = "a Jetson's camera"
    URL = "a stream"
    IMAGES = "a directory of images"
    VIDEO = "a video file"
    LOG = "a flight log"

    @property
    def live(self) -> bool:
        """Whether it films now; else it is a recording."""
        return self in (Kind.V4L2, Kind.CSI, Kind.URL)


@dataclass(frozen=True, slots=True)
class Source:
    """A camera or a recording."""

    text: str
    kind: Kind


def parse_source(text: str) -> Source:
    """What ``text`` names; raises `BadInputError` for a file that is not there or a form that is none."""
    if _CSI.fullmatch(text):
        return Source(text, Kind.CSI)
    if _URL.fullmatch(text):
        return Source(text, Kind.URL)
    if _DEVICE.fullmatch(text):
        return Source(text, Kind.V4L2)
    path = Path(text)
    if path.is_dir():
        return Source(text, Kind.LOG if (path / "flight.mcap").exists() else Kind.IMAGES)
    if path.is_file():
        return Source(text, Kind.LOG if path.suffix == ".mcap" else Kind.VIDEO)
    raise BadInputError(f"camera '{text}': there is no such file or directory, and it is no camera's name; {HOW}")


def video_devices(sysfs: Path = SYSFS) -> tuple[str, ...]:
    """The video devices of this computer, each with the name that its driver gives it."""
    found = []
    for entry in sorted(sysfs.glob("video*"), key=lambda path: (len(path.name), path.name)):
        try:
            name = (entry / "name").read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            name = "?"
        found.append(f"/dev/{entry.name} ({name})")
    return tuple(found)


def what_there_is(sysfs: Path = SYSFS) -> str:
    """The same in words."""
    devices = video_devices(sysfs)
    return f"there are {', '.join(devices)}" if devices else "there is no video device on this computer"
