"""What a mission would do, without flying."""

import pytest

from flightapp import app
from flightapp.messages import Outcome

TRACK = 'name = "t"\nwaypoints = [[0.0, 0.0, 1.0]]\n[start]\nposition = [0.0, 0.0, 0.0]\n'


def rehearse(tmp_path, body, head="", *overrides, suffix=".py"):
    """Steps and ending of a mission whose function has ``body``."""
    (tmp_path / "t.toml").write_text(TRACK)
    path = tmp_path / f"m{suffix}"
    lines = "\n    ".join(body.splitlines())
    text = f'import asyncio\nTRACK = "t.toml"\n{head}\nasync def mission(drone):\n    {lines}\n'
    path.write_text(text if suffix == ".py" else body)
    return app.dry_run(app.FlightPlan(path, tmp_path / "run", overrides=overrides))


def names(steps):
    return [step.name for step in steps]


def test_it_tells_the_steps_and_where_they_lead(tmp_path):
    steps, result = rehearse(tmp_path, "await drone.takeoff(2.0)\nawait drone.goto(1, 2, 3)\nawait drone.land()")
    assert names(steps) == ["takeoff", "goto", "land"]
    assert [step.destination.tolist() for step in steps] == [[0.0, 0.0, 2.0], [1.0, 2.0, 3.0], [1.0, 2.0, 0.0]]
    assert steps[1].parameters == {"point": (1.0, 2.0, 3.0)}
    assert result.achieved
    assert result.reason == "mission complete"
    assert not (tmp_path / "run").exists()


def test_it_tells_what_would_be_activated_for_another(tmp_path):
    steps, result = rehearse(tmp_path, "await drone.goto(1, 2, 3)")
    assert names(steps) == ["takeoff", "goto"]
    assert steps[0].note == "needed by goto"
    assert result.reason == "then it would be landed"


def test_what_is_out_of_order_is_refused(tmp_path):
    steps, result = rehearse(tmp_path, "await drone.takeoff()\nawait drone.takeoff()")
    assert "refused: it needs the phase idle or landed" in steps[-1].note
    assert result.outcome is Outcome.PROCESS_FAILURE


def test_an_error_names_the_line(tmp_path):
    _, result = rehearse(tmp_path, "await drone.takeoff()\nawait drone.goto(1, 2)")
    assert result.outcome is Outcome.PROCESS_FAILURE
    assert "m.py:6: TypeError" in result.reason


def test_a_parameter_out_of_its_bounds_is_found(tmp_path):
    _, result = rehearse(tmp_path, "await drone.takeoff(100.0)")
    assert "m.py:5: BadInputError: behavior takeoff: 'height' = 100.0" in result.reason


def test_results_can_be_branched_on_and_waiting_takes_no_time(tmp_path):
    branch = "if result.achieved:\n    await asyncio.sleep(900.0)\n    await drone.land()"
    steps, result = rehearse(tmp_path, f"result = await drone.hover(3.0, check=False)\n{branch}")
    assert names(steps)[-1] == "land"
    assert result.achieved


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("while True:\n    await drone.hover(1.0)", "not ended after 1000 behaviors"),
        ("await drone.next_frame()", "waited for 3600 s for what comes only in flight"),
    ],
)
def test_a_mission_without_an_end_is_told(tmp_path, body, words):
    _, result = rehearse(tmp_path, body)
    assert result.outcome is Outcome.TIME_OUT
    assert words in result.reason


def test_parameters_of_the_mission(tmp_path):
    body = "for _ in range(drone.parameters['rounds']):\n    await drone.hover(1.0)"
    steps, _ = rehearse(tmp_path, body, "PARAMETERS = {'rounds': 2}")
    assert names(steps) == ["takeoff", "hover", "hover"]
    steps, _ = rehearse(tmp_path, body, "PARAMETERS = {'rounds': 2}", "mission.parameters.rounds=1")
    assert names(steps) == ["takeoff", "hover"]


def test_a_list_of_steps(tmp_path):
    body = 'track = "t.toml"\n[[steps]]\ndo = "takeoff"\n[[steps]]\ndo = "hover"\nseconds = 2.0\nrepeat = 2\n'
    steps, result = rehearse(tmp_path, body, suffix=".toml")
    assert names(steps) == ["takeoff", "hover", "hover"]
    assert result.achieved
