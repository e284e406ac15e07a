"""Many flights: kept, gone on with, and flown elsewhere with the same results."""

import json
import shlex
from dataclasses import replace

import pytest
from hops import hops
from typer.testing import CliRunner

from flightapp.campaign import fly, store
from flightapp.campaign.cluster import work_on_cluster
from flightapp.campaign.fly import Where, fly_all
from flightapp.campaign.pool import Lost, work
from flightapp.campaign.run import Run, failure, fly_run
from flightapp.campaign.store import Store
from flightapp.cli import cli
from flightapp.inputs import BadInputError


def answers(flown):
    """In place of processes: what each job gives, and how often it was asked for."""
    asked = []

    def do(_, jobs_, __):
        for number, run in enumerate(jobs_):
            asked.append(run.plan.seed)
            yield number, flown(run)

    return do, asked


def result(run, outcome="GOAL_ACHIEVED"):
    summary = {"outcome": outcome, "gates": [], "collisions": [], "seed": run.plan.seed, "elapsed": 1.0}
    return json.dumps(run.known | {"summary": summary, "reason": "mission complete"})


def test_only_what_is_missing_is_flown(tmp_path, monkeypatch):
    runs, where, told = hops(tmp_path, 4), Where(out=tmp_path / "out"), []
    do, asked = answers(lambda run: Lost("its process died") if run.plan.seed == 2 else result(run))
    monkeypatch.setattr(fly, "work", do)
    first = fly_all(runs, where, told.append)
    assert [failure(kept) for kept in first] == ["", "", "its process died", ""]
    assert told == [True, True, False, True]
    do, asked = answers(result)
    monkeypatch.setattr(fly, "work", do)
    assert [failure(kept) for kept in fly_all(runs, where, told.append)] == [""] * 4
    assert asked == [2]
    more = hops(tmp_path, 6)
    fly_all(more, where, told.append)
    assert asked == [2, 4, 5]


def test_a_result_that_was_cut_off_is_flown_again(tmp_path):
    (run,) = hops(tmp_path, 1)
    kept = Store(tmp_path / "out", [run])
    assert kept.read(run) is None
    kept.write(run, result(run))
    assert kept.read(run) == result(run)
    (file,) = (tmp_path / "out" / "results").iterdir()
    file.write_text(result(run)[:40])
    assert kept.read(run) is None


def test_another_plan_in_the_same_directory_is_refused_with_words(tmp_path, monkeypatch):
    out = tmp_path / "out"
    Store(out, hops(tmp_path, 2))
    Store(out, hops(tmp_path, 3, first=7))
    with pytest.raises(BadInputError, match=r"out: holds another plan's flights: mission, track or settings of hop"):
        Store(out, hops(tmp_path, 2, "race.v_max=2"))
    with pytest.raises(BadInputError, match=r"hop there, hop, jump now"):
        Store(out, [*(runs := hops(tmp_path, 2)), replace(runs[0], label="jump")])
    monkeypatch.setattr(store, "program_print", lambda: "another")
    with pytest.raises(BadInputError, match="the program is another one"):
        Store(out, hops(tmp_path, 2))
    monkeypatch.undo()
    (out / "plan.json").write_text("{")
    with pytest.raises(BadInputError, match=r"plan\.json: cannot be read"):
        Store(out, hops(tmp_path, 2))
    (out / "plan.json").unlink()
    (out / "results" / "x").touch()
    with pytest.raises(BadInputError, match=r"holds results but no plan\.json"):
        Store(out, hops(tmp_path, 2))


def test_bad_settings_are_told_before_anything_is_flown(tmp_path):
    with pytest.raises(BadInputError, match="v_maxi"):
        fly_all(hops(tmp_path, 1, "race.v_maxi=2"), Where(), lambda _: None)


def test_a_flight_that_breaks_is_a_failure(tmp_path, monkeypatch):
    (run,) = hops(tmp_path, 1)
    monkeypatch.setattr("flightapp.app.fly", lambda _: 1 / 0)
    assert failure(json.loads(fly_run(run))) == "ZeroDivisionError: division by zero"


def test_processes_and_a_dask_cluster_fly_the_same_flights_to_the_last_byte(tmp_path):
    distributed = pytest.importorskip("distributed")
    runs = hops(tmp_path, 2)
    settings = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**settings, host="127.0.0.1", silence_logs=50) as cluster:
        there = dict(work_on_cluster(fly_run, runs, cluster.scheduler_address))
    here = dict(work(fly_run, runs, 1))
    assert there == here
    assert [failure(json.loads(here[n])) for n in range(2)] == [""] * 2


def test_a_sweep_over_a_grid_writes_its_results_and_its_page(tmp_path, monkeypatch):
    (run,) = hops(tmp_path, 1)
    do, _ = answers(lambda run: result(run, (run.plan.seed == 4 and "failed") or "GOAL_ACHIEVED"))
    monkeypatch.setattr(fly, "work", do)
    words = ["sweep", str(run.plan.mission), "--runs", "3", "--first-seed", "3", "--grid", "race.v_max=2,4"]
    flown = CliRunner().invoke(cli, [*words, "--set", "race.a_max=5", "--out", str(tmp_path / "out")])
    assert flown.exit_code == 0, flown.output
    sweep = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert (sweep["runs"], sweep["successes"]) == (6, 4)
    assert [(p["parameters"], p["runs"], p["successes"]) for p in sweep["points"]] == [
        ({"race.v_max": "2"}, 3, 2),
        ({"race.v_max": "4"}, 3, 2),
    ]
    again = f"flightapp fly {run.plan.mission} --sim --set race.a_max=5 --set race.v_max=2 --seed 4"
    assert sweep["points"][0]["failures"] == [{"seed": 4, "why": "failed", "command": again}]
    assert len({flight["command"] for flight in sweep["flights"]}) == 6
    page = (tmp_path / "out" / "sweep.html").read_text()
    assert 'id="figure-success"' in page
    assert again in page
    assert f"seed 4: failed\n    {again}\n" in flown.output


def test_the_command_that_is_told_flies_the_same_flight(tmp_path):
    (run,) = hops(tmp_path, 1, first=5)
    words = shlex.split(run.command)
    assert words[0] == "flightapp"
    flown = CliRunner().invoke(cli, [*words[1:], "--out", str(tmp_path / "run")])
    assert flown.exit_code == 0, flown.output
    assert json.loads((tmp_path / "run" / "summary.json").read_text()) == json.loads(fly_run(run))["summary"]


def test_without_dask_or_its_scheduler_words_say_so(tmp_path, monkeypatch):
    run = Run(hops(tmp_path, 1)[0].plan)
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(BadInputError, match=r"pip install flightapp\[dask\]"):
        next(work_on_cluster(fly_run, [run], "tcp://127.0.0.1:1"))
