import asyncio
import io
import json
import math
from dataclasses import replace

import pytest
from doctor_vehicle import FakeVehicle, good_values
from rich.console import Console
from typer.testing import CliRunner

from flightapp import cli
from flightapp.autopilot import doctor, examination
from flightapp.autopilot.clock import RoundTrip
from flightapp.autopilot.diagnosis import Light, diagnosis_json, diagnosis_tables
from flightapp.autopilot.doctor import changes, examine, mend, mended, visit
from flightapp.autopilot.parameters import Verdict
from flightapp.autopilot.telemetry import Identity
from flightapp.autopilot.wanted_parameters import Profile
from flightapp.commands import doctor as doctor_command
from flightapp.config import Config, load_config
from flightapp.inputs import BadInputError
from flightapp.interfaces import AutopilotError

NEEDS_REBOOT = "EKF2_HGT_REF"


@pytest.fixture(autouse=True)
def _quick(monkeypatch, tmp_path):
    """No waiting, and a directory that tests may fill."""
    monkeypatch.setattr(doctor, "LISTEN", 0.0)
    monkeypatch.setattr(doctor, "SETTLE", 0.0)
    monkeypatch.chdir(tmp_path)


async def diagnose(vehicle, profile=Profile.CAGE, config=None):
    return await examine(vehicle, config or Config(), profile, listen=0.0)


def lights(diagnosis, name):
    return [line.light for line in diagnosis.all_lines() if line.name == name]


def line_of(diagnosis, name):
    return next(line for line in diagnosis.all_lines() if line.name == name)


def verdicts(diagnosis):
    return {found.parameter.name: found.verdict for found in diagnosis.findings}


def text_of(diagnosis):
    shown = io.StringIO()
    Console(file=shown, width=200).print(*diagnosis_tables(diagnosis), sep="\n")
    return shown.getvalue()


@pytest.mark.parametrize("profile", list(Profile))
async def test_a_good_vehicle_is_green(profile):
    diagnosis = await diagnose(FakeVehicle(good_values(profile=profile)), profile)
    assert [line for line in diagnosis.all_lines() if line.light is not Light.GREEN] == []
    assert diagnosis.light is Light.GREEN
    assert "nothing is wrong" in text_of(diagnosis)


async def test_a_badly_set_parameter_is_told_with_reason_and_term():
    vehicle = FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0})
    diagnosis = await diagnose(vehicle)
    assert diagnosis.light is Light.RED
    line = line_of(diagnosis, "COM_OF_LOSS_T")
    assert (line.light, line.found, line.wanted) == (Light.RED, "1", "0.1 to 0.5")
    assert "--fix sets 0.5" in line.mend
    shown = text_of(diagnosis)
    assert "Offboard connection loss timeout" in shown
    assert "this computer has died" in " ".join(shown.split())


async def test_what_only_makes_it_fly_worse_is_amber():
    diagnosis = await diagnose(FakeVehicle(good_values() | {"EKF2_BARO_CTRL": 0, "CBRK_SUPPLY_CHK": 894281}))
    assert diagnosis.light is Light.AMBER
    assert lights(diagnosis, "EKF2_BARO_CTRL") == lights(diagnosis, "CBRK_SUPPLY_CHK") == [Light.AMBER]
    assert "person" in line_of(diagnosis, "CBRK_SUPPLY_CHK").mend


async def test_missing_is_fine_where_a_version_does_without_and_bad_where_not():
    values = good_values()
    for name in ("COM_ARM_WO_GPS", "COM_DLL_EXCEPT", "EKF2_EV_CTRL", "EKF2_EV_NOISE_MD"):
        del values[name]
    diagnosis = await diagnose(FakeVehicle(values))
    found = verdicts(diagnosis)
    assert [found[name] for name in ("COM_ARM_WO_GPS", "EKF2_EV_CTRL")] == [Verdict.MISSING] * 2
    assert lights(diagnosis, "COM_ARM_WO_GPS") == lights(diagnosis, "COM_DLL_EXCEPT") == [Light.GREEN]
    assert lights(diagnosis, "EKF2_EV_CTRL") == [Light.RED]
    assert lights(diagnosis, "EKF2_EV_NOISE_MD") == [Light.AMBER]
    assert not {"COM_ARM_WO_GPS", "EKF2_EV_CTRL"} & {change.parameter.name for change in changes(diagnosis)}


