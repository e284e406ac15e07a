"""Modules side by side."""

import json

import pytest
from hops import hops
from test_campaign import answers
from typer.testing import CliRunner

from flightapp.campaign import fly
from flightapp.campaign.run import fly_run
from flightapp.cli import cli
from flightapp.commands.compare import runs_with
from flightapp.inputs import BadInputError


def flown(run):
    """Every second seed of mpc misses its gate."""
    modules = dict(run.parameters)
    mpc = modules["controller"] == "mpc"
    error = 0.01 * run.plan.seed + (0.1 if mpc else 0.0)
    passed = not (mpc and run.plan.seed % 2)
    summary = {
        "outcome": "GOAL_ACHIEVED",
        "gates": [{"id": 1, "passed": passed, "offset": error}],
        "collisions": [],
        "elapsed": 10.0 + run.plan.seed,
        **{name: {"total": error} for name in ("tracking_rmse", "tracking_rmse_truth", "estimation_rmse")},
    }
    return json.dumps(run.known | {"summary": summary, "reason": ""} | ({"fallbacks": 4} if mpc else {}))


def test_one_row_for_each_combination_over_the_same_seeds(tmp_path, monkeypatch):
    (run,) = hops(tmp_path, 1)
    do, seeds = answers(flown)
    monkeypatch.setattr(fly, "work", do)
    words = ["compare", str(run.plan.mission), "--planner", "polynomial, race", "--controller", "paper,mpc"]
    answered = CliRunner().invoke(cli, [*words, "--runs", "3", "--first-seed", "1", "--out", str(tmp_path / "out")])
    assert answered.exit_code == 0, answered.output
    assert seeds == [1, 2, 3] * 4
    compared = json.loads((tmp_path / "out" / "compare.json").read_text())
    points = {tuple(point["parameters"].values()): point for point in compared["points"]}
    assert list(points) == [("polynomial", "paper"), ("polynomial", "mpc"), ("race", "paper"), ("race", "mpc")]
    paper, mpc = points["race", "paper"], points["race", "mpc"]
    assert (paper["successes"], mpc["successes"]) == (3, 1)
    assert paper["tracking_rmse_truth"] == pytest.approx(0.02)
    assert mpc["estimation_rmse"] == pytest.approx(0.12)
    assert (paper["fallbacks"], mpc["fallbacks"]) == (None, 4.0)
    assert mpc["failures"][0]["command"].endswith("planning.planner=race --set control.controller=mpc --seed 1")
    assert "by truth" in answered.output
    assert 'id="figure-errors"' in (tmp_path / "out" / "compare.html").read_text()


def test_unknown_names_are_told_with_those_that_there_are(tmp_path):
    (run,) = hops(tmp_path, 1)
    with pytest.raises(BadInputError, match=r"no 'ract' among the planners; did you mean 'race'\? known: optimal, pol"):
        runs_with(run.plan, {"planner": "race,ract"}, 1)
    with pytest.raises(BadInputError, match="--planner, --controller, --estimator, --detector"):
        runs_with(run.plan, {}, 1)


def test_commands_of_a_controller_that_stands_in_are_counted(tmp_path):
    (mpc, plain) = (hops(tmp_path, 1, f"control.controller={name}")[0] for name in ("mpc", "flatness"))
    assert json.loads(fly_run(mpc))["fallbacks"] >= 0
    assert "fallbacks" not in json.loads(fly_run(plain))
