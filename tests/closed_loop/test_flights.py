"""The whole application in virtual time, judged by ground truth."""

import json
import math
from pathlib import Path

import pytest

from flightapp import app, results
from flightapp.evaluation.plan_table import yardsticks
from flightapp.evaluation.summary import why_failed

MISSIONS = Path(__file__).parents[2] / "missions"
LIMITS = Path(__file__).parents[2] / "config" / "sim_limits.toml"
CORNERS = ("sim.camera='corners'",)


def fly(out, mission, seed, *overrides):
    """The summary of one flight."""
    plan = app.FlightPlan(MISSIONS / f"{mission}.py", out, overrides=overrides, seed=seed)
    return results.finish(app.fly(plan), page=False)


@pytest.mark.parametrize(
    ("mission", "seed", "overrides"),
    [
        ("five_gates", 1001, CORNERS),
        ("five_gates_loop", 1002, CORNERS),
        ("four_gates", 1003, CORNERS),
        ("one_gate", 1004, CORNERS),
        ("five_gates", 1005, (*CORNERS, "sim.gust=0.5", "sim.wind=1.0")),
        ("five_gates", 1007, (*CORNERS, "control.controller='mpcc'")),
    ],
)
def test_a_race_passes_every_gate(tmp_path, mission, seed, overrides):
    summary = fly(tmp_path / "run", mission, seed, *overrides)
    assert why_failed(summary) == "", summary
    assert all(gate["passed"] and gate["offset"] < 0.45 for gate in summary["gates"])
    assert summary["estimation_rmse"]["total"] < 1.0
    assert summary["v_peak"] > 0.5


@pytest.mark.parametrize(("mission", "v_max", "ratio"), [("four_gates", 4.0, 1.10), ("five_gates", math.inf, 1.25)])
def test_known_gates_are_flown_in_little_more_than_the_least_time(tmp_path, mission, v_max, ratio):
    (course,) = (course for course in yardsticks().courses if course.name == mission)
    least = next(least for speed, least, _ in course.optimum if speed == v_max)
    settings = (f"race.v_max={min(v_max, 25.0)}", "sim.survey='exact'", "sim.tracker='ideal'", *CORNERS)
    plan = app.FlightPlan(MISSIONS / f"{mission}.py", tmp_path / "run", vehicle=LIMITS, overrides=settings, seed=1030)
    summary = results.finish(app.fly(plan), page=False)
    assert why_failed(summary) == "", summary
    assert all(gate["passed"] and gate["offset"] < 0.5 for gate in summary["gates"])
    assert least < summary["elapsed"] <= ratio * least


def test_a_race_with_rendered_images_passes_every_gate(tmp_path):
    summary = fly(tmp_path / "run", "five_gates", 1006)
    assert why_failed(summary) == "", summary
    assert all(gate["passed"] for gate in summary["gates"])


def test_the_lemniscate_is_tracked(tmp_path):
    summary = fly(tmp_path / "run", "lemniscate", 1007)
    assert why_failed(summary) == "", summary
    assert summary["tracking_rmse"]["total"] < 0.138


def test_the_same_seed_flies_the_same_flight_to_the_last_byte(tmp_path):
    flights = [fly(tmp_path / name, "five_gates", 1008, *CORNERS) for name in ("a", "b")]
    assert flights[0] == flights[1]
    for file in ("flight.mcap", "summary.json", "config.toml", "app.log"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_another_seed_flies_another_flight(tmp_path):
    one, other = (fly(tmp_path / str(seed), "one_gate", seed, *CORNERS) for seed in (1009, 1010))
    assert one["gates"] != other["gates"]


def test_a_gate_that_is_not_there_is_searched_for_and_the_drone_lands(tmp_path):
    text = (MISSIONS / "tracks" / "one_gate.toml").read_text()
    (tmp_path / "track.toml").write_text(text.replace("position = [2.0, 0.0, 1.5]", "position = [60.0, 0.0, 1.5]"))
    (tmp_path / "m.py").write_text((MISSIONS / "one_gate.py").read_text().replace("tracks/one_gate.toml", "track.toml"))
    plan = app.FlightPlan(tmp_path / "m.py", tmp_path / "run", overrides=(*CORNERS, "race.v_max=10", "race.timeout=40"))
    summary = results.finish(app.fly(plan), page=False)
    assert summary["outcome"] in ("WRONG_PROGRESS", "TIME_OUT", "GOAL_ACHIEVED")
    assert not summary["collisions"]


def test_the_run_directory_holds_all_that_was_promised(tmp_path):
    fly(tmp_path / "run", "one_gate", 1011, *CORNERS)
    summary, page = results.report(tmp_path / "run")
    assert page.stat().st_size > 100_000
    on_disk = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert on_disk == summary
    for key in ("mission", "seed", "outcome", "elapsed", "v_peak", "v_avg", "gates", "tracking_rmse", "speed_rmse",
                "estimation_rmse", "replans", "sender", "faults"):  # fmt: skip
        assert key in summary
    lines = (tmp_path / "run" / "app.log").read_text().splitlines()
    assert all({"event", "kind", "stamp"} <= json.loads(line).keys() for line in lines)
