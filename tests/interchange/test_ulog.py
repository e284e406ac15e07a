"""PX4's logs come out in our frames."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ulog_file import ulog

from flightapp.evaluation.metrics import racing_window
from flightapp.evaluation.pose_errors import absolute_errors
from flightapp.evaluation.summary import summarise
from flightapp.frames import GRAVITY, flip_yz, quat_from_euler, quat_rotate
from flightapp.inputs import BadInputError
from flightapp.interchange import extra
from flightapp.interchange.sources import paths_in, read_path
from flightapp.interchange.ulog import FLIP, FLIP_TURN, read_ulog
from flightapp.results import report

N = 400
TIME = np.arange(N, dtype=np.uint64) * 10_000 + 5_000_000
"""µs: four seconds at 100 Hz."""
YAW = 0.7
NORTH_EAST_DOWN = np.column_stack((np.linspace(0.0, 4.0, N), np.linspace(0.0, 2.0, N), np.full(N, -1.5)))
ASIDE = np.array((0.0, 0.1, 0.0))
Q_NED = np.tile(quat_from_euler(0.1, -0.2, YAW), (N, 1))


def topics():
    position = {f"float {axis}": NORTH_EAST_DOWN[:, i] for i, axis in enumerate("xyz")}
    velocity = {"float vx": np.full(N, 1.0), "float vy": np.full(N, 0.5), "float vz": np.zeros(N)}
    nav = np.where((np.arange(N) >= 100) & (np.arange(N) < 300), 14, 4)
    stamps = {"uint64_t timestamp": TIME}
    return {
        "vehicle_odometry": {
            "uint64_t timestamp": TIME + 3_000,
            "uint64_t timestamp_sample": TIME,
            "float[3] position": NORTH_EAST_DOWN + ASIDE,
            "float[4] q": Q_NED,
            "float[3] velocity": np.tile((1.0, 0.5, 0.0), (N, 1)),
            "float[3] angular_velocity": np.tile((0.1, 0.2, 0.3), (N, 1)),
            "float[3] position_variance": np.full((N, 3), 0.01),
            "float[3] velocity_variance": np.full((N, 3), 0.04),
            "float[3] orientation_variance": np.full((N, 3), 0.001),
            "uint8_t pose_frame": np.ones(N),
            "uint8_t velocity_frame": np.ones(N),
        },
        "vehicle_local_position": stamps | position | velocity,
        "vehicle_local_position_groundtruth": stamps | position | velocity,
        "vehicle_attitude_groundtruth": stamps | {"float[4] q": Q_NED},
        "trajectory_setpoint": stamps
        | {
            "float[3] position": np.where(np.arange(N)[:, None] < 50, np.nan, NORTH_EAST_DOWN),
            "float[3] velocity": np.tile((1.0, 0.5, 0.0), (N, 1)),
            "float yaw": np.full(N, YAW),
            "float yawspeed": np.full(N, 0.25),
        },
        "vehicle_rates_setpoint": stamps
        | {
            "float roll": np.full(N, 0.4),
            "float pitch": np.full(N, 0.5),
            "float yaw": np.full(N, 0.6),
            "float[3] thrust_body": np.tile((0.0, 0.0, -0.5), (N, 1)),
        },
        "vehicle_status": stamps | {"uint8_t nav_state": nav},
    }


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("px4") / "flight.ulg"
    path.write_bytes(ulog(topics(), {"MPC_THR_HOVER": 0.25}))
    return path


@given(st.lists(st.floats(-10, 10), min_size=3, max_size=3), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_flips_are_those_of_frames(v, tilt, yaw):
    """A vector turned by FRD-to-NED and then flipped is the flipped vector turned by the flipped quaternion."""
    vector, q = np.array(v), quat_from_euler(tilt, 0.5 * tilt, yaw)
    assert np.array_equal(vector * FLIP, flip_yz(vector))
    assert np.allclose(flip_yz(quat_rotate(q, vector)), quat_rotate(q * FLIP_TURN, flip_yz(vector)))


def test_streams_come_out_in_our_frames(log):
    flight = read_ulog(log)
    level = np.array((1.0, -1.0, -1.0))
    assert np.allclose(flight.truth.position, NORTH_EAST_DOWN * level, atol=1e-6)
    assert flight.truth.position[-1] == pytest.approx((4.0, -2.0, 1.5))
    assert np.allclose(flight.states.position, (NORTH_EAST_DOWN + ASIDE) * level, atol=1e-6)
    assert flight.states.stamp[0] == pytest.approx(5.0)  # by timestamp_sample, not when it was logged
    forward = quat_rotate(flight.states.orientation[0], np.array((1.0, 0.0, 0.0)))
    assert math.atan2(forward[1], forward[0]) == pytest.approx(-YAW, abs=1e-6)
    assert forward[2] < 0.0  # pitched down in NED means looking down here too
    assert np.allclose(flight.states.velocity[0], (1.0, -0.5, 0.0))
    assert np.allclose(flight.states.angular_velocity[0], (0.1, -0.2, -0.3))
    assert np.allclose(flight.truth.orientation[5], flight.states.orientation[5], atol=1e-6)
    assert flight.setpoints.stamp.size == N - 50
    assert flight.setpoints.yaw[0] == pytest.approx(-YAW)
    assert np.allclose(flight.commands.rates[0], (0.4, -0.5, -0.6))
    assert flight.commands.thrust[0] == pytest.approx(2.0 * GRAVITY)
    assert flight.complete
    window = racing_window(flight)
    assert (window.start, window.end) == pytest.approx((6.0, 8.0))


def test_a_report_of_px4s_log(log):
    summary, page = report(log)
    assert summary["elapsed"] == pytest.approx(2.0)
    assert summary["estimation_rmse"]["y"] == pytest.approx(0.1, abs=1e-6)
    assert summary["estimation_ape"]["yaw"]["translation"]["rmse"] < 1e-6
    assert summary["estimation_nees"] == pytest.approx(1.0, rel=1e-4)
    assert summary == summarise(read_ulog(log))
    assert page == log.with_name("report.html")
    assert page.stat().st_size > 10_000


def test_paths_are_named_as_px4_names_them(log):
    paths = paths_in(log)
    assert set(paths) == {
        *("vehicle_odometry", "vehicle_local_position", "vehicle_local_position_groundtruth", "trajectory_setpoint"),
    }
    assert paths["vehicle_local_position"].orientation is None  # no vehicle_attitude was logged
    reference, estimate = (read_path(f"{log}:{name}") for name in list(paths)[2:0:-1])
    assert absolute_errors(reference, estimate).translation.max < 1e-6
    with pytest.raises(BadInputError, match=r"vehicle_odometry \(400 poses\)"):
        read_path(str(log))
    with pytest.raises(BadInputError, match="has no path 'x'"):
        read_path(f"{log}:x")


def test_what_is_no_ulog_is_told(tmp_path, log):
    path = tmp_path / "x.ulg"
    for content in (b"", b"hello", log.read_bytes()[:20]):
        path.write_bytes(content)
        with pytest.raises(BadInputError, match=r"x\.ulg"):
            read_ulog(path)
    with pytest.raises(BadInputError, match="no such ULog"):
        read_ulog(tmp_path / "none.ulg")


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 1.0), st.integers(0, 10**9), st.binary(min_size=1, max_size=8))
def test_a_damaged_ulog_is_read_or_refused_in_words(log, tmp_path_factory, fraction, where, garbage):
    data = bytearray(log.read_bytes())
    at = where % len(data)
    data[at : at + len(garbage)] = garbage
    path = tmp_path_factory.mktemp("damaged") / "x.ulg"
    path.write_bytes(data[: int(fraction * len(data))])
    try:
        read_ulog(path)
    except BadInputError as error:
        assert "x.ulg" in str(error)


def test_without_the_library_it_says_how_to_get_it(log, monkeypatch):
    def missing(name, *rest):
        raise ImportError(name)

    monkeypatch.setattr(extra, "import_module", missing)
    with pytest.raises(BadInputError, match=r"takes pyulog.*pip install flightapp\[interchange\]"):
        read_ulog(log)
