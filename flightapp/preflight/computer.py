"""What a doctor looks at of this computer: what it grants a flight, how fast it is and stays, disk and clock.

Pure functions of what was read; `readings` reads it.
"""

from collections.abc import Iterator

from flightapp.autopilot.diagnosis import Light, Line
from flightapp.config import Config, Realtime
from flightapp.preflight.readings import Clock, Computer, Disk, Speed
from flightapp.realtime import SWITCH_INTERVAL, RealtimeReport

COMPUTER = "this computer"
GREEN, AMBER, RED = Light.GREEN, Light.AMBER, Light.RED
PERFORMANCE = "performance"
COOL = 15.0
"""K below the temperature at which it slows down."""
BUSY = 0.5
"""Of the CPUs' time, taken by others: more of it is a flight's."""
MEMORY = (3e8, 1e9)
"""Bytes available: below the first a flight may not fit, below the second there is little room."""
SPACE = (2e8, 2e9)
"""Bytes free for logs: below the first none should begin, below the second there is little room."""
WRITING = (2e6, 20e6)
"""Bytes/s on disk: a flight with images writes 1 to 2 MB/s."""
LONGEST_WRITE = 0.5
"""s for one MB: the recorder's queue holds seven."""
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies")
"""Clock sources of Linux that take microseconds to read."""
EPOCH = 1735689600.0
"""s, the wall clock at the beginning of 2025: one that shows less was never set."""


def lines(read: Computer, config: Config) -> tuple[Line, ...]:
    """All of it."""
    return (
        *realtime(read.realtime, config.realtime),
        *speed(read.speed),
        memory(read.memory),
        *disk(read.disk),
        *clock(read.clock, config),
        kernels(read.compiled, read.compile_time),
        interpreter(read.python, read.slowed_by),
    )


def realtime(report: RealtimeReport, config: Realtime) -> Iterator[Line]:
    """What a flight would ask of the operating system, as it was granted or not."""
    name = "real time"
    for step in report.steps:
        if step.granted:
            yield Line(COMPUTER, name, GREEN, f"{step.what} ({step.detail})", "granted")
        else:
            yield Line(COMPUTER, name, AMBER, f"not permitted: {step.what}", "granted", step.detail)
    for asked, key in ((config.priority > 0, "realtime.priority"), (config.lock_memory, "realtime.lock_memory")):
        if not asked:
            mend = f"set {key}: without it commands come late under load"
            yield Line(COMPUTER, name, AMBER, f"{key} is off", "granted", mend)


def speed(read: Speed) -> Iterator[Line]:
    """Governor, power mode, heat, and what others take."""
    others = sorted(set(read.governors) - {PERFORMANCE})
    if not read.governors:
        yield Line(COMPUTER, "governor", AMBER, "not told", PERFORMANCE, "look at it where the CPUs are the host's")
    elif others:
        mend = "cpupower frequency-set -g performance; on a Jetson: jetson_clocks"
        yield Line(COMPUTER, "governor", AMBER, ", ".join(others), PERFORMANCE, mend)
    else:
        yield Line(COMPUTER, "governor", GREEN, PERFORMANCE, PERFORMANCE)
    if read.power_mode:
        best = read.power_mode.upper().startswith("MAXN")
        mend = "" if best else "nvpmodel -m 0, then jetson_clocks; does the supply give that much?"
        yield Line(COMPUTER, "power mode", GREEN if best else AMBER, read.power_mode, "MAXN", mend)
    yield _heat(read)
    share = read.load / max(read.cpus, 1)
    found, wanted = f"load {read.load:.1f} on {read.cpus} CPUs", f"under {BUSY * read.cpus:g}"
    if share < BUSY:
        yield Line(COMPUTER, "load", GREEN, found, wanted)
    else:
        yield Line(COMPUTER, "load", AMBER, found, wanted, "end what else computes here: see top")


def _heat(read: Speed) -> Line:
    name = "temperature"
    if read.throttled:
        mend = "cool it: a fan, less load, shade; it flies slower than it was measured to"
        return Line(COMPUTER, name, AMBER, f"slowed down by {', '.join(read.throttled)}", "not slowed down", mend)
    if read.hottest is None:
        return Line(COMPUTER, name, AMBER, "not told", "", "there is no sensor that Linux knows")
    found = f"{read.hottest:.0f} °C"
    if read.limit is None:
        return Line(COMPUTER, name, GREEN, found)
    wanted = f"under {read.limit - COOL:.0f} °C ({read.limit:.0f} °C slow it down)"
    if read.hottest < read.limit - COOL:
        return Line(COMPUTER, name, GREEN, found, wanted)
    return Line(COMPUTER, name, AMBER, found, wanted, "cool it: it will be hotter under a flight's load")


