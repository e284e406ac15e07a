"""Gates of which only the markers are known, flown in virtual time and judged by ground truth."""

from pathlib import Path

import pytest

from flightapp import app, results
from flightapp.evaluation.summary import why_failed

MISSIONS = Path(__file__).parents[2] / "missions"


def fly(out, mission, seed, *overrides):
    plan = app.FlightPlan(mission, out, overrides=("sim.camera='corners'", *overrides), seed=seed)
    return results.finish(app.fly(plan), page=False)


def changed(folder, name, old, new):
    """A copy of the mission ``name`` whose track has ``new`` in place of ``old``."""
    mission = (MISSIONS / f"{name}_unknown.py").read_text(encoding="utf-8")
    track = (MISSIONS / "tracks" / f"{name}.toml").read_text(encoding="utf-8")
    assert track.count(old) == 1
    (folder / "track.toml").write_text(track.replace(old, new), encoding="utf-8")
    (folder / "mission.py").write_text(mission.replace(f"tracks/{name}.toml", "track.toml"), encoding="utf-8")
    return folder / "mission.py"


@pytest.mark.parametrize(("name", "seed"), [("five_gates", 20500), ("four_gates", 20501), ("one_gate", 20502)])
def test_gates_of_which_only_the_markers_are_known_are_found_and_passed(tmp_path, name, seed):
    summary = fly(tmp_path / "run", MISSIONS / f"{name}_unknown.py", seed)
    assert why_failed(summary) == "", summary
    assert all(gate["passed"] for gate in summary["gates"])


def test_a_gate_behind_the_drone_is_found_by_turning_round(tmp_path):
    mission = changed(tmp_path, "one_gate", "yaw_deg = 0.0\n\n[gate]", "yaw_deg = 180.0\n\n[gate]")
    summary = fly(tmp_path / "run", mission, 20503)
    assert why_failed(summary) == "", summary
    assert "gate 1 is searched for" in (tmp_path / "run" / "app.log").read_text(encoding="utf-8")


def test_a_gate_too_far_away_to_be_seen_is_found_by_flying_about(tmp_path):
    far = "position = [9.0, 6.0, 1.5]\nyaw_deg = 80.0"
    mission = changed(tmp_path, "one_gate", "position = [2.0, 0.0, 1.5]\nyaw_deg = 0.0", far)
    summary = fly(tmp_path / "run", mission, 20504, "detection.max_distance=5.0")
    assert why_failed(summary) == "", summary
    assert "gate 1 found after" in (tmp_path / "run" / "app.log").read_text(encoding="utf-8")


def test_a_gate_that_is_nowhere_is_given_up_and_the_drone_lands(tmp_path):
    mission = changed(tmp_path, "one_gate", "position = [2.0, 0.0, 1.5]", "position = [60.0, 0.0, 1.5]")
    summary = fly(tmp_path / "run", mission, 20505, "race.search_timeout=30")
    assert summary["outcome"] == "WRONG_PROGRESS"
    assert not summary["collisions"]
    assert "gate 1 was not found" in (tmp_path / "run" / "app.log").read_text(encoding="utf-8")
