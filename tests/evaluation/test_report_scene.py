"""What the report shows in space and over time: where things are drawn, and that nothing lies upon another."""

import dataclasses
import json
import re
from itertools import pairwise

import numpy as np
import pytest
import synthetic_flight as synthetic
from hypothesis import given
from hypothesis import strategies as st

from flightapp.config import Config, dump_config
from flightapp.evaluation.figures import Subject
from flightapp.evaluation.flight import Stages
from flightapp.evaluation.metrics import Window, racing_window
from flightapp.evaluation.report import report_html
from flightapp.evaluation.scene import ellipsoids
from flightapp.evaluation.series import APART, lay_out_over_time, series_figures, spaced
from flightapp.evaluation.space import fence_of, moving, path_in_space, scene_bounds
from flightapp.evaluation.summary import flight_track, summarise
from flightapp.evaluation.timeline import timeline_figure
from flightapp.evaluation.timing import timing_figures
from flightapp.frames import quat_to_matrix
from flightapp.messages import Event, GateEstimate, Stage


def subject_of(flight, **sections):
    config = Config(**sections)
    flight.header["config"] = dump_config(config)
    return Subject(flight, racing_window(flight), flight_track(flight))


@pytest.fixture
def subject():
    return subject_of(synthetic.flight())


def names(figure):
    return [trace.name for trace in figure.data]


def test_the_page_carries_the_motion_that_its_script_moves(subject):
    html = report_html(subject.flight, summarise(subject.flight))
    data = json.loads(re.search(r'<script type="application/json" id="moving">(.*?)</script>', html).group(1))
    (run,) = data["runs"]
    k = len(run["time"]) // 2
    truth = subject.flight.truth
    stamp = run["time"][k] + subject.window.start
    expected = [np.interp(stamp, truth.stamp, truth.position[:, axis]) for axis in range(3)]
    np.testing.assert_allclose(run["position"][k], expected, atol=2e-3)
    assert data["span"] == pytest.approx([-2.0, 12.0 - 0.005], abs=0.01)
    for name in ("timeline", "speed", "tracking", "estimation", "commands"):
        assert f'id="figure-{name}"' in html


def test_the_camera_sees_what_is_inside_its_drawn_view(subject):
    view = moving({"": subject}, scene_bounds([subject]))["view"]
    camera = Config().camera.model()
    corners = (np.array(view["corners"]) - camera.p_bc) @ camera.R_bc
    w, h = camera.width - 1, camera.height - 1
    np.testing.assert_allclose(camera.project(corners), [(0, 0), (w, 0), (w, h), (0, h)], atol=1.0)
    assert view["corners"][0][0] > view["apex"][0]


def test_a_log_without_configuration_has_no_view_and_no_geofence():
    flight = synthetic.flight()
    flight.header.pop("config")
    bare = Subject(flight, Window(2.0, 12.0), None)
    assert moving({"": bare}, scene_bounds([bare]))["view"] is None
    assert fence_of(bare) is None


def test_the_geofence_is_drawn_where_one_is_set_and_near():
    assert "geofence" not in names(path_in_space(subject_of(synthetic.flight())))
    near = subject_of(synthetic.flight(), geofence={"corners": ((-15, -14), (14, 15)), "floor": -0.5, "ceiling": 8.0})
    figure = path_in_space(near)
    edges = next(trace for trace in figure.data if trace.name == "geofence")
    assert (np.nanmin(edges.z), np.nanmax(edges.z)) == (-0.5, 8.0)
    low, high = figure.layout.scene.zaxis.range
    assert low <= -0.5
    assert high >= 8.0
    far = subject_of(synthetic.flight(), geofence={"corners": ((-900, -900), (900, 900))})
    assert "geofence" not in names(path_in_space(far))