async def test_a_silent_link_is_given_up_soon_and_nothing_is_called_missing():
    vehicle = FakeVehicle()
    vehicle.silent = True
    vehicle.age = 5.0
    diagnosis = await diagnose(vehicle)
    assert set(verdicts(diagnosis).values()) == {Verdict.UNREADABLE}
    assert len(vehicle.read_names) == doctor.PATIENCE
    assert lights(diagnosis, "HEARTBEAT") == lights(diagnosis, "state") == [Light.RED]
    assert "silent for 5.0 s" in line_of(diagnosis, "state").found
    assert changes(diagnosis) == ()


async def test_a_vehicle_that_goes_silent_in_between_keeps_what_was_read():
    vehicle = FakeVehicle()
    read = vehicle.read

    async def failing(name):
        vehicle.silent = len(vehicle.read_names) >= 5
        return await read(name)

    vehicle.read = failing
    found = list(verdicts(await diagnose(vehicle)).values())
    assert found[:5] == [Verdict.OK] * 5
    assert set(found[5:]) == {Verdict.UNREADABLE}


async def test_nobody_there_is_a_finding():
    vehicle = FakeVehicle()
    vehicle.refuse_connection = "no autopilot with system id 1"
    diagnosis = await diagnose(vehicle)
    assert diagnosis.light is Light.RED
    assert line_of(diagnosis, "link").found == "no autopilot with system id 1"
    assert vehicle.read_names == []


async def test_telemetry_that_is_not_a_number_is_told_and_raises_nothing():
    vehicle = FakeVehicle(good_values() | {"EKF2_EV_DELAY": math.nan})
    vehicle.state |= {"voltage": math.nan, "battery": math.nan}
    vehicle.streams |= {"ODOMETRY": math.nan}
    diagnosis = await diagnose(vehicle)
    assert lights(diagnosis, "battery") == [Light.AMBER]
    assert lights(diagnosis, "ODOMETRY") == [Light.AMBER]
    assert lights(diagnosis, "EKF2_EV_DELAY") == [Light.AMBER]
    told = json.loads(json.dumps(diagnosis_json(diagnosis), allow_nan=False))
    delay = next(p for p in told["parameters"] if p["name"] == "EKF2_EV_DELAY")
    assert (delay["value"], delay["write"]) == (None, 10.0)
    assert "voltage not told" in text_of(diagnosis)


@pytest.mark.parametrize(
    ("version", "light"),
    [
        ("1.16.1", Light.GREEN),
        ("1.17.0", Light.GREEN),
        ("1.15.4", Light.AMBER),
        ("2.0.0", Light.AMBER),
        ("", Light.AMBER),
        ("odd", Light.AMBER),
    ],
)
def test_versions_that_were_not_flown_are_amber(version, light):
    assert examination.identity(Identity(1, version, "", ""), Config()).light is light


def test_a_vehicle_without_identity_and_one_with_another_id():
    assert examination.identity(None, Config()).light is Light.AMBER
    assert examination.identity(Identity(2, "1.16.1", "", ""), Config()).light is Light.RED


def test_rates_are_measured_against_what_was_asked_for():
    config = load_config(None, None, ["link.odometry_rate=100"])
    found = {line.name: line.light for line in examination.streams({"HEARTBEAT": 0.9, "ODOMETRY": 79.0}, config)}
    assert found["HEARTBEAT"] is Light.GREEN
    assert found["ODOMETRY"] is found["CURRENT_MODE"] is Light.AMBER
    assert {line.name: line.light for line in examination.streams({}, config)}["HEARTBEAT"] is Light.RED


@pytest.mark.parametrize(
    ("trip", "light"),
    [(RoundTrip(5, 0.001, 0.3), Light.GREEN), (RoundTrip(5, 0.05, 0.06), Light.AMBER), (None, Light.AMBER)],
)
def test_a_slow_answer_is_amber(trip, light):
    assert examination.round_trip(trip).light is light


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"armed": True}, "state"),
        ({"landed": False}, "state"),
        ({"ready": False}, "local position"),
        ({"battery": 0.1}, "battery"),
    ],
)
async def test_a_state_that_is_not_that_of_a_parked_vehicle_is_amber(changed, name):
    vehicle = FakeVehicle()
    vehicle.state |= changed
    diagnosis = await diagnose(vehicle)
    assert [line.name for line in diagnosis.all_lines() if line.light is not Light.GREEN] == [name]
    assert diagnosis.light is Light.AMBER


