"""Scores of vehicle files, over simulated vehicles."""

from pathlib import Path

import pytest

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.tune_command import TuneOptions, scored, tune, tuned_json, with_gains, write_gains
from sim.bench import course

ROOT = Path(__file__).parents[2]
RACER = ROOT / "config" / "sim_racer.toml"
CONFIG = load_config(RACER)
LINE = course(1)


def test_the_same_vehicles_score_the_same_and_others_otherwise():
    first = scored(CONFIG, LINE, 2, 3)
    assert first == scored(CONFIG, LINE, 2, 3)
    assert first.rmse != scored(CONFIG, LINE, 2, 5).rmse
    assert first.crashes == 0 and first.worst < 0.3


def test_hopeless_gains_are_told():
    worse = with_gains(CONFIG, {"position_bandwidth": 20.0, "position_damping": 0.11, "attitude_bandwidth": 40.0})
    assert scored(worse, LINE, 1, 1).crashes == 1


def test_tuning_mends_gains_that_are_off(tmp_path):
    text = RACER.read_text() + "\n[control]\nposition_bandwidth = 1.2  # too soft\nattitude_bandwidth = 4.0\n"
    (tmp_path / "soft.toml").write_text(text)
    options = TuneOptions(tmp_path / "soft.toml", ROOT / "missions" / "lemniscate.py", runs=2, search=10)
    tuned = tune(options)
    assert tuned.improved
    assert tuned.better_score.cost < 0.9 * tuned.score.cost
    write_gains(tuned, tmp_path / "new.toml")
    written = (tmp_path / "new.toml").read_text()
    assert "# too soft" in written and "tuned on lemniscate" in written
    config = load_config(tmp_path / "new.toml")
    assert {name: getattr(config.control, name) for name in tuned.better} == tuned.better
    assert config.vehicle == CONFIG.vehicle
    assert tuned_json(tuned)["found"] == tuned.better


@pytest.mark.parametrize(
    ("vehicle", "mission", "words"),
    [
        ("none.toml", "lemniscate", "no such vehicle file"),
        ("config/sim_racer.toml", "nowhere", "no such mission file"),
    ],
)
def test_what_cannot_be_scored_is_told(vehicle, mission, words):
    with pytest.raises(BadInputError, match=words):
        tune(TuneOptions(ROOT / vehicle, ROOT / "missions" / f"{mission}.py"))
