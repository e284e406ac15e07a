"""`flightapp plan`, through the command line."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flightapp import cli
from flightapp.track import load_track
from flightapp.trajectory_files import load_trajectory

TRACKS = Path(__file__).parent.parent / "missions" / "tracks"
FIVE_GATES, LEMNISCATE = str(TRACKS / "five_gates.toml"), str(TRACKS / "lemniscate.toml")
STRAIGHT = """
name = "straight"
waypoints = [[4.0, 0.0, 1.5]]
finish = [8.0, 0.0, 1.5]
[start]
position = [0.0, 0.0, 1.0]
"""
WALL = '[[obstacles]]\nname = "wall"\ncentre = [2.0, 0.0, 20.0]\nsize = [0.4, 80.0, 40.0]\n'
GATE = "[[gates]]\nid = {}\nposition = [4.0, 0.0, 1.5]\nyaw_deg = 0.0\nmarkers = [{}]\n"
SAME_PLACE = STRAIGHT + '[gate]\nlayout = "top"\n' + GATE.format(1, 1) + GATE.format(2, 2)


@pytest.fixture
def plan(tmp_path, monkeypatch, capsys):
    """Runs `flightapp plan` in this process and an empty directory: exit status, standard output and error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["flightapp", "plan", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A directory with what one plan leaves."""
    directory = tmp_path_factory.mktemp("plan")
    options = ["--v-max", "3", "--out", "line.csv", "--out", "new/line.mcap", "--json", "plan.json"]
    command = [sys.executable, "-m", "flightapp.cli", "plan", FIVE_GATES, *options]
    ended = subprocess.run(command, cwd=directory, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    return directory, ended.stdout


def test_a_plan_is_told_and_kept(flown):
    directory, told = flown
    for name in ("Plan of five_gates", "speed, m/s", "body rate, rad/s", "offset m", "written: line.html"):
        assert name in told
    line = load_trajectory(directory / "line.csv")
    assert line.coefficients.tobytes() == load_trajectory(directory / "new" / "line.mcap").coefficients.tobytes()
    track = load_track(Path(FIVE_GATES))
    assert line.gate_ids == tuple(gate.id for gate in track.gates)
    x, y, _ = track.start.position
    np.testing.assert_allclose(line.sample(0.0).position, (x, y, 1.5), atol=1e-9)
    np.testing.assert_allclose(line.sample(line.duration).position, track.finish, atol=1e-6)
    assert 2.5 < line.limits().speed <= 3.003


def test_the_numbers_are_those_of_the_trajectory(flown):
    directory, _ = flown
    line = load_trajectory(directory / "line.csv")
    told = json.loads((directory / "plan.json").read_text())
    assert (told["track"], told["planner"]) == ("five_gates", "race")
    assert told["duration"] == line.duration
    path = line.sample(np.linspace(0.0, line.duration, 20000)).position
    assert told["length"] == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).sum(), rel=1e-4)
    peaks = {row["name"]: row for row in told["limits"]}
    assert peaks["speed"] == {"name": "speed", "peak": line.limits().speed, "limit": 3.0, "kept": True}
    for gate, told_gate in zip(load_track(Path(FIVE_GATES)).gates, told["gates"], strict=True):
        at = line.sample(told_gate["time"])
        assert told_gate["offset"] == pytest.approx(np.linalg.norm(at.position - gate.position), abs=1e-9)
        assert told_gate["speed"] == pytest.approx(np.linalg.norm(at.velocity))
        direction = np.array((np.cos(gate.yaw), np.sin(gate.yaw), 0.0))
        assert np.cos(told_gate["angle"]) == pytest.approx(direction @ at.velocity / told_gate["speed"])


def test_the_page_has_the_drawing_and_needs_no_network(flown):
    directory, _ = flown
    html = (directory / "line.html").read_text(encoding="utf-8")
    for name in ("line", "above", "vehicle"):
        assert f'id="figure-{name}"' in html
    for gate in range(1, 6):
        assert f'"gate {gate}"' in html
    without_library = re.sub(r"<script>.*?</script>", "", html, count=1, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href)\s*=\s*"?https?:', without_library)


def test_waypoints_laps_and_samples(plan, tmp_path):
    status, told, _ = plan(LEMNISCATE, "--laps", "2", "--out", "samples.csv", "--rate", "50", "--v-max", "inf")
    assert status == 0
    assert "Gates" not in told
    rows = list(csv.DictReader((tmp_path / "samples.csv").open()))
    assert float(rows[1]["time"]) == 0.02
    x = np.array([float(row["x"]) for row in rows])
    assert np.count_nonzero((x[:-1] < 5.0) & (x[1:] >= 5.0)) == 2


def test_the_page_goes_to_runs_when_nothing_else_is_said(plan, tmp_path):
    (tmp_path / "straight.toml").write_text(STRAIGHT)
    status, told, _ = plan("straight.toml", "--set", "planning.yaw=fixed")
    assert status == 0
    assert "written: runs/plan-straight.html" in told
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["plan-straight.html"]


BAD = {
    "a missing track": (["none.toml"], "none.toml: there is no such track"),
    "an unknown planner": ([FIVE_GATES, "--planner", "polinomial"], "did you mean 'polynomial'?"),
    "v_max 0": ([FIVE_GATES, "--v-max", "0"], "--v-max 0: must be more than 0 m/s"),
    "v_max NaN": ([FIVE_GATES, "--v-max", "nan"], "--v-max nan: must be more than 0 m/s"),
    "a_max below 0": ([FIVE_GATES, "--a-max", "-1"], "--a-max -1: must be more than 0 m/s²"),
    "a suffix": ([FIVE_GATES, "--out", "line.txt"], "--out line.txt: the file must end in .csv, .mcap or .html"),
    "a rate of nothing": ([FIVE_GATES, "--rate", "100"], "--rate 100: is for a file of samples"),
    "a rate of 0": ([FIVE_GATES, "--rate", "0", "--out", "a.csv"], "--rate 0: must be more than 0 and"),
    "a setting": ([FIVE_GATES, "--set", "planning.yaw=backwards"], "planning.yaw"),
    "a vehicle": ([FIVE_GATES, "--vehicle", "none.toml"], "none.toml: there is no such vehicle file"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_told_in_one_paragraph(plan, tmp_path, name):
    arguments, expected = BAD[name]
    status, _, error = plan(*arguments)
    assert status == 2
    assert expected in error
    assert len(error.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_record_is_not_overwritten(plan, tmp_path):
    (tmp_path / "flight.mcap").write_bytes(b"precious")
    status, _, error = plan(FIVE_GATES, "--out", "flight.mcap")
    assert status == 2
    assert "choose another name" in error
    assert (tmp_path / "flight.mcap").read_bytes() == b"precious"


@pytest.mark.parametrize("option", ["--out", "--json"])
def test_where_nothing_can_be_written_is_told(plan, tmp_path, option):
    (tmp_path / "straight.toml").write_text(STRAIGHT)
    (tmp_path / "file").write_text("")
    status, _, error = plan("straight.toml", option, "file/line.csv")
    assert status == 2
    assert f"{option} file/line.csv: " in error
    assert len(error.strip().splitlines()) == 1


def test_no_plan_is_exit_status_1(plan, tmp_path):
    (tmp_path / "same.toml").write_text(SAME_PLACE)
    status, _, error = plan("same.toml")
    assert status == 1
    assert error.startswith("no plan: ")
    assert "gate 1" in error and "gate 2" in error


def test_a_plan_into_an_obstacle_is_none_to_be_flown(plan, tmp_path):
    (tmp_path / "blocked.toml").write_text(STRAIGHT + WALL)
    status, told, error = plan("blocked.toml")
    assert status == 1
    assert "'wall'" in told + error
