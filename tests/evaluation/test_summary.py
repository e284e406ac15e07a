"""summary.json: complete, deterministic, by ground truth where there is one."""

import dataclasses
import json

import numpy as np
import pytest
import synthetic_flight as synthetic
from hypothesis import given
from hypothesis import strategies as st

from flightapp.evaluation.flight import Flight
from flightapp.evaluation.summary import summarise, to_json, why_failed
from flightapp.inputs import BadInputError

KEYS = {
    *("mission", "seed", "outcome", "elapsed", "v_peak", "v_avg", "gates", "tracking_rmse", "speed_rmse"),
    *("estimation_rmse", "replans", "sender", "faults", "collisions", "tracking_rmse_truth"),
    *("tracker_rmse", "estimation_nees"),
}


@pytest.fixture(scope="module")
def flight():
    return synthetic.flight()


def test_summary_of_a_flight_with_truth(flight):
    summary = summarise(flight)
    assert set(summary) >= KEYS
    assert (summary["mission"], summary["seed"], summary["outcome"]) == ("five_gates", 3, "GOAL_ACHIEVED")
    assert summary["elapsed"] == pytest.approx(synthetic.LANDING - synthetic.FLYING)
    assert summary["gates"][1] == {"id": 1, "lap": 1, "passed": True, "time": 3.0, "offset": 0.05}
    assert summary["gates"][3] == {"id": 3, "lap": 1, "passed": False, "time": None, "offset": None}
    assert summary["collisions"] == [{"time": 9.0, "obstacle": "gate 3", "speed": 1.5}]
    assert summary["faults"] == [{"time": 4.2, "text": "state lost: 0.30 s old"}]
    assert summary["replans"]["count"] == 11
    assert summary["judged_by"] == "truth"
    wobble = 0.08 / np.sqrt(2.0)
    for axis in "xyz":
        assert summary["tracking_rmse_truth"][axis] == pytest.approx(wobble, rel=0.05)
        assert summary["tracking_rmse"][axis] == pytest.approx(np.hypot(wobble, 0.01), rel=0.05)
        assert summary["estimation_rmse"][axis] == pytest.approx(0.01, rel=0.05)
    assert summary["estimation_nees"] == pytest.approx(3.0, rel=0.1)


def test_without_truth_the_estimate_judges():
    """The path goes through the first gate as it was last estimated; what only truth can tell is null."""
    flight = synthetic.flight(truth=False)
    gate = flight.maps[-1].gates[0]
    nearest = flight.states.position[np.argmin(np.linalg.norm(flight.states.position - gate.position, axis=1))]
    moved = dataclasses.replace(gate, position=nearest)
    flight = dataclasses.replace(flight, maps=(dataclasses.replace(flight.maps[-1], gates=(moved,)),))
    summary = summarise(flight)
    assert summary["judged_by"] == "estimate"
    assert summary["estimation_rmse"] is None
    assert summary["tracking_rmse_truth"] is None
    assert summary["collisions"] == []
    assert [gate["passed"] for gate in summary["gates"]] == [True, False, False, False]
    assert summary["gates"][0]["offset"] < 0.1


def test_laps_take_passages_in_turn(flight):
    header = {**flight.header, "config": "[mission]\nlaps = 2\n"}
    passages = (*flight.passages, dataclasses.replace(flight.passages[0], stamp=11.0))
    gates = summarise(dataclasses.replace(flight, header=header, passages=passages))["gates"]
    assert [(gate["lap"], gate["id"]) for gate in gates] == [(lap, i) for lap in (1, 2) for i in range(4)]
    assert [gate["time"] for gate in gates if gate["id"] == 0] == [1.0, 9.0]


def test_an_empty_flight_has_a_summary():
    summary = summarise(Flight())
    assert set(summary) >= KEYS
    assert summary["outcome"] is None
    assert summary["v_peak"] is None
    assert json.loads(to_json(summary)) == summary


def test_json_is_the_same_every_time(flight):
    text = to_json(summarise(flight))
    assert text == to_json(summarise(synthetic.flight()))
    assert list(json.loads(text)) == list(summarise(flight))


@given(st.floats(-1e6, 1e6))
def test_json_is_rounded_to_a_millionth(value):
    read = json.loads(to_json({"value": value}))["value"]
    assert read == pytest.approx(value, abs=5.1e-7)
    assert f"{read:.6f}" == f"{read:.9f}"[:-3]


@pytest.mark.parametrize(("key", "text", "said"), [("track", "{", "track"), ("config", "[", "config")])
def test_header_that_cannot_be_read_is_told(flight, key, text, said):
    with pytest.raises(BadInputError, match=f"the {said} in the log's header"):
        summarise(dataclasses.replace(flight, header={**flight.header, key: text}))


def test_success_needs_more_than_the_outcome(flight):
    summary = summarise(flight)
    assert why_failed(summary) == "touched gate 3; missed gate 3"
    clean = {**summary, "collisions": [], "gates": summary["gates"][:3]}
    assert why_failed(clean) == ""
    assert why_failed({**clean, "outcome": "TIME_OUT"}) == "TIME_OUT"
    assert why_failed({**clean, "outcome": None}) == "no outcome"