@pytest.mark.parametrize(
    ("overrides", "name", "light"),
    [
        ([], "thrust", Light.GREEN),
        (["vehicle.hover_thrust=0.4"], "thrust", Light.RED),
        (["external_vision.rate=60"], "external vision", Light.AMBER),
        (["link.connection=serial:///dev/ttyTHS1:921600"], "bandwidth", Light.GREEN),
        (["link.connection=serial:///dev/ttyTHS1:230400"], "bandwidth", Light.AMBER),
        (["link.connection=serial:///dev/ttyTHS1:115200"], "bandwidth", Light.RED),
        (["link.connection=nonsense"], "bandwidth", Light.RED),
        (["link.lost_after=0.11"], "link loss", Light.AMBER),
    ],
)
def test_settings_that_do_not_go_together(overrides, name, light):
    found = {line.name: line for line in examination.consistency(load_config(None, None, overrides))}
    assert found[name].light is light
    assert bool(found[name].mend) is (light is not Light.GREEN)


async def test_mending_writes_what_was_listed_and_reads_it_back():
    vehicle = FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0, NEEDS_REBOOT: 1, "BAT1_N_CELLS": 0})
    diagnosis = await diagnose(vehicle)
    todo = changes(diagnosis)
    assert [change.text for change in todo] == [
        "EKF2_HGT_REF: 1 → 3 (counts after a reboot)",
        "COM_OF_LOSS_T: 1 → 0.5",
    ]
    done = await mend(vehicle, todo)
    assert vehicle.written == [(NEEDS_REBOOT, 3), ("COM_OF_LOSS_T", 0.5)]
    assert [type(value) for _, value in vehicle.written] == [int, float]
    after = mended(diagnosis, done)
    assert verdicts(after)["COM_OF_LOSS_T"] is Verdict.OK
    assert line_of(after, "reboot").found == NEEDS_REBOOT
    assert after.light is Light.AMBER


@pytest.mark.parametrize("armed", [True, None])
async def test_mending_is_refused_unless_it_is_known_to_be_disarmed(armed):
    vehicle = FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0})
    todo = changes(await diagnose(vehicle))
    if armed:
        vehicle.tell(armed=True)
    else:
        vehicle.status.latest = None
    with pytest.raises(AutopilotError, match="armed"):
        await mend(vehicle, todo)
    assert vehicle.written == []


async def test_arming_in_between_stops_the_mending():
    vehicle = FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0, NEEDS_REBOOT: 1})
    vehicle.arms_after = 1
    with pytest.raises(AutopilotError, match="1 were written"):
        await mend(vehicle, changes(await diagnose(vehicle)))
    assert len(vehicle.written) == 1


async def test_what_the_autopilot_does_not_take_stays_red():
    vehicle = FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0})
    vehicle.refuse_writing = {"COM_OF_LOSS_T"}
    diagnosis = await diagnose(vehicle)
    write = vehicle.write

    async def stubborn(name, value):
        await write(name, value)
        vehicle.values["COM_OBL_RC_ACT"] = 0

    vehicle.write = stubborn
    after = mended(diagnosis, await mend(vehicle, changes(diagnosis)))
    assert [line.light for line in after.lines if line.group == doctor.MENDING] == [Light.RED, Light.RED]
    assert verdicts(after)["COM_OF_LOSS_T"] is verdicts(after)["COM_OBL_RC_ACT"] is Verdict.DIFFERS
    assert "kept 0" in text_of(after)


def test_a_visit_asks_before_it_writes_and_always_gives_the_link_back():
    def visited(confirm, vehicle):
        return visit(lambda _: vehicle, Config(), Profile.CAGE, confirm)

    def bad():
        return FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0})

    asked = []
    unasked, declined, agreed, good = bad(), bad(), bad(), FakeVehicle()
    assert visited(None, unasked).light is Light.RED
    assert visited(lambda todo: bool(asked.append(todo)), declined).light is Light.RED
    assert visited(lambda todo: True, agreed).light is Light.GREEN
    assert visited(lambda todo: pytest.fail("nothing to ask for"), good).light is Light.GREEN
    assert [len(vehicle.written) for vehicle in (unasked, declined, agreed, good)] == [0, 0, 1, 0]
    assert [change.parameter.name for change in asked[0]] == ["COM_OF_LOSS_T"]
    assert all(vehicle.closed for vehicle in (unasked, declined, agreed, good))