def memory(available: float | None) -> Line:
    """Bytes that a flight may take."""
    wanted = f"{MEMORY[1] / 1e9:g} GB available"
    if available is None:
        return Line(COMPUTER, "memory", AMBER, "not told", wanted, "look at free -m")
    light = GREEN if available >= MEMORY[1] else AMBER if available >= MEMORY[0] else RED
    mend = "" if light is GREEN else "end what else runs here"
    return Line(COMPUTER, "memory", light, f"{available / 1e9:.1f} GB available", wanted, mend)


def disk(read: Disk) -> Iterator[Line]:
    """Room for the log, and how fast it can be written."""
    name, wanted, found = f"disk of {read.runs}", f"{SPACE[1] / 1e9:g} GB free", f"{read.free / 1e9:.1f} GB free"
    if not read.writable:
        mend = f"chown {read.place} to the user who flies"
        yield Line(COMPUTER, name, RED, f"{found}, not writable", wanted, mend)
        return
    light = GREEN if read.free >= SPACE[1] else RED if read.free < SPACE[0] else AMBER
    yield Line(COMPUTER, name, light, found, wanted, "" if light is GREEN else "move old runs away")
    wanted = f"{WRITING[1] / 1e6:g} MB/s"
    if read.rate is None:
        yield Line(COMPUTER, "writing", RED, "a file of 16 MB could not be written", wanted, "look at dmesg")
        return
    found = f"{read.rate / 1e6:.0f} MB/s, longest wait {1e3 * read.longest:.0f} ms"
    good = read.rate >= WRITING[1] and read.longest < LONGEST_WRITE
    light = GREEN if good else RED if read.rate < WRITING[0] else AMBER
    mend = "" if good else "record on an SSD, or set recording.image_every higher"
    yield Line(COMPUTER, "writing", light, found, wanted, mend)


def clock(read: Clock, config: Config) -> Iterator[Line]:
    """The wall clock, which only the log's header needs, and the one that everything is stamped with."""
    wanted = "set, and held by NTP or PTP"
    if read.wall < EPOCH:
        mend = "set it before the flight: what sets it in flight is told as a fault"
        yield Line(COMPUTER, "wall clock", AMBER, "it was never set", wanted, mend)
    elif not read.synchronised:
        mend = f"timedatectl set-ntp true; in flight a step of {config.safety.clock_jump:g} s is told as a fault"
        yield Line(COMPUTER, "wall clock", AMBER, "not synchronised: it may be set in flight", wanted, mend)
    else:
        yield Line(COMPUTER, "wall clock", GREEN, f"synchronised, within {1e3 * read.error:.0f} ms", wanted)
    slow = read.source in SLOW_CLOCKS
    mend = "boot with clocksource=tsc, if the firmware lets it be" if slow else ""
    found = f"{read.source or 'source not told'}, resolution {1e9 * read.resolution:.0f} ns"
    yield Line(COMPUTER, "monotonic clock", AMBER if slow else GREEN, found, "a counter of the CPU", mend)


def kernels(compiled: int, seconds: float) -> Line:
    """What had to be compiled for this configuration, which now is."""
    name, wanted = "compiled kernels", "all in the cache"
    if not compiled:
        return Line(COMPUTER, name, GREEN, f"loaded in {seconds:.1f} s", wanted)
    mend = "ask again: if it says the same, the cache cannot be written (NUMBA_CACHE_DIR)"
    return Line(COMPUTER, name, AMBER, f"{compiled} were not there; compiled in {seconds:.0f} s", wanted, mend)


def interpreter(version: str, slowed_by: tuple[str, ...]) -> Line:
    """Python, and what makes it slow."""
    found = f"{version}; threads wait {1e3 * SWITCH_INTERVAL:g} ms for it in flight"
    if not slowed_by:
        return Line(COMPUTER, "Python", GREEN, found)
    return Line(COMPUTER, "Python", AMBER, f"{found}; slowed by {', '.join(slowed_by)}", "", "start it without")
