"""The service as a whole: in this process in virtual time, and as its own process on the wall clock."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from notify_socket import notify_socket

from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.recording.reader import read_flight
from flightapp.service import client
from flightapp.service.daemon import Service, ServiceOptions
from flightapp.service.journal import Journal
from flightapp.service.notify import Notifier
from flightapp.service.protocol import Abort, Reload, Start, Status, Stop, Tunables, Tune

ROOT = Path(__file__).parents[2]
MISSION = """
import time
TRACK = "{track}"
SETTINGS = {{"sim.camera": "corners"}}
PARAMETERS = {{"seconds": 1.0, "load": 0.0}}
{more}

async def mission(drone):
    await drone.takeoff()
    await drone.hover(drone.parameters["seconds"])
    await drone.land()
"""


@pytest.fixture
def place(tmp_path):
    """A directory with missions, from which alone the service takes them."""
    track = ROOT / "missions" / "tracks" / "lemniscate.toml"
    for name, more in {"up": "", "broken": "1 / 0", "long": "time.sleep(60.0)"}.items():
        (tmp_path / f"{name}.py").write_text(MISSION.format(track=track, more=more))
    return tmp_path.resolve()


def serve_while(place, script, heard_at=None):
    """Serve in this process, its main thread, while ``script`` runs beside it; then SIGTERM."""
    path, failures = place / "control.sock", []
    notifier = Notifier({"NOTIFY_SOCKET": heard_at, "WATCHDOG_USEC": "2000000"} if heard_at else {})

    def beside():
        try:
            until = time.monotonic() + 20.0
            while not path.is_socket() and time.monotonic() < until:
                time.sleep(0.01)
            script(path)
        except BaseException as error:
            failures.append(error)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)

    with (place / "journal").open("w", encoding="utf-8") as stream:
        journal = Journal(stream)
        options = ServiceOptions(path, "sim", (place,), place / "runs", realtime=False)
        thread = threading.Thread(target=beside)
        before = signal.getsignal(signal.SIGTERM)
        service = Service(options, notifier, journal)
        thread.start()
        service.run()
        thread.join()
        journal.close()
        notifier.close()
    assert signal.getsignal(signal.SIGTERM) is before
    assert not path.exists()
    if failures:
        raise failures[0]
    return (place / "journal").read_text()


def until_over(path, run):
    """How the flight ``run`` ended; where nothing has flown before, kernels are compiled first, which takes minutes."""
    until = time.monotonic() + 600.0
    while time.monotonic() < until:
        told = client.ask(Status(), path)
        if told["last"] is not None and told["last"]["run"] == run:
            return told["last"]
        time.sleep(0.02)
    raise AssertionError("it does not end")


def test_a_session(place):
    told = {}

    def script(path):
        told["idle"] = client.ask(Status(), path)
        told["nothing"] = [client.ask(one, path)["error"] for one in (Stop(), Abort(), Tunables(), Reload())]
        told["tune"] = client.ask(Tune(settings={"control.yaw_bandwidth": "2"}), path)["error"]
        outside = ROOT / "missions" / "lemniscate.py"
        told["outside"] = client.ask(Start(mission=str(outside)), path)["error"]
        told["broken"] = client.ask(Start(mission=str(place / "broken.py")), path)["error"]
        told["refused_start"] = client.ask(Status(), path)
        told["typo"] = client.ask(Start(mission=str(place / "up.py"), settings=("race.vmax=3",)), path)["error"]
        # Two flights, one after the other: the service goes on.
        for name, seconds in {"first": 1.0, "second": 600.0}.items():
            settings = (f"mission.parameters.seconds={seconds}",)
            begun = client.ask(Start(mission=str(place / "up.py"), settings=settings, seed=2), path)
            told["busy"] = client.ask(Start(mission=str(place / "up.py")), path)
            if name == "second":
                while (client.ask(Status(), path)["flight"] or {}).get("behaviors") != ["hover"]:
                    time.sleep(0.01)
                told["tuned"] = client.ask(Tune(settings={"control.yaw_bandwidth": "2"}), path)
                told["refused"] = client.ask(Tune(settings={"control.yaw_bandwith": "2"}), path)["error"]
                told["fields"] = client.ask(Tunables(), path)["fields"]
                told["stopped"] = client.ask(Stop(), path)
            told[name] = until_over(path, begun["run"])

    journal = serve_while(place, script)
    assert told["idle"] == {"ok": True, "state": "idle", "flight": None, "last": None, "stopping": ""}
    assert told["refused_start"] == told["idle"]
    assert all("nothing flies" in error for error in told["nothing"])
    assert "nothing flies" in told["tune"]
    assert "takes files from" in told["outside"] and str(place) in told["outside"]
    assert "broken.py:6: ZeroDivisionError" in told["broken"]
    assert "did you mean 'v_max'" in told["typo"]
    assert "one flight at a time: up is" in told["busy"]["error"]
    assert told["first"] == {
        "mission": "up",
        "run": str(place / "runs" / "up-2-1"),
        "outcome": "GOAL_ACHIEVED",
        "reason": "mission complete",
        "failed": "",
    }
    assert told["tuned"] == {"ok": True, "text": "retuned: control.yaw_bandwidth 3.0 → 2.0"}
    assert "did you mean 'yaw_bandwidth'" in told["refused"]
    yaw = next(field for field in told["fields"] if field["key"] == "control.yaw_bandwidth")
    assert (yaw["value"], yaw["start"], yaw["bounds"]) == (2.0, 3.0, "> 0.1, ≤ 20")
    assert told["stopped"] == {"ok": True, "text": "it lands"}
    second = told["second"]
    assert second["outcome"] == "INTERRUPTED" and second["reason"].startswith("stop asked for by")
    flight = read_flight(Path(second["run"]) / "flight.mcap")
    tuned = [event for event in flight.events if event.kind == "tuning"]
    assert [event.text.partition(":")[0] for event in tuned] == ["retuned", "not retuned"]
    tick = 1.0 / Config().control.rate
    for event in tuned:
        around = flight.commands.stamp[np.abs(flight.commands.stamp - event.stamp) < 0.3]
        assert np.diff(around).max() < 1.01 * tick
    for run in (told["first"]["run"], second["run"]):
        assert json.loads((Path(run) / "summary.json").read_text())["outcome"]
        assert (Path(run) / "report.html").is_file()
        assert not read_flight(Path(run) / "flight.mcap").statuses[-1].armed
    assert "up: GOAL_ACHIEVED: mission complete" in journal and "ended by SIGTERM" in journal


@pytest.mark.parametrize("mission", ["", "long"])
def test_the_end_does_not_wait_for_what_does_not_fly(place, mission):
    """Neither for a mission that never comes nor for one that takes long to be loaded."""

    def script(path):
        if mission:
            with socket.socket(socket.AF_UNIX) as connection:
                connection.connect(str(path))
                connection.sendall(json.dumps({"do": "start", "mission": str(place / "long.py")}).encode() + b"\n")
                while client.ask(Status(), path)["state"] != "preparing":
                    time.sleep(0.01)
                time.sleep(0.3)
        begun.append(time.monotonic())

    begun = []
    serve_while(place, script)
    assert time.monotonic() - begun[0] < 20.0
    assert not (place / "runs").exists()


def test_the_watchdog_is_fed_while_waiting_and_a_reload_is_told(place):
    def script(path):
        assert heard.wait("READY=1\nSTATUS=waiting for a mission")
        assert heard.wait("WATCHDOG=1")
        assert client.ask(Reload(), path)["error"].startswith("nothing flies")
        os.kill(os.getpid(), signal.SIGHUP)
        assert heard.wait("RELOADING=1\nMONOTONIC_USEC=")
        heard.messages.remove("READY=1\nSTATUS=waiting for a mission")
        assert heard.wait("READY=1")

    with notify_socket(str(place / "notify")) as heard:
        serve_while(place, script, str(place / "notify"))
    assert heard.messages.count("STOPPING=1") == 1


@contextmanager
def service_process(place, heard_at, *options):
    environment = {
        **os.environ,
        "NOTIFY_SOCKET": heard_at,
        "WATCHDOG_USEC": "2000000",
        "FLIGHTAPP_SOCKET": str(place / "control.sock"),
    }
    environment.pop("WATCHDOG_PID", None)
    command = [sys.executable, "-m", "flightapp.cli", "serve", "--sim", "--realtime", "--from", str(place)]
    command += ["--runs", str(place / "runs"), "--from", str(ROOT / "missions"), *options]
    with (place / "journal").open("w") as out, subprocess.Popen(command, env=environment, stderr=out) as process:
        try:
            yield process, environment
        finally:
            process.kill()


def command(environment, *arguments):
    line = [sys.executable, "-m", "flightapp.cli", *arguments]
    return subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.wall_clock
def test_sigterm_in_flight_lands_and_ends_well(place):
    settings = ("--set", "sim.camera=corners", "--set", "race.v_max=1")
    with (
        notify_socket(str(place / "notify")) as heard,
        service_process(place, str(place / "notify"), *settings) as (process, environment),
    ):
        assert heard.wait("READY=1", 60.0), (place / "journal").read_text()
        started = command(environment, "start", str(ROOT / "missions" / "five_gates.py"))
        assert started.returncode == 0, started.stderr
        status = heard.wait("five_gates: flying, race, gate 1 of 5, ", 60.0)
        assert status is not None and "no faults" in status, heard.messages
        heard.messages.clear()
        assert heard.wait("WATCHDOG=1", 5.0)
        tuned = command(environment, "tune", "set", "control.yaw_bandwidth", "2.5")
        assert (tuned.returncode, tuned.stdout) == (0, "retuned: control.yaw_bandwidth 3.0 → 2.5\n")
        refused = command(environment, "tune", "set", "control.yaw_bandwidth=2", "vehicle.mass=2")
        assert refused.returncode == 1 and "may not change in flight: vehicle.mass" in refused.stderr
        told = json.loads(command(environment, "status", "--json").stdout)
        assert told["state"] == "flying" and told["flight"]["gates"][1] == 5 and told["flight"]["faults"] == []
        process.send_signal(signal.SIGTERM)
        time.sleep(1.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0, (place / "journal").read_text()
    assert heard.messages.count("STOPPING=1") == 1
    run = next((place / "runs").iterdir())
    flight = read_flight(run / "flight.mcap")
    assert not flight.statuses[-1].armed and flight.statuses[-1].landed
    assert json.loads((run / "summary.json").read_text())["outcome"] == "INTERRUPTED"
    with suppress(BadInputError):
        raise AssertionError(client.ask(Status(), place / "control.sock"))


class Stuck:
    """A stream that takes nothing before it may, and fails at the end."""

    def __init__(self):
        self.may, self.lines = threading.Event(), []

    def write(self, text):
        self.may.wait(10.0)
        self.lines.append(text)

    def flush(self):
        raise OSError(28, "No space left on device")


def test_a_journal_that_is_stuck_holds_nothing_up_and_keeps_the_newest(monkeypatch):
    monkeypatch.setenv("JOURNAL_STREAM", "8:1")
    stuck = Stuck()
    journal = Journal(stuck)
    begun = time.monotonic()
    for k in range(5000):
        journal.write(f"line\n{k}", 3)
    assert time.monotonic() - begun < 5.0
    stuck.may.set()
    journal.close()
    assert 1000 <= len(stuck.lines) <= 1002 and stuck.lines[-1] == "<3>line 4999\n"
