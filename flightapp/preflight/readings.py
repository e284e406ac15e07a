"""Reads what `computer` judges, from the places where Linux tells it."""

import contextlib
import ctypes
import math
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from numba.core import event

from flightapp.app import choose_modules
from flightapp.config import Config
from flightapp.realtime import RealtimeReport, RealtimeSession
from flightapp.track import Track
from flightapp.warmup import warm_up

ROOT = Path("/")
MEGABYTE = bytes(1 << 20)
WRITTEN = 16
"""MB that are written to see how fast a disk is."""
LIMITS = ("passive", "active", "hot", "critical")
"""Kinds of trip points of a thermal zone."""
SLOWING = re.compile(r"cpu|processor|cpufreq|thermal-cpufreq", re.IGNORECASE)
"""Cooling devices that cool by computing less."""
TIMEX = struct.Struct("=Ixxxx qqqq ixxxx")
"""The beginning of Linux's struct timex on 64 bit: modes, offset, frequency, greatest and estimated error, status."""
TIMEX_SIZE, UNSYNCHRONISED = 256, 0x40
ONE_GATE = Track.model_validate(
    {
        "name": "one gate",
        "start": {"position": (0.0, 0.0, 0.0)},
        "finish": (5.0, 0.0, 1.5),
        "gates": [{"id": 1, "position": (2.0, 0.0, 1.5), "yaw_deg": 0.0, "markers": (0, 1, 2, 3)}],
    }
)
"""What kernels are compiled with: any track does."""


@dataclass(frozen=True, slots=True)
class Speed:
    """How fast the CPUs are, and stay."""

    governors: tuple[str, ...]
    """Of each CPU; none where it is not told."""
    power_mode: str
    """A Jetson's, by nvpmodel; empty elsewhere."""
    hottest: float | None
    """°C, of all sensors."""
    limit: float | None
    """°C, at which the hottest zone slows down; None where it has none."""
    throttled: tuple[str, ...]
    """What slows the CPUs down now."""
    load: float
    """Processes that want a CPU, over the last minute."""
    cpus: int


@dataclass(frozen=True, slots=True)
class Disk:
    """Where logs go."""

    runs: Path
    place: Path
    """The directory of it that is there."""
    free: float
    """bytes."""
    writable: bool
    rate: float | None
    """bytes/s to the disk itself; None where it could not be written."""
    longest: float
    """s for one MB."""


@dataclass(frozen=True, slots=True)
class Clock:
    """The computer's clocks."""

    wall: float
    """s since 1970."""
    synchronised: bool
    error: float
    """s, the wall clock's, as the kernel estimates it at most."""
    source: str
    """What the monotonic clock counts."""
    resolution: float
    """s."""


@dataclass(frozen=True, slots=True)
class Computer:
    """All that was read."""

    realtime: RealtimeReport
    speed: Speed
    memory: float | None
    """bytes available."""
    disk: Disk
    clock: Clock
    compiled: int
    """Kernels that were not in the cache."""
    compile_time: float
    """s until all were there."""
    python: str
    slowed_by: tuple[str, ...]
    """What makes the interpreter slow."""


def read_computer(config: Config, runs: Path, root: Path = ROOT) -> Computer:
    """Read everything; ``root`` is where /sys, /proc and /etc are, ``runs`` where logs go.

    Real time is asked for and given back; 16 MB are written to ``runs``; kernels that are not compiled are.
    """
    with RealtimeSession(config.realtime) as session:
        granted = session.report
    compiled, seconds = warm(config)
    disk, speed, clock = read_disk(runs), read_speed(root), read_clock(root)
    return Computer(
        granted, speed, read_memory(root), disk, clock, compiled, seconds, python_version(), slowed_interpreter()
    )


def read_speed(root: Path) -> Speed:
    """Of the CPUs under ``root``."""
    cpus = root / "sys/devices/system/cpu"
    governors = tuple(_text(path) for path in sorted(cpus.glob("cpu[0-9]*/cpufreq/scaling_governor")))
    hottest, limit = _hottest(root / "sys/class/thermal")
    tegra = (root / "etc/nv_tegra_release").exists()
    throttled = tuple(_throttling(root))
    return Speed(governors, _power_mode() if tegra else "", hottest, limit, throttled, *_load())


def _load() -> tuple[float, int]:
    return os.getloadavg()[0], len(os.sched_getaffinity(0))


def _hottest(thermal: Path) -> tuple[float | None, float | None]:
    """Temperature and limit (°C) of the zone that is nearest to its limit; of the hottest, where none has one."""
    zones = []
    for zone in thermal.glob("thermal_zone*"):
        degrees = _number(zone / "temp") / 1e3
        trips = [
            _number(zone / kind.name.replace("_type", "_temp")) / 1e3
            for kind in zone.glob("trip_point_*_type")
            if _text(kind) in LIMITS
        ]
        limit = min((trip for trip in trips if trip > 0.0), default=math.inf)
        if math.isfinite(degrees):
            zones.append((limit - degrees, -degrees, degrees, limit))
    if not zones:
        return None, None
    _, _, degrees, limit = min(zones)
    return degrees, limit if math.isfinite(limit) else None


