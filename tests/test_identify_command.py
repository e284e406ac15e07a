"""What can be wrong with the logs that `flightapp identify` is given, and the files it writes."""

import datetime
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from test_bad_input import flightapp

from flightapp.config import Vehicle, dump_config, load_config
from flightapp.evaluation.flight import Commands, Flight, States
from flightapp.identification.findings import Finding, Identified
from flightapp.identification.series import stretches
from flightapp.identify_command import identify_runs, vehicle_text
from flightapp.inputs import BadInputError
from flightapp.messages import AutopilotStatus, FlightMode, RateCommand, VehicleState
from flightapp.recording.writer import FlightLog

LEVEL = np.array((1.0, 0.0, 0.0, 0.0))
DAY = datetime.date(2026, 1, 2)


def log(path, seconds, commands=True, states=True, mode=FlightMode.OFFBOARD):
    """A flight log of a hover."""
    config = load_config(None, None, ("vehicle.learn_hover_thrust=false",))
    writer = FlightLog(path, header={"config": dump_config(config)}, opening=1.0)
    writer.write("autopilot", AutopilotStatus(0.0, mode, True, False, True, 16.0, 1.0))
    for k in range(round(250 * seconds)):
        stamp = 0.004 * k
        if commands:
            writer.write("command", RateCommand(stamp, np.zeros(3), 9.81))
        if states:
            state = VehicleState(stamp, np.zeros(3), LEVEL, np.zeros(3), np.zeros(3), np.eye(9))
            writer.write("state", state)
    writer.close()


CASES = {
    "a log that is not there": (None, ["no such flight log"]),
    "an empty file": (lambda path: path.write_bytes(b""), ["the file is empty"]),
    "a flight without commands": (lambda path: log(path, 1.0, commands=False), ["no commands are in it"]),
    "a flight without states": (lambda path: log(path, 1.0, states=False), ["no states are in it"]),
    "a flight that was too short": (lambda path: log(path, 2.0), ["for 4 s on end", "missions/identify.py"]),
    "commands that nobody followed": (lambda path: log(path, 6.0, mode=FlightMode.HOLD), ["nowhere did the autopilot"]),
}


@pytest.mark.parametrize("name", CASES)
def test_a_log_that_tells_nothing_is_refused(tmp_path, name):
    make, words = CASES[name]
    if make is not None:
        make(tmp_path / "flight.mcap")
    with pytest.raises(BadInputError) as refused:
        identify_runs([tmp_path / "flight.mcap"])
    assert all(word in str(refused.value) for word in ["flight.mcap", *words]), refused.value


def test_a_base_that_is_not_there_is_refused(tmp_path):
    log(tmp_path / "flight.mcap", 6.0)
    with pytest.raises(BadInputError, match="no such vehicle file"):
        identify_runs([tmp_path / "flight.mcap"], tmp_path / "none.toml")


def test_the_command_writes_what_a_hover_tells(tmp_path):
    log(tmp_path / "flight.mcap", 8.0)
    ended = flightapp("identify", ".", "--out", "new.toml", "--json", "found.json", cwd=tmp_path)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert load_config(tmp_path / "new.toml").vehicle.hover_thrust == pytest.approx(0.25, rel=0.01)
    told = json.loads((tmp_path / "found.json").read_text())
    assert {entry["parameter"] for entry in told["not_told"]} >= {"delay", "motor_lag", "drag x"}


def flight_of(stamps, followed):
    n = stamps.size
    commands = Commands(stamps, np.zeros((n, 3)), np.full(n, 9.81))
    states = States(stamps, np.zeros((n, 3)), np.tile(LEVEL, (n, 1)), np.zeros((n, 3)), np.zeros((n, 3)))
    states = replace(states, doubtful=np.zeros(n, np.uint32))
    modes = [(0.0, FlightMode.TAKEOFF), (followed[0], FlightMode.OFFBOARD), (followed[1], FlightMode.LAND)]
    statuses = tuple(AutopilotStatus(t, mode, True, False, True, 16.0, 1.0) for t, mode in modes)
    return Flight(commands=commands, states=states, statuses=statuses)


def test_only_what_the_autopilot_followed_counts():
    (part,) = stretches(flight_of(np.arange(0.0, 20.0, 0.004), (5.0, 15.0)), Vehicle())
    assert part.sent[0] == pytest.approx(5.0) and part.sent[-1] < 15.0
    assert part.stamp[0] == pytest.approx(6.0, abs=0.005)
    assert part.throttle[0] == pytest.approx(0.25, abs=1e-3)


def test_a_break_parts_a_flight_in_two():
    stamps = np.concatenate((np.arange(0.0, 6.0, 0.004), np.arange(8.0, 14.0, 0.004)))
    parts = stretches(flight_of(stamps, (0.0, 14.0)), Vehicle())
    assert [round(part.stamp[0]) for part in parts] == [1, 9]


def found(*findings):
    return Identified(Vehicle(), findings, (), 10.0)


def test_a_file_keeps_what_was_not_found(tmp_path):
    base = tmp_path / "mine.toml"
    base.write_text(
        '# mine\n[vehicle]\nname = "mine"\ndrag = [0.1, 0.2, 0.3]  # guessed\n\n[race]\nv_max = 2.0  # careful\n'
    )
    one = Identified(load_config(base).vehicle, (Finding("drag", 0.2, 0.4567, 0.012, "1/s", axis=1),), (), 10.0)
    text = vehicle_text(one, base, "flight 7", DAY)
    assert "# mine" in text and "v_max = 2.0  # careful" in text
    (tmp_path / "new.toml").write_text(text)
    config = load_config(tmp_path / "new.toml")
    assert config.vehicle.drag == (0.1, 0.457, 0.3)
    assert config.vehicle.name == "mine"
    assert "± 0.012 1/s, flight 7, 2026-01-02" in text


def test_without_a_base_the_file_says_only_what_was_found(tmp_path):
    findings = (
        Finding("hover_thrust", 0.25, 0.31234, 0.0004, ""),
        Finding("thrust_to_weight", 3.1, 2.5, math.nan, "", note="scaled"),
    )
    text = vehicle_text(found(*findings), None, "x", DAY)
    (tmp_path / "new.toml").write_text(text)
    assert load_config(tmp_path / "new.toml").vehicle == Vehicle(hover_thrust=0.31234, thrust_to_weight=2.5)
    assert [line for line in text.splitlines() if "=" in line and "hover" not in line] == [
        "thrust_to_weight = 2.5 # scaled, x, 2026-01-02"
    ]
