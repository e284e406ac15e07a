"""Whatever befalls a log, `report` opens it up to there, or says in words what is wrong."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import recorded_messages as sample
import synthetic_flight as synthetic
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from flightapp.cli import cli
from flightapp.config import Config, dump_config
from flightapp.evaluation.flight import Flight
from flightapp.evaluation.report import report_html
from flightapp.evaluation.summary import summarise
from flightapp.evaluation.timing import histogram
from flightapp.inputs import BadInputError
from flightapp.messages import Event
from flightapp.recording.reader import read_flight
from flightapp.recording.writer import PROFILE, FlightLog
from flightapp.results import report

MISSION = Path(__file__).parents[2] / "missions" / "one_gate.py"
HEADER = {
    **{"mission": "five_gates", "seed": "3", "outcome": "GOAL_ACHIEVED"},
    **{"track": synthetic.track().model_dump_json(), "config": dump_config(Config())},
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    log = FlightLog(path, header=HEADER)
    log.write("event", Event(0.2, "phase", "flying: race"))
    sample.write_stream(log, 1.5)
    log.annotate({"sender": '{"guard": {}}'})
    log.close()
    return path.read_bytes()


def told_or_refused(data, path):
    """All that is made of a log, but for the drawings; None where it was refused in words."""
    path.write_bytes(data)
    try:
        flight = read_flight(path)
        return flight, summarise(flight)
    except BadInputError as error:
        assert "\n\n" not in str(error)
        return None


def test_ticks_that_differ_by_rounding_alone_are_drawn():
    steady = 4.0 + np.array((0.0, 1e-15, -4e-16, 0.0))
    assert histogram("commands", steady).data[0].y.sum() == steady.size
    for values in ((2.0, 2.0, 2.9), (2.0, 2.4, 9.0)):
        assert histogram("plans", np.array(values)).data[0].y.sum() == 3


def test_the_whole_log_has_a_summary(whole, tmp_path):
    flight, summary = told_or_refused(whole, tmp_path / "flight.mcap")
    assert flight.complete
    assert summary["v_max"] == Config().race.v_max
    assert report_html(flight, summary)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 1.0), st.lists(st.tuples(st.integers(0, 10**9), st.binary(min_size=1, max_size=9)), max_size=4))
def test_a_cut_and_damaged_log_is_told_or_refused(whole, tmp_path_factory, cut, damages):
    """In the middle of the file and in its header, which no checksum of a chunk covers."""
    data = bytearray(whole)
    for i, (where, garbage) in enumerate(damages):
        at = where % (len(data) if i % 2 else 16_000)
        data[at : at + len(garbage)] = garbage
    told_or_refused(bytes(data[: int(cut * len(data))]), tmp_path_factory.mktemp("damaged") / "flight.mcap")


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(("track", "config", "seed", "sender", "mission", "outcome")), st.text(max_size=60))
def test_a_header_with_anything_in_it_is_told_or_refused(key, text):
    try:
        summarise(Flight({**HEADER, key: text}))
    except BadInputError as error:
        assert f"the {key} in the log's header" in str(error)


WRONG = ("race = 1", "mission = 2", "[mission]\nlaps = 'two'", "[mission]\nlaps = -3", "[control]\nrate = 'x'")


@pytest.mark.parametrize("text", [*WRONG, "[control]\nrate = 0", "control = []", "[mission]\nlaps = 100000000"])
def test_a_config_that_means_nothing_is_told(text):
    """Such as a byte that was flipped in a log without its end makes of it."""
    with pytest.raises(BadInputError, match="the config in the log's header"):
        summarise(Flight({**HEADER, "config": text}))


def test_the_command_says_what_is_wrong_and_ends_with_2(whole, tmp_path):
    path = tmp_path / "flight.mcap"
    path.write_bytes(whole.replace(PROFILE.encode(), b"flightapp/9", 1))
    command = [sys.executable, "-m", "flightapp.cli", "report", str(path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "format version 9; this program reads version" in result.stderr.replace("\n", " ")
    assert "Traceback" not in result.stderr


def test_a_flight_killed_in_mid_air_has_a_report(tmp_path):
    """A real flight in another process, killed while it races; what it had estimated is lost for less than a second."""
    out = tmp_path / "run"
    code = f"""
        import os, sys
        from pathlib import Path
        from flightapp import app

        def watch(bus, rig):
            bus.state.tap(lambda state: os.write(1, b"%.6f\\n" % state.stamp))

        app.fly(app.FlightPlan(Path({str(MISSION)!r}), Path({str(out)!r}), overrides=("sim.camera=corners",)), watch)
    """
    child = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE)
    assert child.stdout is not None
    with child.stdout:
        for line in child.stdout:
            if float(line) > 6.0:
                break
        os.kill(child.pid, signal.SIGKILL)
        rest = [line for line in child.stdout.read().splitlines(keepends=True) if line.endswith(b"\n")]
    assert child.wait() == -signal.SIGKILL
    flown = float(rest[-1]) if rest else 6.0
    summary, page = report(out)
    assert page.stat().st_size > 100_000
    assert "the log was cut off" in page.read_text(encoding="utf-8")
    assert not summary["complete"]
    assert summary["outcome"] is None
    flight = read_flight(out / "flight.mcap")
    assert any(event.text.startswith("flying") for event in flight.events)
    assert flown - 1.0 < flight.states.stamp[-1] <= flown + 0.5
    assert flight.truth.stamp[-1] > flown - 1.0
    assert np.all(np.diff(flight.commands.stamp) > 0.0)
    assert CliRunner().invoke(cli, ["metrics", f"{out}:truth", f"{out}:state"]).exit_code == 0
