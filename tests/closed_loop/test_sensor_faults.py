"""Faults of the sensors and of the gates in flight: each has the reaction that `sim.faults` states.

The first three of the five gates are flown at 4 m/s in virtual time: the first is passed after 7 s, the second after
9 s, the third after 11 s. Each flight is judged by the world's truth.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from flightapp import app, results
from flightapp.evaluation.summary import why_failed
from flightapp.messages import FlightMode
from flightapp.recording.reader import read_flight

MISSIONS = Path(__file__).parents[2] / "missions"
SETTLED = 0.3
"""m/s, at the most by which a vehicle that has landed moves."""


@dataclass(frozen=True)
class Row:
    """A fault, and what is to be seen of the flight."""

    faults: str
    """sim.faults."""
    outcome: str
    says: str = ""
    """A part of the log, of the reaction."""
    error: float = 0.8
    """m, greatest error of the estimated position in flight."""
    offset: float = 0.35
    """m, greatest distance from a gate's centre."""


FLIES_ON = "GOAL_ACHIEVED"
HANDS_OVER = "PROCESS_FAILURE"
GIVES_UP = "WRONG_PROGRESS"
TOO_OLD = "no sound command for too long: the state is too old"
NOT_FOUND = "was not found within 6 s"
ROWS = {
    "nothing": Row("[]", FLIES_ON),
    "the tracker silent for 0.2 s": Row("[[8.0, 'pose_silent', 0.2]]", FLIES_ON),
    "the tracker silent for 0.5 s": Row("[[8.0, 'pose_silent', 0.5]]", FLIES_ON, "pose missing is over"),
    "the tracker silent for 2 s": Row("[[8.0, 'pose_silent', 2.0]]", HANDS_OVER, TOO_OLD),
    "a pose frozen for 0.5 s": Row("[[8.0, 'pose_frozen', 0.5]]", FLIES_ON, "pose missing is over"),
    "a pose frozen for 2 s": Row("[[8.0, 'pose_frozen', 2.0]]", HANDS_OVER, TOO_OLD),
    "a jump of 2 m": Row("[[8.0, 'pose_jump', 2.0]]", FLIES_ON),
    "a relocalisation": Row("[[8.0, 'pose_relocalised', '2:20']]", FLIES_ON),
    "a camera frozen for 1 s": Row("[[8.0, 'camera_frozen', 1.0]]", FLIES_ON, "the camera delivers the same image"),
    "a camera frozen for ever": Row("[[8.0, 'camera_frozen', 1000.0]]", HANDS_OVER, "camera lost: no new image"),
    "a camera silent for 2 s": Row("[[8.0, 'camera_silent', 2.0]]", FLIES_ON, "camera lost is over"),
    "a camera silent for ever": Row("[[8.0, 'camera_silent', 1000.0]]", HANDS_OVER, "camera lost: no new image"),
    "a camera black for 1 s": Row("[[8.0, 'camera_black', 1.0]]", FLIES_ON),
    "a camera black for ever": Row("[[8.0, 'camera_black', 1000.0]]", GIVES_UP, NOT_FOUND),
    "a camera at 5 Hz": Row("[[0.0, 'camera_slow', 5.0]]", FLIES_ON),
    "a camera 200 ms late": Row("[[0.0, 'camera_late', 0.185]]", FLIES_ON),
    "30 % of the sightings wrong": Row("[[0.0, 'sightings_wrong', 0.3]]", FLIES_ON, error=1.5),
    "a focal length 5 % too long": Row("[[0.0, 'calibration_wrong', 0.05]]", FLIES_ON, error=2.5),
    "a focal length 5 % too short": Row("[[0.0, 'calibration_wrong', -0.05]]", FLIES_ON, error=2.5),
    "a gate that is missing": Row("[[0.0, 'gate_missing', 2]]", GIVES_UP, "gate 2 " + NOT_FOUND),
    "a gate that moves by 2 m": Row("[[9.5, 'gate_moved', '3:2']]", FLIES_ON, "gate 3 has moved to"),
}


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    """The first three of the five gates."""
    folder = tmp_path_factory.mktemp("mission")
    track = (MISSIONS / "tracks" / "five_gates.toml").read_text(encoding="utf-8")
    first = "[[gates]]".join(track.split("[[gates]]")[:4]).replace("[-10.0, 4.0, 1.0]", "[7.5, 7.0, 3.0]")
    (folder / "track.toml").write_text(first, encoding="utf-8")
    text = (MISSIONS / "five_gates.py").read_text(encoding="utf-8")
    (folder / "mission.py").write_text(text.replace("tracks/five_gates.toml", "track.toml"), encoding="utf-8")
    return folder / "mission.py"


def fly(mission, out, faults, seed, *settings):
    """Summary, log and what the application said."""
    overrides = ("sim.camera='corners'", f"sim.faults={faults}", *settings)
    summary = results.finish(app.fly(app.FlightPlan(mission, out, overrides=overrides, seed=seed)), page=False)
    return summary, read_flight(out / "flight.mcap"), (out / "app.log").read_text(encoding="utf-8")


def greatest_error(flight):
    """m, of the estimated position."""
    t = flight.states.stamp
    truth = np.stack([np.interp(t, flight.truth.stamp, flight.truth.position[:, i]) for i in range(3)], axis=1)
    return float(np.linalg.norm(truth - flight.states.position, axis=1).max())


@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS.keys())
def test_every_fault_has_its_reaction(tmp_path, mission, row):
    summary, flight, said = fly(mission, tmp_path / "run", row.faults, 22010, "race.search_timeout=6.0")
    assert not summary["collisions"]
    assert summary["outcome"] == row.outcome
    assert row.says in said
    if row.outcome == FLIES_ON:
        assert why_failed(summary) == ""
    assert flight.truth.position[-1, 2] < 0.05
    assert np.linalg.norm(flight.truth.velocity[-1]) < SETTLED
    assert greatest_error(flight) < row.error
    assert all(passage.offset < row.offset for passage in flight.passages)
    if row.says == TOO_OLD:
        handed = next(event.stamp for event in flight.events if row.says in event.text)
        assert 8.5 < handed < 9.5
        soon = [status.mode for status in flight.statuses if handed + 0.2 < status.stamp < handed + 1.0]
        assert set(soon) == {FlightMode.LAND}


def test_gates_that_have_changed_places_are_noticed_and_nothing_is_hit(tmp_path, mission):
    summary, _, said = fly(mission, tmp_path / "run", "[[0.0, 'gates_swapped', '1:2']]", 22011)
    assert not summary["collisions"]
    assert summary["outcome"] in (FLIES_ON, GIVES_UP)
    assert "gate 2 has moved to" in said
