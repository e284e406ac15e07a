"""The whole application through real MAVSDK against the MAVLink autopilot, on the wall clock."""

import json
import socket
from pathlib import Path

import pytest

from flightapp import app, results
from flightapp.messages import Outcome

pytestmark = pytest.mark.wall_clock

MISSIONS = Path(__file__).parents[2] / "missions"


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_gate_is_found_in_rendered_images_and_flown_over_mavlink(tmp_path):
    settings = (f"link.connection=udpin://127.0.0.1:{free_port()}", "mission.takeoff_height=1.2")
    plan = app.FlightPlan(MISSIONS / "one_gate.py", tmp_path, "mavlink", None, settings, seed=77, realtime=True)
    flown = app.fly(plan)
    summary = results.finish(flown)
    assert flown.ending.outcome is Outcome.GOAL_ACHIEVED
    assert summary["judged_by"] == "truth"
    assert [gate["passed"] for gate in summary["gates"]] == [True]
    assert summary["collisions"] == []
    # By the autopilot's own clock: it was commanded all the time, and by nobody else.
    received = summary["sender"]["received"]
    assert received["p50"] == pytest.approx(0.004, abs=0.001)
    assert received["rate"] > 150.0
    events = [json.loads(line)["event"] for line in (tmp_path / "app.log").read_text(encoding="utf-8").splitlines()]
    assert any(event.startswith("real time: ") for event in events)
