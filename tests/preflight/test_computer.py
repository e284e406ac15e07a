"""What the doctor says of a computer, by readings that are made up and by a /sys and /proc that are."""

import math
import time
from dataclasses import replace
from pathlib import Path

import pytest

from flightapp.autopilot.diagnosis import Light
from flightapp.config import Config, load_config
from flightapp.preflight import computer, readings
from flightapp.preflight.readings import Clock, Computer, Disk, Speed
from flightapp.realtime import RealtimeReport, Step

GREEN, AMBER, RED = Light.GREEN, Light.AMBER, Light.RED
GOOD = Computer(
    realtime=RealtimeReport((Step("memory locked", True, "80 MB resident"),)),
    speed=Speed(("performance",) * 4, "", 45.0, 95.0, (), 0.3, 4),
    memory=4e9,
    disk=Disk(Path("runs"), Path(), 9e9, True, 200e6, 0.01),
    clock=Clock(1.8e9, True, 0.002, "arch_sys_counter", 1e-9),
    compiled=0,
    compile_time=2.0,
    python="Python 3.12.4",
    slowed_by=(),
)


def found(read, config=None):
    return {line.name: line for line in computer.lines(read, config or Config())}


def test_a_good_computer_is_green():
    assert {line.light for line in computer.lines(GOOD, Config())} == {GREEN}


@pytest.mark.parametrize(
    ("part", "changed", "name", "light", "told"),
    [
        ("speed", {"governors": ("performance", "powersave")}, "governor", AMBER, "powersave"),
        ("speed", {"governors": ()}, "governor", AMBER, "not told"),
        ("speed", {"power_mode": "MODE_15W"}, "power mode", AMBER, "MODE_15W"),
        ("speed", {"power_mode": "MAXN_SUPER"}, "power mode", GREEN, "MAXN_SUPER"),
        ("speed", {"hottest": 85.0}, "temperature", AMBER, "85 °C"),
        ("speed", {"hottest": None}, "temperature", AMBER, "not told"),
        ("speed", {"limit": None}, "temperature", GREEN, "45 °C"),
        ("speed", {"throttled": ("Processor",)}, "temperature", AMBER, "slowed down by Processor"),
        ("speed", {"load": 3.0}, "load", AMBER, "load 3.0 on 4 CPUs"),
        ("", {"memory": 6e8}, "memory", AMBER, "0.6 GB"),
        ("", {"memory": 1e8}, "memory", RED, "0.1 GB"),
        ("", {"memory": None}, "memory", AMBER, "not told"),
        ("disk", {"free": 1e9}, "disk of runs", AMBER, "1.0 GB"),
        ("disk", {"free": 1e8}, "disk of runs", RED, "0.1 GB"),
        ("disk", {"writable": False}, "disk of runs", RED, "not writable"),
        ("disk", {"rate": 10e6}, "writing", AMBER, "10 MB/s"),
        ("disk", {"rate": 1e6}, "writing", RED, "1 MB/s"),
        ("disk", {"rate": None}, "writing", RED, "could not be written"),
        ("disk", {"longest": 0.8}, "writing", AMBER, "800 ms"),
        ("clock", {"wall": 0.0}, "wall clock", AMBER, "never set"),
        ("clock", {"synchronised": False}, "wall clock", AMBER, "not synchronised"),
        ("clock", {"source": "hpet"}, "monotonic clock", AMBER, "hpet"),
        ("", {"compiled": 7, "compile_time": 80.0}, "compiled kernels", AMBER, "7 were not there"),
        ("", {"slowed_by": ("a profiler",)}, "Python", AMBER, "a profiler"),
    ],
)
def test_what_is_wrong_is_told_with_its_mend(part, changed, name, light, told):
    read = replace(GOOD, **({part: replace(getattr(GOOD, part), **changed)} if part else changed))
    line = found(read)[name]
    assert line.light is light
    assert told in line.found
    assert bool(line.mend) is (light is not GREEN)
    others = {other.light for key, other in found(read).items() if key != name}
    assert others == {GREEN}