def _throttling(root: Path) -> Iterator[str]:
    for device in sorted((root / "sys/class/thermal").glob("cooling_device*")):
        kind = _text(device / "type")
        if SLOWING.search(kind) and _number(device / "cur_state") > 0.0:
            yield kind
    for policy in sorted((root / "sys/devices/system/cpu/cpufreq").glob("policy*")):
        allowed, able = _number(policy / "scaling_max_freq"), _number(policy / "cpuinfo_max_freq")
        if allowed < able:
            yield f"{policy.name} at most {allowed / 1e6:.1f} of {able / 1e6:.1f} GHz"


def _power_mode() -> str:
    """What nvpmodel says; empty where it doesn't."""
    try:
        told = subprocess.run(["nvpmodel", "-q"], capture_output=True, text=True, timeout=5.0, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return power_mode_of(told)


def power_mode_of(told: str) -> str:
    """The mode's name in the output of nvpmodel -q, such as "NV Power Mode: MAXN"."""
    found = re.search(r"Power Mode:\s*(\S+)", told)
    return found[1] if found else ""


def read_memory(root: Path) -> float | None:
    """Bytes available."""
    found = re.search(r"^MemAvailable:\s+(\d+) kB", _text(root / "proc/meminfo"), re.MULTILINE)
    return 1024.0 * int(found[1]) if found else None


def read_disk(runs: Path) -> Disk:
    """Where ``runs`` is or would be; its speed is measured by writing."""
    place = next(path for path in (runs.absolute(), *runs.absolute().parents) if path.exists())
    free, writable = float(shutil.disk_usage(place).free), os.access(place, os.W_OK)
    rate, longest = write_speed(place) if writable and free > 2 * WRITTEN * len(MEGABYTE) else (None, 0.0)
    return Disk(runs, place, free, writable, rate, longest)


def write_speed(place: Path) -> tuple[float | None, float]:
    """Bytes/s and the longest s for one MB, each of which is on the disk before the next is begun."""
    longest, begun = 0.0, time.monotonic()
    try:
        with tempfile.TemporaryFile(dir=place, buffering=0) as file:
            for _ in range(WRITTEN):
                before = time.monotonic()
                file.write(MEGABYTE)
                os.fdatasync(file.fileno())
                longest = max(longest, time.monotonic() - before)
    except OSError:
        return None, longest
    return WRITTEN * len(MEGABYTE) / max(time.monotonic() - begun, 1e-9), longest


def read_clock(root: Path) -> Clock:
    """The clocks of this computer."""
    synchronised, error = wall_clock()
    source = _text(root / "sys/devices/system/clocksource/clocksource0/current_clocksource")
    return Clock(time.time(), synchronised, error, source, time.get_clock_info("monotonic").resolution)


def wall_clock() -> tuple[bool, float]:
    """Whether the kernel holds the wall clock to be synchronised, and its greatest error in s (adjtimex(2))."""
    buffer = ctypes.create_string_buffer(TIMEX_SIZE)
    with contextlib.suppress(AttributeError, OSError):
        if ctypes.CDLL(None).adjtimex(buffer) >= 0:
            _, _, _, greatest, _, status = TIMEX.unpack_from(buffer)
            return not status & UNSYNCHRONISED, greatest * 1e-6
    return False, math.inf


def warm(config: Config) -> tuple[int, float]:
    """Load all kernels of a flight with ``config``; how many had to be compiled, and s."""
    begun = time.monotonic()
    with event.install_recorder("numba:compile") as recorder:
        warm_up(config, ONE_GATE, choose_modules(config, ONE_GATE, config.camera.model()))
    compiled = sum(told.is_end for _, told in recorder.buffer)
    return compiled, time.monotonic() - begun


def python_version() -> str:
    """Such as "Python 3.12.4"; without the GIL it says so."""
    free = "" if getattr(sys, "_is_gil_enabled", lambda: True)() else ", without the GIL"
    return f"Python {sys.version.split()[0]}{free}"


def slowed_interpreter() -> tuple[str, ...]:
    """What was switched on that makes it slow."""
    watched = (
        (sys.gettrace() is not None, "a debugger or coverage"),
        (sys.getprofile() is not None, "a profiler"),
        (sys.flags.dev_mode, "its development mode"),
        (bool(os.environ.get("PYTHONASYNCIODEBUG")), "PYTHONASYNCIODEBUG"),
        (os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", "NUMBA_DISABLE_JIT"),
    )
    return tuple(name for on, name in watched if on)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _number(path: Path) -> float:
    try:
        return float(_text(path))
    except ValueError:
        return math.nan
