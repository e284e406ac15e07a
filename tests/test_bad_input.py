"""What a user can get wrong is told in one paragraph, with exit status 2 and without a traceback."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FIVE_GATES = (ROOT / "missions" / "tracks" / "five_gates.toml").read_text(encoding="utf-8")

MISSION = """
TRACK = "track.toml"
SETTINGS = {"race.v_max": 2.0}

async def mission(drone):
    await drone.takeoff()
"""


def flightapp(*arguments, cwd):
    command = [sys.executable, "-m", "flightapp.cli", *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


def replaced(old, new):
    assert old in FIVE_GATES
    return FIVE_GATES.replace(old, new, 1)


def first_line(prefix):
    return next(line for line in FIVE_GATES.splitlines() if line.strip().startswith(prefix))


GATE_POSITION = "position = [-4.0, -8.0, 1.5]"
CASES = {
    "a missing mission": ({}, ("fly", "nowhere.py", "--sim"), ["nowhere.py", "no such mission"]),
    "a missing track": ({"m.py": MISSION}, ("fly", "m.py", "--sim"), ["track.toml", "no such track"]),
    "a TOML syntax error": (
        {"m.py": MISSION, "track.toml": "name = \n"},
        ("fly", "m.py", "--sim"),
        ["track.toml", "not valid TOML", "line 1"],
    ),
    "an unknown key": (
        {"m.py": MISSION, "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim", "--set", "race.vmax=3"),
        ["race.vmax", "did you mean 'v_max'"],
    ),
    "a NaN gate": (
        {"m.py": MISSION, "track.toml": replaced(GATE_POSITION, "position = [nan, -8.0, 1.5]")},
        ("fly", "m.py", "--sim"),
        ["track.toml", "gates.0.position", "nan", "finite"],
    ),
    "a gate underground": (
        {"m.py": MISSION, "track.toml": replaced(GATE_POSITION, "position = [-4.0, -8.0, 0.5]")},
        ("fly", "m.py", "--sim"),
        ["track.toml", "gate 1 is underground", "0.70"],
    ),
    "a marker used twice": (
        {
            "m.py": MISSION,
            "track.toml": FIVE_GATES.replace(
                [line for line in FIVE_GATES.splitlines() if line.strip().startswith("markers")][1],
                first_line("markers"),
                1,
            ),
        },
        ("fly", "m.py", "--sim"),
        ["track.toml", "is used twice, on gates 1 and 2"],
    ),
    "an empty track": (
        {"m.py": MISSION, "track.toml": 'name = "x"\n[start]\nposition = [0.0, 0.0, 0.0]\n'},
        ("fly", "m.py", "--sim"),
        ["track.toml", "track is empty"],
    ),
    "a v_max that the vehicle can't fly": (
        {"m.py": MISSION, "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim", "--set", "race.v_max=39", "--set", "vehicle.drag=[0.6, 0.6, 0.1]"),
        ["race.v_max = 39.0", "cannot be flown", "at most"],
    ),
    "a v_max that is negative": (
        {"m.py": MISSION, "track.toml": FIVE_GATES},
        ("sweep", "m.py", "--set", "race.v_max=-1"),
        ["race.v_max", "greater than 0"],
    ),
    "a vehicle file that is missing": (
        {"m.py": MISSION, "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim", "--vehicle", "none.toml"),
        ["none.toml", "no such vehicle file"],
    ),
    "a vehicle that the simulator does not have": (
        {"m.py": MISSION, "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim", "--set", "sim.vehicle=boeing"),
        ["boeing", "racer"],
    ),
    "a planner that is not installed": (
        {"m.py": MISSION, "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim", "--set", "planning.planner=warp"),
        ["warp", "polynomial"],
    ),
    "a mission with a syntax error": (
        {"m.py": "async def mission(drone:\n", "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim"),
        ["m.py:1", "SyntaxError"],
    ),
    "a mission without a mission": (
        {"m.py": 'TRACK = "track.toml"\n', "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim"),
        ["async def mission(drone)"],
    ),
    "no rig": ({"m.py": MISSION, "track.toml": FIVE_GATES}, ("fly", "m.py"), ["--sim"]),
    "a log that is none": ({"flight.mcap": "hello"}, ("report", "flight.mcap"), ["flight.mcap"]),
    "a live view at no address": (
        {"m.py": MISSION, "track.toml": FIVE_GATES},
        ("fly", "m.py", "--sim", "--live-at", "here"),
        ["here", "HOST:PORT"],
    ),
    "a log that is not there": ({}, ("report", "runs/none"), ["runs/none"]),
    "no service": ({"m.py": MISSION}, ("start", "m.py"), ["control.sock", "no service listens", "flightapp serve"]),
}

LEMNISCATE = str(ROOT / "missions" / "lemniscate.py")
CASES |= {
    "no vehicle": ({}, ("fly", LEMNISCATE), ["--sim", "--sim --mavlink", "--connect URL"]),
    "two vehicles": ({}, ("fly", LEMNISCATE, "--sim", "--connect", "udpin://127.0.0.1:14540"), ["--connect URL"]),
    "a connection that is none": (
        {},
        ("fly", LEMNISCATE, "--connect", "127.0.0.1:14540"),
        ["link.connection = '127.0.0.1:14540'", "udpin://HOST:PORT", "serial:///dev/NAME:BAUD"],
    ),
    "a serial device that is missing": (
        {},
        ("fly", LEMNISCATE, "--connect", "serial:///dev/ttyNONE:921600"),
        ["serial:///dev/ttyNONE:921600", "No such file or directory"],
    ),
    "gates without a camera": (
        {},
        ("fly", str(ROOT / "missions" / "five_gates.py"), "--connect", "udpin://127.0.0.1:14540"),
        ["track 'five_gates' has gates", "camera"],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_bad_input(name, tmp_path):
    files, arguments, expected = CASES[name]
    for file, text in files.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    ended = flightapp(*arguments, cwd=tmp_path)
    assert ended.returncode == 2, ended.stderr
    assert "Traceback" not in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1, ended.stderr
    for text in expected:
        assert text in ended.stderr


@pytest.mark.parametrize("command", ["fly", "doctor"])
def test_a_port_in_use(command, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{other.getsockname()[1]}"
        mission = [LEMNISCATE] if command == "fly" else []
        ended = flightapp(command, *mission, "--connect", url, cwd=tmp_path)
    assert ended.returncode == 2, ended.stderr
    assert f"link.connection = '{url}' cannot be opened" in ended.stderr
    assert "another program has this port" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_record_is_never_overwritten(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "flight.mcap").write_bytes(b"precious")
    (tmp_path / "m.py").write_text(MISSION)
    (tmp_path / "track.toml").write_text(FIVE_GATES)
    ended = flightapp("fly", "m.py", "--sim", "--out", "out", cwd=tmp_path)
    assert ended.returncode == 2
    assert "holds a flight already" in ended.stderr
    assert (tmp_path / "out" / "flight.mcap").read_bytes() == b"precious"
