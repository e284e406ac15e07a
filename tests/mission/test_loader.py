"""Loading missions."""

from pathlib import Path

import pytest

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.mission.loader import load_mission

MISSIONS = sorted((Path(__file__).parents[2] / "missions").glob("*.*"))
TRACK = "[start]\nposition = [0.0, 0.0, 0.0]\n"


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.stem)
def test_every_mission_of_the_project_loads_and_its_settings_are_valid(path):
    mission = load_mission(path)
    assert mission.name == path.stem
    assert mission.track.gates or mission.track.waypoints
    load_config(None, mission.settings)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 / 0\n", "m.py:1: ZeroDivisionError"),
        ("import nothing_like_this\n", "ModuleNotFoundError"),
        ("def mission(drone): pass\n", "async def mission"),
        ("async def mission(drone): pass\n", "needs TRACK"),
        ("TRACK = 't.toml'\nSETTINGS = 3\nasync def mission(drone): pass\n", "SETTINGS must be"),
        ("TRACK = 'none.toml'\nasync def mission(drone): pass\n", "no such track file"),
    ],
)
def test_a_bad_mission_is_told_by_file_and_line(tmp_path, text, expected):
    path = tmp_path / "m.py"
    path.write_text(text)
    (tmp_path / "t.toml").write_text('name = "t"\nwaypoints = [[0.0, 0.0, 1.0]]\n' + TRACK)
    with pytest.raises(BadInputError, match=expected):
        load_mission(path)


STEP = '[[steps]]\ndo = "takeoff"\n'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("track = 't.toml'\nsteps = []\n", "m.toml: 'steps'"),
        (STEP, "m.toml: 'track' is missing"),
        ("track = 't.toml'\n" + STEP + "height = 'high'\n", "step 1: behavior takeoff: 'height' = 'high'"),
        ("track = 't.toml'\n" + STEP + "heigth = 2.0\n", "step 1: .*unknown key 'heigth'; did you mean 'height'"),
        ("track = 't.toml'\n" + STEP + '[[steps]]\ndo = "hovver"\n', "step 2: .*did you mean 'hover'"),
        ("track = 't.toml'\n" + STEP + "on_failure = 'cry'\n", "on_failure"),
        ("track = 't.toml'\nsteps = 3\n", "m.toml: 'steps' = 3"),
    ],
)
def test_a_bad_list_of_steps_is_told_by_step(tmp_path, text, expected):
    path = tmp_path / "m.toml"
    path.write_text(text)
    (tmp_path / "t.toml").write_text('name = "t"\nwaypoints = [[0.0, 0.0, 1.0]]\n' + TRACK)
    with pytest.raises(BadInputError, match=expected):
        load_mission(path)


@pytest.mark.parametrize("value", ["3", "[1]", "{1: 2}", '{"a": None}'])
def test_parameters_that_are_none_are_told(tmp_path, value):
    path = tmp_path / "m.py"
    path.write_text(f"TRACK = 't.toml'\nPARAMETERS = {value}\nasync def mission(drone): pass\n")
    with pytest.raises(BadInputError, match="PARAMETERS must be a dict"):
        load_mission(path)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("mission.parameters.round=1", "has no parameter 'round'; it has fast, rounds"),
        ("mission.parameters.rounds=true", "of the type int"),
        ("mission.parameters.fast=1", "of the type bool"),
    ],
)
def test_parameters_are_what_the_mission_says(tmp_path, setting, words):
    path = tmp_path / "m.py"
    path.write_text("TRACK = 't.toml'\nPARAMETERS = {'rounds': 2, 'fast': False}\nasync def mission(drone): pass\n")
    (tmp_path / "t.toml").write_text('name = "t"\nwaypoints = [[0.0, 0.0, 1.0]]\n' + TRACK)
    with pytest.raises(BadInputError, match=words):
        load_mission(path).set_parameters(load_config(None, None, [setting]))
