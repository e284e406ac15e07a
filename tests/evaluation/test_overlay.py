"""Several runs on one page, and figures as files for papers."""

import sys

import numpy as np
import pytest
import synthetic_flight as synthetic
from PIL import Image
from typer.testing import CliRunner

from flightapp import results
from flightapp.cli import cli
from flightapp.evaluation.figures import Subject
from flightapp.evaluation.metrics import racing_window
from flightapp.evaluation.overlay import COLOURS, comparison_figures, comparison_html
from flightapp.evaluation.png import write_pngs
from flightapp.evaluation.report import flight_figures
from flightapp.evaluation.space import path_in_space
from flightapp.evaluation.summary import flight_track
from flightapp.inputs import BadInputError
from flightapp.messages import Event
from flightapp.recording.writer import FlightLog


@pytest.fixture(scope="module")
def flights():
    return {"first": synthetic.flight(0), "second": synthetic.flight(1), "no truth": synthetic.flight(2, truth=False)}


def test_every_run_is_in_every_figure_that_it_has_data_for(flights):
    figures = comparison_figures(flights)
    for name, expected in (("space", flights), ("speed", flights), ("tracking", flights)):
        shown = [trace.name for trace in figures[name].data]
        assert set(expected) <= set(shown)
    assert [trace.name for trace in figures["estimation"].data] == ["first", "second"]
    speeds = [trace.line.color for trace in figures["speed"].data]
    assert speeds == list(COLOURS[:3])


def test_the_page_compares_them_over_the_same_time(flights):
    html = comparison_html(flights)
    assert "3 flights compared" in html  # by truth, the first two touched a gate
    assert "1 of 3 succeeded" in html
    for name in flights:
        assert f"<td>{name}</td>" in html
    assert html.count("Plotly.newPlot(") >= 4


def test_a_log_that_cannot_be_read_spoils_no_other(tmp_path):
    for name in ("empty", "good"):
        (tmp_path / name).mkdir()
    (tmp_path / "empty" / "flight.mcap").write_bytes(b"")
    log = FlightLog(tmp_path / "good" / "flight.mcap", header={"outcome": "TIME_OUT"})
    log.write("event", Event(1.0, "phase", "flying: at last"))
    log.close()
    result = CliRunner().invoke(cli, ["report", str(tmp_path / "empty"), str(tmp_path / "good")])
    assert isinstance(result.exception, BadInputError)
    assert "the file is empty" in str(result.exception)
    assert "TIME_OUT" in (tmp_path / "good" / "report.html").read_text(encoding="utf-8")


def test_comparing_needs_two_runs(tmp_path):
    with pytest.raises(BadInputError, match="at least two"):
        results.compare([tmp_path], tmp_path / "page.html")


def test_runs_with_the_same_name_are_told_apart(tmp_path):
    runs = [tmp_path / "a" / "x", tmp_path / "b" / "x", tmp_path / "other.mcap"]
    for run in runs[:2]:
        run.mkdir(parents=True)
    assert results.run_names(runs) == ["x", "x (2)", "other"]


def test_figures_become_images(flights, tmp_path):
    figures = flight_figures(flights["first"])
    shown = {name: figures[name] for name in ("space", "timeline")}
    written = write_pngs(shown, tmp_path / "new", "run")
    assert [path.name for path in written] == [f"run-{name}.png" for name in shown]
    for path in written:
        image = np.asarray(Image.open(path).convert("L"))
        assert min(image.shape) >= 600
        assert 0.005 < np.mean(image < 200) < 0.5, path


def test_without_the_library_that_draws_them_it_says_what_to_install(flights, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    flight = flights["first"]
    scene = path_in_space(Subject(flight, racing_window(flight), flight_track(flight)))
    with pytest.raises(BadInputError, match=r"flightapp\[png\]"):
        write_pngs({"space": scene}, tmp_path, "run")