def test_a_visit_to_an_armed_vehicle_writes_nothing():
    vehicle = FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0})
    vehicle.state["armed"] = True
    diagnosis = visit(lambda _: vehicle, Config(), Profile.CAGE, lambda todo: True)
    assert vehicle.written == []
    assert line_of(diagnosis, "refused").light is Light.RED
    assert vehicle.closed


async def test_json_has_every_parameter_and_its_reason():
    diagnosis = await diagnose(FakeVehicle(good_values() | {"COM_OF_LOSS_T": 1.0}))
    told = json.loads(json.dumps(diagnosis_json(diagnosis), allow_nan=False))
    assert (told["light"], told["profile"]) == ("red", "cage")
    assert {p["name"] for p in told["parameters"]} == set(verdicts(diagnosis))
    loss = next(p for p in told["parameters"] if p["name"] == "COM_OF_LOSS_T")
    assert loss["value"] == 1.0 and loss["write"] == 0.5 and loss["verdict"] == "differs"
    assert all(p["why"] and p["term"] for p in told["parameters"])
    assert {"vehicle", "telemetry"} == {line["group"] for line in told["lines"]}


@pytest.mark.parametrize(
    ("spoilt", "arguments", "answer", "status", "written"),
    [
        ({}, [], "", 0, 0),
        ({"EKF2_BARO_CTRL": 0}, [], "", 0, 0),
        ({"COM_OF_LOSS_T": 1.0}, [], "", 1, 0),
        ({"COM_OF_LOSS_T": 1.0}, ["--fix"], "n\n", 1, 0),
        ({"COM_OF_LOSS_T": 1.0}, ["--fix"], "y\n", 0, 1),
        ({"COM_OF_LOSS_T": 1.0}, ["--fix", "--yes"], "", 0, 1),
        ({"COM_OF_LOSS_T": 1.0}, ["--fix"], "", 1, 0),
    ],
)
def test_the_command(monkeypatch, tmp_path, spoilt, arguments, answer, status, written):
    vehicle = FakeVehicle(good_values() | spoilt)
    monkeypatch.setattr(doctor_command, "Px4Link", lambda config: vehicle)
    result = CliRunner().invoke(cli.cli, ["doctor", "--only", "vehicle", *arguments], input=answer)
    assert result.exit_code == status, result.output
    assert len(vehicle.written) == written
    assert ("COM_OF_LOSS_T: 1 → 0.5" in result.output) is ("--fix" in arguments)
    assert vehicle.closed


def test_the_command_takes_connection_profile_and_json(monkeypatch, tmp_path):
    vehicle, seen = FakeVehicle(good_values(profile=Profile.PILOT)), []
    monkeypatch.setattr(doctor_command, "Px4Link", lambda config: seen.append(config.link.connection) or vehicle)
    out = tmp_path / "found.json"
    arguments = [
        "doctor",
        "--only",
        "vehicle",
        "--connect",
        "udpin://127.0.0.1:24999",
        "--profile",
        "pilot",
        "--json",
        str(out),
    ]
    assert CliRunner().invoke(cli.cli, arguments).exit_code == 0
    assert seen == ["udpin://127.0.0.1:24999"]
    assert json.loads(out.read_text())["profile"] == "pilot"


def test_yes_without_fix_is_bad_input():
    assert isinstance(CliRunner().invoke(cli.cli, ["doctor", "--yes"]).exception, BadInputError)


async def test_a_stamp_of_the_future_or_of_nothing_is_not_taken_for_news():
    vehicle = FakeVehicle()
    await vehicle.connect()
    now = asyncio.get_running_loop().time()
    odd = replace(vehicle.status.latest, stamp=math.nan)
    assert [line.light for line in examination.status(odd, now, Config())] == [Light.RED]
    assert [line.light for line in examination.status(None, now, Config())] == [Light.RED]