def test_real_time_that_is_refused_or_not_asked_for_is_amber():
    refused = RealtimeReport((Step("SCHED_FIFO for the event loop", False, "permit it by LimitRTPRIO=50"),))
    (line,) = computer.realtime(refused, Config().realtime)
    assert (line.light, line.mend) == (AMBER, "permit it by LimitRTPRIO=50")
    (line,) = computer.realtime(RealtimeReport(()), load_config(None, None, ["realtime.priority=0"]).realtime)
    assert "realtime.priority is off" in line.found


def write(root, **files):
    for name, text in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8")


@pytest.fixture
def board(tmp_path):
    """A /sys of two CPUs and two thermal zones."""
    cpu, thermal = "sys__devices__system__cpu__", "sys__class__thermal__"
    write(
        tmp_path,
        **{
            f"{cpu}cpu0__cpufreq__scaling_governor": "schedutil",
            f"{cpu}cpu1__cpufreq__scaling_governor": "performance",
            f"{cpu}cpufreq__policy0__scaling_max_freq": "1500000",
            f"{cpu}cpufreq__policy0__cpuinfo_max_freq": "1500000",
            f"{thermal}thermal_zone0__temp": "61500",
            f"{thermal}thermal_zone0__trip_point_0_type": "passive",
            f"{thermal}thermal_zone0__trip_point_0_temp": "95000",
            f"{thermal}thermal_zone0__trip_point_1_type": "critical",
            f"{thermal}thermal_zone0__trip_point_1_temp": "105000",
            f"{thermal}thermal_zone1__temp": "70000",
            f"{thermal}cooling_device0__type": "pwm-fan",
            f"{thermal}cooling_device0__cur_state": "3",
            f"{thermal}cooling_device1__type": "thermal-cpufreq-0",
            f"{thermal}cooling_device1__cur_state": "0",
            "proc__meminfo": "MemTotal:  8000 kB\nMemAvailable:     2000 kB",
        },
    )
    return tmp_path


def test_a_board_is_read(board):
    speed = readings.read_speed(board)
    assert speed.governors == ("schedutil", "performance")
    assert (speed.hottest, speed.limit) == (61.5, 95.0)
    assert speed.throttled == ()
    assert readings.read_memory(board) == 2000 * 1024


def test_a_board_that_is_slowed_down_says_by_what(board):
    thermal, cpu = "sys__class__thermal__", "sys__devices__system__cpu__"
    write(board, **{f"{thermal}cooling_device1__cur_state": "2", f"{cpu}cpufreq__policy0__scaling_max_freq": "800000"})
    assert readings.read_speed(board).throttled == ("thermal-cpufreq-0", "policy0 at most 0.8 of 1.5 GHz")


def test_where_nothing_is_told_nothing_is_made_up(tmp_path):
    speed = readings.read_speed(tmp_path)
    assert (speed.governors, speed.hottest, speed.limit, speed.throttled) == ((), None, None, ())
    assert readings.read_memory(tmp_path) is None
    assert readings.read_clock(tmp_path).source == ""


def test_numbers_that_are_none_are_left_out(board):
    write(board, **{"sys__class__thermal__thermal_zone1__temp": "hot"})
    assert readings.read_speed(board).hottest == 61.5


def test_the_power_mode_of_a_jetson():
    assert readings.power_mode_of("NV Fan Mode:quiet\nNV Power Mode: MAXN\n0\n") == "MAXN"
    assert readings.power_mode_of("nvpmodel: command failed") == ""


def test_the_disk_is_written_and_left_as_it_was(tmp_path):
    disk = readings.read_disk(tmp_path / "not" / "yet")
    assert disk.place == tmp_path
    assert disk.rate > 0.0
    assert 0.0 < disk.longest < 60.0
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_cannot_be_written_to_has_no_rate(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(readings.os, "fdatasync", full)
    assert readings.read_disk(tmp_path).rate is None


def test_this_computer_s_clock_is_read():
    clock = readings.read_clock(Path("/"))
    assert abs(clock.wall - time.time()) < 60.0
    assert clock.error > 0.0 or math.isinf(clock.error)


def test_kernels_that_are_loaded_are_not_counted_as_compiled():
    readings.warm(Config())
    compiled, seconds = readings.warm(Config())
    assert compiled == 0
    assert seconds > 0.0
