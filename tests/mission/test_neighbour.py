"""A package of somebody else adds a planner and a behavior by entry points, and a mission uses both."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from neighbours import installed

from flightapp.recording.reader import read_flight

HERE = Path(__file__).parent
MISSION = """
TRACK = "{track}"
SETTINGS = {{"planning.planner": "gentle", "race.v_max": 3.0, "sim.camera": "corners"}}


async def mission(drone):
    await drone.takeoff(1.5)
    await drone.run("circle", radius=2.0)
    await drone.land()
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """The environment of a process that finds the neighbour installed."""
    return installed(HERE / "neighbour", tmp_path_factory.mktemp("site"))


def flightapp(environment, *words):
    program = [sys.executable, "-m", "flightapp.cli", *words]
    return subprocess.run(program, env=environment, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture
def mission(tmp_path):
    path = tmp_path / "circling.py"
    path.write_text(MISSION.format(track=HERE.parents[1] / "missions" / "tracks" / "pad.toml"))
    return path


def test_a_mission_flies_with_a_neighbour_s_planner_and_behavior(environment, mission, tmp_path):
    done = flightapp(environment, "fly", str(mission), "--sim", "--out", str(tmp_path / "run"))
    assert done.returncode == 0, done.stdout + done.stderr
    flight = read_flight(tmp_path / "run" / "flight.mcap")
    aloft = flight.truth.position[flight.truth.position[:, 2] > 1.0]
    assert abs(aloft[:, 0]).max() == pytest.approx(2.0, abs=0.4)
    assert abs(aloft[:, 1]).max() == pytest.approx(2.0, abs=0.4)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["outcome"] == "GOAL_ACHIEVED"
    assert summary["v_peak"] < 1.7


def test_without_it_what_is_missing_is_named(mission):
    done = flightapp({**os.environ, "COLUMNS": "500"}, "fly", str(mission), "--dry-run")
    assert done.returncode == 2
    assert "there is no 'gentle' among the planners" in done.stderr


def test_its_parameters_are_checked_as_ours_are(environment, mission):
    mission.write_text(mission.read_text().replace("radius=2.0", "radius=0.0"))
    done = flightapp(environment, "fly", str(mission), "--dry-run")
    assert done.returncode == 1
    assert "circling.py:8: BadInputError: behavior circle: 'radius' = 0.0" in done.stdout
