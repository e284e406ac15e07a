"""Scores of vehicle files, over simulated vehicles."""

from pathlib import Path

import pytest

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.tune_command import TuneOptions, tune, tuned_json, with_gains, write_gains
from flightapp.tuning.score import LOST, Draw, score
from sim.bench import course
from sim.mismatch import Mismatch
from sim.scoring import Scorer

ROOT = Path(__file__).parents[2]
RACER = ROOT / "config" / "sim_racer.toml"
CONFIG = load_config(RACER)
LINE = course(1)


def test_a_score_counts_who_was_lost():
    flown = score([Draw(1, 0.1, 0.2), Draw(2, 0.3, 0.4)])
    assert (flown.mean, flown.worst, flown.peak, flown.lost) == (pytest.approx(0.2), 0.3, 0.4, 0)
    assert flown.cost == pytest.approx(0.25)
    with_lost = score([Draw(1, 0.1, 0.2), Draw(3, LOST, 4.0, "off the line")])
    assert (with_lost.mean, with_lost.worst, with_lost.lost) == (0.1, LOST, 1)
    assert with_lost.cost > flown.cost


def test_a_draw_flies_the_same_every_time_and_another_flies_another_way():
    fly = Scorer(LINE)
    assert fly(CONFIG, 3) == fly(CONFIG, 3)
    assert fly(CONFIG, 3).rmse != fly(CONFIG, 4).rmse
    assert not fly(CONFIG, 3).lost and fly(CONFIG, 3).rmse < 0.3


def test_the_vehicle_as_its_file_says_is_tracked_best():
    plain = Scorer(LINE, lambda seed: Mismatch())(CONFIG, 1)
    heavy = Scorer(LINE, lambda seed: Mismatch(mass=1.2))(CONFIG, 1)
    assert plain.rmse < 0.05
    assert heavy.rmse > 1.5 * plain.rmse


def test_hopeless_gains_are_told():
    worse = with_gains(CONFIG, {"position_bandwidth": 20.0, "position_damping": 0.11, "attitude_bandwidth": 40.0})
    draw = Scorer(LINE)(worse, 1)
    assert draw.lost
    assert draw.rmse == LOST


def test_tuning_mends_gains_that_are_off(tmp_path):
    text = RACER.read_text() + "\n[control]\nposition_bandwidth = 1.2  # too soft\nattitude_bandwidth = 4.0\n"
    (tmp_path / "soft.toml").write_text(text)
    options = TuneOptions(tmp_path / "soft.toml", ROOT / "missions" / "lemniscate.py", runs=3, search=14)
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
