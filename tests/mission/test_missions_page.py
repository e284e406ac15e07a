"""docs/missions.md tells what there is."""

import re
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from flightapp import app
from flightapp.behaviors.base import Parameters
from flightapp.modules import find

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "missions.md").read_text(encoding="utf-8")
ROWS = {row[0]: row for row in re.findall(r"^\| `(\w+)` \| (.*?) \| (\d+) \|", PAGE, flags=re.MULTILINE)}
OURS = sorted(entry.name for entry in entry_points(group="flightapp.behaviors"))


def test_every_behavior_is_there():
    assert sorted(ROWS) == OURS


@pytest.mark.parametrize("name", OURS)
def test_its_parameters_and_its_priority_are_right(name):
    behavior = find("behaviors", name)
    own = set(behavior.accepts.model_fields) - set(Parameters.model_fields)
    assert set(re.findall(r"`(\w+)`", ROWS[name][1])) == own
    assert int(ROWS[name][2]) == behavior.priority


MISSIONS = [
    (text, suffix)
    for language, suffix in (("python", "py"), ("toml", "toml"))
    for text in re.findall(rf"```{language}\n(.*?)```", PAGE, flags=re.DOTALL)
    if re.search(r"^(?:TRACK|track) =", text, flags=re.MULTILINE)
]


@pytest.mark.parametrize(("text", "suffix"), MISSIONS)
def test_the_missions_on_it_can_be_flown(tmp_path, text, suffix):
    path = tmp_path / f"mission.{suffix}"
    path.write_text(text.replace('"tracks/', f'"{ROOT / "missions" / "tracks"}/'))
    steps, result = app.dry_run(app.FlightPlan(path, tmp_path / "run"))
    assert result.achieved, result
    assert steps[0].name == "takeoff"
    assert steps[-1].name == "land"


def test_a_mission_in_each_language_is_on_it():
    assert {suffix for _, suffix in MISSIONS} == {"py", "toml"}


def test_every_mission_that_is_there_is_on_it():
    there = {path.stem for path in (ROOT / "missions").iterdir() if path.suffix in (".py", ".toml")}
    table = PAGE.partition("## Missions that are there")[2].partition("##")[0]
    assert there == set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE))))
