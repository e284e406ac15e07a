"""`flightapp doctor`, whole: which parts are examined, and what becomes of them together."""

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest
from doctor_vehicle import FakeVehicle
from typer.testing import CliRunner

from flightapp import cli, doctor_command
from flightapp.autopilot import doctor
from flightapp.autopilot.diagnosis import Light
from flightapp.autopilot.wanted_parameters import Profile
from flightapp.commands import doctor as command
from flightapp.config import Config, load_config
from flightapp.doctor_command import Part, examine
from flightapp.inputs import BadInputError
from flightapp.messages import Frame
from flightapp.preflight.readings import read_computer


@pytest.fixture(autouse=True)
def _quick(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "LISTEN", 0.0)
    monkeypatch.setattr(doctor_command, "LISTEN", 0.2)
    monkeypatch.chdir(tmp_path)


def diagnose(parts, config=None, runs=Path("runs"), vehicle=None):
    config = config or load_config(None, None, ["sensors.pose_address=127.0.0.1:25601"])
    return examine(config, parts, lambda _: vehicle or FakeVehicle(), Profile.CAGE, None, runs)


def groups(diagnosis):
    return list(dict.fromkeys(line.group for line in diagnosis.lines))


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (Part.VEHICLE, ["vehicle", "telemetry", "configuration"]),
        (Part.POSES, ["poses"]),
        (Part.CAMERA, ["camera"]),
        (Part.COMPUTER, ["this computer"]),
    ],
)
def test_only_the_part_that_was_asked_for_is_examined(part, expected):
    found = diagnose({part})
    assert sorted(groups(found)) == sorted(expected)
    assert bool(found.findings) is (part is Part.VEHICLE)


def test_the_default_vehicle_is_not_yours():
    (line,) = [
        line for line in diagnose({Part.VEHICLE}).lines if line.group == "configuration" and line.name == "vehicle"
    ]
    assert line.light is Light.AMBER
    own = load_config(None, None, ["vehicle.name=mine", "vehicle.mass=1.1"])
    (line,) = [line for line in diagnose({Part.VEHICLE}, own).lines if line.name == "vehicle"]
    assert (line.light, "mine" in line.found) == (Light.GREEN, True)


def test_a_tracker_that_sends_nothing_is_red_and_one_that_cannot_be_opened_says_why():
    (line,) = diagnose({Part.POSES}).lines
    assert line.light is Light.RED
    config = load_config(None, None, ["sensors.poses=replay", "sensors.replay=nowhere.csv"])
    (line,) = diagnose({Part.POSES}, config).lines
    assert line.light is Light.RED
    assert "nowhere.csv" in line.found


def test_the_autopilot_s_own_poses_are_looked_at_with_the_autopilot():
    (line,) = diagnose({Part.POSES}, load_config(None, None, ["sensors.poses=autopilot"])).lines
    assert line.light is Light.GREEN


class FakeCamera:
    model = Config().camera.model()

    async def frames(self):
        loop, rng = asyncio.get_running_loop(), np.random.default_rng(0)
        while True:
            await asyncio.sleep(0.01)
            yield Frame(loop.time(), 0, rng.integers(0, 255, (480, 640), np.uint8))

    def close(self):
        self.closed = True


def test_a_camera_is_watched_where_there_is_one(monkeypatch):
    (line,) = diagnose({Part.CAMERA}).lines
    assert (line.light, line.found) == (Light.AMBER, "no camera is configured")
    camera, config = FakeCamera(), load_config(None, None, ["camera.source=/dev/video63"])
    (line,) = diagnose({Part.CAMERA}, config).lines
    assert line.light is Light.RED
    assert "/dev/video63" in line.found
    monkeypatch.setattr(doctor_command, "open_camera", lambda config: camera)
    names = {line.name for line in diagnose({Part.CAMERA}, config).lines}
    assert {"frames", "age", "exposure", "sharpness", "calibration"} <= names
    assert camera.closed


def test_this_computer_is_really_read(tmp_path):
    read = read_computer(Config(), tmp_path)
    assert read.python.startswith("Python 3.")
    assert read.memory > 0.0
    assert read.disk.rate > 0.0


def test_the_command_examines_everything_and_is_red_where_one_thing_is(monkeypatch, tmp_path):
    vehicle = FakeVehicle()
    monkeypatch.setattr(command, "Px4Link", lambda config: vehicle)
    out = tmp_path / "found.json"
    arguments = ["doctor", "--set", "sensors.pose_address=127.0.0.1:25602", "--json", str(out)]
    result = CliRunner().invoke(cli.cli, arguments)
    assert result.exit_code == 1, result.output
    told = json.loads(out.read_text(encoding="utf-8"))
    assert {line["group"] for line in told["lines"]} == {
        *("vehicle", "telemetry", "configuration", "poses", "camera", "this computer")
    }
    red = [line["group"] for line in told["lines"] if line["light"] == "red"]
    assert red == ["poses"]
    assert all(line["mend"] for line in told["lines"] if line["light"] != "green")
    assert vehicle.closed


def test_fix_needs_the_vehicle():
    result = CliRunner().invoke(cli.cli, ["doctor", "--fix", "--only", "computer"])
    assert isinstance(result.exception, BadInputError)
