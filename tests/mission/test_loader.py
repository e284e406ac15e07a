"""Loading missions."""

from pathlib import Path

import pytest

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.mission.loader import load_mission

MISSIONS = sorted((Path(__file__).parents[2] / "missions").glob("*.py"))
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
