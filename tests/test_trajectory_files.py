"""Trajectories in files."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flightapp.inputs import BadInputError
from flightapp.recording.writer import FlightLog
from flightapp.trajectory import ORDER, Trajectory, hover
from flightapp.trajectory_files import load_trajectory, save_samples, save_trajectory

FINITE = st.floats(allow_nan=False, allow_infinity=False)
LENGTHS = st.lists(st.floats(1e-3, 100.0), min_size=1, max_size=4)


@st.composite
def trajectories(draw):
    knots, yaw_knots = (np.concatenate(((0.0,), np.cumsum(draw(LENGTHS)))) for _ in range(2))
    gates = draw(st.lists(st.tuples(st.integers(0, 99), st.floats(0.0, 100.0)), max_size=3))
    return Trajectory(
        draw(st.floats(0.0, 1e6)),
        knots,
        draw(arrays(float, (len(knots) - 1, 3, ORDER), elements=FINITE)),
        yaw_knots,
        draw(arrays(float, (len(yaw_knots) - 1, 4), elements=FINITE)),
        tuple(gate_id for gate_id, _ in gates),
        tuple(time for _, time in gates),
    )


def wavy(seed=1):
    rng = np.random.default_rng(seed)
    knots, yaw_knots = np.array((0.0, 0.7, 2.0)), np.array((0.0, 0.1, 0.35, 2.1))
    coefficients, yaws = rng.normal(size=(2, 3, ORDER)), rng.normal(size=(3, 4))
    return Trajectory(12.5, knots, coefficients, yaw_knots, yaws, (3, 7), (0.4, 1.9))


def assert_identical(a, b):
    assert (a.stamp, a.gate_ids, a.gate_times) == (b.stamp, b.gate_ids, b.gate_times)
    for name in ("knots", "coefficients", "yaw_knots", "yaw_coefficients"):
        one, other = getattr(a, name), getattr(b, name)
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes(), name


@settings(max_examples=60, deadline=None)
@given(trajectories())
@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_a_trajectory_comes_back_to_the_last_bit(tmp_path_factory, suffix, trajectory):
    path = tmp_path_factory.mktemp("line") / f"line{suffix}"
    save_trajectory(trajectory, path)
    assert_identical(load_trajectory(path), trajectory)


def test_the_rows_are_what_the_format_says(tmp_path):
    trajectory = wavy()
    path = tmp_path / "line.csv"
    save_trajectory(trajectory, path)
    text = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    rows = [row for row in csv.DictReader(text) if float(row["start"]) <= 1.0 < float(row["end"])]
    samples = trajectory.sample(1.0)
    expected = dict(zip(("x", "y", "z"), samples.position, strict=True)) | {"yaw": samples.yaw}
    assert {row["curve"] for row in rows} == set(expected)
    for row in rows:
        s = 1.0 - float(row["start"])
        value = sum(float(row[f"c{k}"] or 0.0) * s**k for k in range(ORDER))
        assert value == pytest.approx(expected[row["curve"]], rel=1e-12)


def test_a_flights_log_gives_each_of_its_plans(tmp_path):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header={"mission": "m"})
    plans = [replace(wavy(seed), stamp=float(seed)) for seed in range(3)]
    for plan in plans:
        log.write("trajectory", plan)
    log.close()
    assert_identical(load_trajectory(path), plans[2])
    assert_identical(load_trajectory(path, 1), plans[1])
    with pytest.raises(BadInputError, match=r"flight.mcap: has 3 trajectories, 0 to 2; there is no 3"):
        load_trajectory(path, 3)


def test_samples_are_the_motion_at_their_times(tmp_path):
    trajectory = wavy()
    path = tmp_path / "samples.csv"
    save_samples(trajectory, path, 100.0)
    rows = list(csv.DictReader(path.open()))
    assert float(rows[1]["time"]) == 0.01
    assert float(rows[-1]["time"]) == trajectory.duration
    at = trajectory.sample(0.25)
    row = rows[25]
    assert [float(row[name]) for name in ("ax", "ay", "az")] == pytest.approx(at.acceleration.tolist(), rel=1e-12)
    assert float(row["yaw_rate"]) == pytest.approx(float(at.yaw_rate), rel=1e-12)
    with pytest.raises(BadInputError, match="holds samples"):
        load_trajectory(path)


def without(line):
    return lambda text: "\n".join(text.splitlines()[:line] + text.splitlines()[line + 1 :])


DAMAGES = {
    "not a table": (lambda _: "hello", "not a trajectory"),
    "empty": (lambda _: "", "not a trajectory"),
    "other columns": (lambda text: text.replace("c7", "c9"), "line 5: expected the columns"),
    "an unknown curve": (lambda text: text.replace("y,0.0", "w,0.0"), "line 8: column curve: 'w'"),
    "a word": (lambda text: text.replace("x,0.0,0.7", "x,0.0,soon"), "line 6: column end: 'soon'"),
    "NaN": (lambda text: text.replace("x,0.0,0.7", "x,0.0,nan"), "line 6: column end: 'nan'"),
    "a missing piece": (without(5), "line 6: column start: 0.7"),
    "a missing piece at the end": (without(6), "the pieces of 'y'"),
    "no yaw": (lambda text: text[: text.index("yaw")], "no rows for the curve 'yaw'"),
    "a time that runs backwards": (lambda text: text.replace("x,0.0,0.7", "x,0.0,-0.7"), "line 6: column end: -0.7"),
    "cells too few": (lambda text: text.replace("x,0.0,0.7,", "x,0.7,"), "line 6: a row of 'x' has 11 cells"),
    "a remark": (lambda text: text.replace("# gate 3 at", "# gate three at"), "line 3: '# gate three at"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_file_is_told_by_line_and_column(tmp_path, name):
    damage, told = DAMAGES[name]
    path = tmp_path / "line.csv"
    save_trajectory(wavy(), path)
    before = path.read_text()
    after = damage(before)
    assert after != before
    path.write_text(after)
    with pytest.raises(BadInputError) as raised:
        load_trajectory(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert told in str(raised.value)


def test_what_cannot_be_read_or_written_is_told(tmp_path):
    still = hover(0.0, np.zeros(3), 0.0)
    with pytest.raises(BadInputError, match="there is no such trajectory"):
        load_trajectory(tmp_path / "none.csv")
    with pytest.raises(BadInputError, match=r"none.mcap: there is no such flight log"):
        load_trajectory(tmp_path / "none.mcap")
    with pytest.raises(BadInputError, match=r"line.txt: a trajectory's file ends in .csv or .mcap"):
        save_trajectory(still, tmp_path / "line.txt")
    with pytest.raises(BadInputError, match="cannot be written: No such file or directory"):
        save_trajectory(still, tmp_path / "nowhere" / "line.csv")
    empty = tmp_path / "empty.mcap"
    FlightLog(empty, header={}).close()
    with pytest.raises(BadInputError, match="without any trajectory"):
        load_trajectory(empty)


def test_a_record_is_not_overwritten(tmp_path):
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(BadInputError, match="choose another name"):
        save_trajectory(wavy(), path)
    assert path.read_bytes() == b"precious"