def test_everything_that_moves_and_stands_is_inside_the_scene(subject):
    figure = path_in_space(subject)
    for axis in "xyz":
        low, high = getattr(figure.layout.scene, f"{axis}axis").range
        for trace in figure.data:
            values = np.asarray(getattr(trace, axis), float)
            if trace.visible != "legendonly" and np.isfinite(values).any():
                assert low <= np.nanmin(values), trace.name
                assert np.nanmax(values) <= high, trace.name


def test_ellipsoids_have_the_size_that_the_covariance_says():
    rotation = quat_to_matrix(np.array((0.9, 0.1, -0.3, 0.2)) / np.linalg.norm((0.9, 0.1, -0.3, 0.2)))
    covariance = np.zeros((4, 4))
    covariance[:3, :3] = rotation @ np.diag((0.04, 0.09, 0.01)) @ rotation.T
    gate = GateEstimate(1, np.array((1.0, 2.0, 3.0)), 0.0, covariance, 1, 0.0)
    mesh = ellipsoids([gate], "red", "estimate")
    points = np.column_stack((mesh.x, mesh.y, mesh.z)) - gate.position
    lengths = np.einsum("ni,ij,nj->n", points, np.linalg.inv(covariance[:3, :3]), points)
    np.testing.assert_allclose(lengths, 9.0, rtol=1e-3)


times = st.floats(min_value=-5.0, max_value=60.0)
marks = st.lists(st.tuples(times, st.sampled_from(("passage", "fault", "collision")), st.just("1")), max_size=30)


@given(marks, st.floats(min_value=0.01, max_value=5.0))
def test_labels_keep_apart_and_faults_come_first(marks, apart):
    kept = spaced(marks, apart)
    assert all(b[0] - a[0] >= apart for a, b in pairwise(kept))
    grave = [mark for mark in marks if mark[1] != "passage"]
    if grave:
        assert min(grave)[0] in [mark[0] for mark in kept]
    for dropped in set(marks) - set(kept):
        assert any(abs(dropped[0] - other[0]) < apart for other in kept)


def test_labels_on_the_time_axis_do_not_overlap():
    flight = synthetic.flight()
    crowd = tuple(Event(6.0 + 0.05 * k, "fault", f"fault {k}: too much") for k in range(20))
    object.__setattr__(flight, "events", (*flight.events, *crowd))
    subject = subject_of(flight)
    figure = series_figures(subject)["speed"]
    first, last = subject.span
    stamps = sorted(note.x for note in figure.layout.annotations)
    assert len(stamps) > 3
    assert min(np.diff(stamps)) >= APART * (last - first) - 1e-9
    lay_out_over_time(figure, subject)
    assert len(figure.layout.shapes) >= len(crowd)


def test_what_happened_is_on_the_time_axis(subject):
    figure = timeline_figure(subject)
    bars = {(row, text) for trace in figure.data if trace.type == "bar" for row, text in zip(trace.y, trace.text)}  # noqa: B905
    assert {("phases", "takeoff"), ("phases", "flying"), ("phases", "landing"), ("behaviors", "race")} <= bars
    shown = {text for trace in figure.data if trace.hovertext is not None for text in trace.hovertext}
    for expected in ("state lost: 0.30 s old", "touched gate 3 at 1.5 m/s", "gate 1, 0.05 m from its centre"):
        assert expected in shown
    speed = series_figures(subject)["speed"]
    assert tuple(figure.layout.xaxis.range) == tuple(speed.layout.xaxis.range)


def test_times_are_shown_as_histograms_of_all_that_were_recorded(subject):
    flight = subject.flight
    stamp = np.linspace(3.0, 11.0, 81)
    stages = Stages(stamp, np.full(81, Stage.DETECTION, np.uint32), stamp - 0.03, stamp - 0.012)
    timed = Subject(dataclasses.replace(flight, stages=stages), subject.window, subject.track)
    figures = timing_figures(timed)
    assert list(figures) == ["intervals", "plan", "detection"]
    detection = figures["detection"].data[0]
    assert sum(detection.y) == 81
    assert detection.x[int(np.argmax(detection.y))] == pytest.approx(12.0, abs=0.1)
