"""The report and the tables on the terminal."""

import dataclasses
import io
import re

import numpy as np
import pytest
import synthetic_flight as synthetic
from rich.console import Console

from flightapp.evaluation.flight import Flight
from flightapp.evaluation.report import report_html, write_report
from flightapp.evaluation.summary import summarise
from flightapp.evaluation.tables import flight_tables, terminal_tables
from flightapp.messages import Event


@pytest.fixture(scope="module")
def flight():
    return synthetic.flight()


@pytest.fixture(scope="module")
def html(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(flight, path)
    return path.read_text(encoding="utf-8")


def test_report_has_every_figure_and_table(html, flight):
    for name in ("above", "side", "speed", "tracking", "estimation", "commands", "intervals"):
        assert f'id="figure-{name}"' in html
    for table in flight_tables(summarise(flight))[1:]:
        assert table.title.replace("'", "&#x27;") in html
        for row in table.rows:
            assert all(f">{cell}<" in html for cell in row)
    assert "GOAL_ACHIEVED" in html
    for name in ("surveyed", "estimated", "true"):
        assert f"gates, {name}" in html


def test_report_needs_no_network(html):
    without_library = re.sub(r"<script>.*?</script>", "", html, count=1, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href)\s*=\s*"?https?:', without_library)
    assert "Plotly.newPlot" in html
    assert "plotly.js v" in html


def test_report_shows_text_as_text(html):
    assert "&lt;all&gt; gates passed" in html
    assert "<all> gates passed" not in html


def test_report_is_the_same_every_time(html, flight):
    assert report_html(synthetic.flight(), summarise(flight)) == html


def test_success_and_failure_look_different(html, flight):
    assert 'class="outcome "' in html
    clean = dataclasses.replace(flight, collisions=(), header={**flight.header, "track": ""})
    assert 'class="outcome good"' in report_html(clean, summarise(clean))


def ended_before_it_began():
    return dataclasses.replace(synthetic.flight(truth=False), events=(Event(0.1, "poses", "415 taken"),))


@pytest.mark.parametrize("flight_of", [Flight, ended_before_it_began, lambda: synthetic.flight(truth=False)])
def test_a_flight_with_little_in_it_has_a_report(flight_of):
    flight = dataclasses.replace(flight_of(), complete=False)
    html = report_html(flight, summarise(flight))
    assert 'id="figure-estimation"' not in html
    assert "the log was cut off" in html


def test_a_long_flight_has_no_larger_report(flight, html):
    states, factor = flight.states, 60
    rows = {f.name: np.repeat(getattr(states, f.name), factor, axis=0) for f in dataclasses.fields(states)}
    rows["stamp"] = np.linspace(0.0, 14.0 * factor, states.stamp.size * factor)
    long = dataclasses.replace(flight, states=dataclasses.replace(states, **rows))
    assert len(report_html(long, summarise(long))) < len(html) + 500_000 < 10_000_000


def test_terminal_shows_the_paper_beside_ours(flight):
    console = Console(width=120, record=True, file=io.StringIO())
    for table in terminal_tables(summarise(flight)):
        console.print(table)
    text = console.export_text()
    for expected in ("Paper's table 7", "0.1583", "34.5000", "state lost: 0.30 s old", "GOAL_ACHIEVED", "3 of 4"):
        assert expected in text
