"""Every experiment of the paper from one command, with flights that are made up."""

import json
import math

import pytest
from test_campaign import answers
from typer.testing import CliRunner

from flightapp.campaign import fly
from flightapp.cli import cli
from flightapp.commands import paper as paper_command

MOMENTS = 40
ERRORS = ("tracking_rmse", "tracking_rmse_truth", "speed_rmse", "speed_rmse_truth", "estimation_rmse", "tracker_rmse")


def flown(run):
    error = {"x": 0.01, "y": 0.01, "z": 0.01, "total": 0.0173}
    summary = {"outcome": "GOAL_ACHIEVED", "gates": [], "collisions": [], "v_peak": 1.0, "v_avg": 0.5, "elapsed": 3.0}
    summary |= dict.fromkeys(ERRORS, error)
    if run.label == "four_gates_real v_max=1":
        summary["outcome"] = "WRONG_PROGRESS"
    result = run.known | {"summary": summary, "reason": ""}
    if run.traced:
        rows = [[math.sin(0.1 * n), math.cos(0.1 * n), 1.0] for n in range(MOMENTS)]
        motion = {"position": rows, "velocity": rows}
        time = [0.1 * n for n in range(MOMENTS)]
        gates = [[2.0, 0.0, 1.5, 0.3]]
        result["trace"] = {"time": time, "reference": motion, "estimate": motion, "truth": motion, "gates": gates}
    return json.dumps(result)


@pytest.fixture
def seeds(monkeypatch):
    do, asked = answers(flown)
    monkeypatch.setattr(fly, "work", do)
    row = {"name": "plan_6", "count": 1, "p50": 1e-3, "p99": 1e-3, "paper_i7": 0.01371, "paper_jetson": 0.05147}
    monkeypatch.setattr(paper_command, "profile", lambda: [row])
    return asked


def call(*words):
    answered = CliRunner().invoke(cli, ["paper", *words])
    assert answered.exit_code == 0, answered.output
    return answered.output


def test_every_table_and_figure_is_there(tmp_path, seeds):
    printed = call("--out", str(tmp_path), "--seeds", "2", "--first-seed", "5")
    assert set(seeds) == {5, 6}
    told = json.loads((tmp_path / "paper.json").read_text())
    assert list(told["tables"]) == [str(number) for number in range(1, 15)]
    (slow, *_) = told["tables"]["8"]
    assert (slow["v_max"], slow["flights"], slow["good"]) == (1.0, 2, 2)
    assert slow["ratio"]["elapsed"] == pytest.approx(3.0 / 127.6)
    half, failed, *beyond = told["tables"]["12"]
    assert half["good"] == 2
    assert (failed["good"], failed["ours"]["total"]) == (0, None)
    assert failed["why"] == ["2 of 2 flights failed: 2 × WRONG_PROGRESS"]
    assert {row["vehicle"] for row in beyond} == {"f330", "racer"}
    assert all(row["paper"] is None for row in beyond)
    assert "Table 14" in printed
    page = (tmp_path / "paper.html").read_text()
    for name in ("3a", "3b", "3c", "3d", "4a", "4b", "4c", "4d", "5", "6", "7", "8", "9"):
        assert f'id="figure-fig{name}"' in page, name
    assert (tmp_path / "paper.tex").read_text().count(r"\bottomrule") == 14
    assert (tmp_path / "paper.csv").read_text().startswith("table,v_max,vehicle")
    assert "WRONG_PROGRESS" in (tmp_path / "paper.md").read_text()


def test_only_what_is_asked_for_is_flown(tmp_path, seeds):
    call("--out", str(tmp_path), "--seeds", "1", "--only", "table7")
    assert len(seeds) == 4
    assert list(json.loads((tmp_path / "paper.json").read_text())["tables"]) == ["7"]


def test_on_the_jetson_the_limit_is_flown_too(tmp_path, seeds):
    printed = call("--out", str(tmp_path), "--seeds", "1", "--only", "table13", "--compute", "jetson")
    told = json.loads((tmp_path / "paper.json").read_text())
    assert len(seeds) == 7 + 18
    assert {case["v_max"] for case in told["limit"]} == {1.0, 2.0, 4.0}
    times = {case["planner"]: case["settings"] for case in told["limit"]}
    assert "compute.plan=1.028" in times["the paper's, 26 points"]
    assert "control.controller=paper" in times["the paper's modules, our times"]
    assert "Four unknown gates" in printed
