"""How the tracker sits in the body, from made-up motion whose truth is known."""

import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from flightapp.calibration.tracker_mount import Felt, Tracked, find_tracker
from flightapp.commands.calibrate import calibrate as commands
from flightapp.config import dump_config, load_config
from flightapp.frames import GRAVITY
from flightapp.inputs import BadInputError
from flightapp.messages import ImuSample, PoseSample
from flightapp.recording.writer import FlightLog

STEP = 0.001


def motion(rng, seconds=25.0, axes=(1.0, 1.0, 1.0), place=(0.08, -0.03, 0.06), turned=(4.0, 12.0, 88.0), late=0.0):
    """A tracker and inertial sensors on a body that is turned and moved by hand, and the mount's rotation."""
    place = np.array(place)
    t = np.arange(0.0, seconds, STEP)
    angles, centre = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    for axis in range(3):
        for f in rng.uniform(0.2, 1.6, 5):
            angles[:, axis] += axes[axis] * rng.normal(0.0, 0.12) * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.0))
            centre[:, axis] += rng.normal(0.0, 0.04) * np.sin(2.0 * np.pi * 0.5 * f * t + rng.uniform(0.0, 6.0))
    R = Rotation.from_euler("xyz", angles)
    w = np.zeros_like(angles)
    w[:-1] = (R[:-1].inv() * R[1:]).as_rotvec() / STEP
    w[-1] = w[-2]
    R_bt = Rotation.from_euler("ZYX", turned[::-1], degrees=True)
    arm = centre + R.apply(place)
    velocity = np.gradient(arm, STEP, axis=0)
    force = R.inv().apply(np.gradient(np.gradient(centre, STEP, axis=0), STEP, axis=0) + np.array((0.0, 0.0, GRAVITY)))
    poses, imu = slice(0, None, 5), slice(0, None, 4)

    def noisy(values, sigma):
        return values + sigma * rng.standard_normal(values.shape)

    tracked = Tracked(
        t[poses] + late,
        (R * R_bt).as_quat(scalar_first=True)[poses],
        noisy(velocity[poses], 0.005),
        noisy(R_bt.inv().apply(w)[poses], 0.01),
    )
    felt = Felt(t[imu], noisy(w[imu], 0.02) + 0.01, noisy(force[imu], 0.2) + np.array((0.1, -0.05, 0.15)))
    return tracked, felt, R_bt, place


def test_rotation_place_and_lateness_are_found():
    tracked, felt, R_bt, place = motion(np.random.default_rng(1), late=0.012)
    found = find_tracker(tracked, felt)
    off = Rotation.from_matrix(found.R_bt) * R_bt.inv()
    assert found.shortfalls == ()
    assert found.place_shortfall == ""
    assert off.magnitude() < math.radians(0.3)
    np.testing.assert_allclose(found.place, place, atol=0.01)
    assert found.late == pytest.approx(0.012, abs=0.001)


def test_standard_deviations_are_what_the_errors_are():
    turns, places = [], []
    for seed in range(5):
        tracked, felt, R_bt, place = motion(np.random.default_rng(30 + seed), seconds=20.0)
        found = find_tracker(tracked, felt)
        off = (Rotation.from_matrix(found.R_bt) * R_bt.inv()).as_rotvec()
        turns.append(off / found.rotation_deviation)
        places.append((found.place - place) / found.place_deviation)
    for scores in (turns, places):
        assert 0.3 < np.sqrt(np.mean(np.square(scores))) < 2.5


def test_turning_about_one_axis_is_too_poor():
    tracked, felt, _, _ = motion(np.random.default_rng(3), axes=(0.0, 0.0, 3.0))
    found = find_tracker(tracked, felt)
    assert any("second axis" in text for text in found.shortfalls)
    assert "turn more quickly" in found.place_shortfall


def test_a_log_and_what_had_been_configured(tmp_path):
    """The log's poses have the configured mount taken out; what is found is added to it."""
    tracked, felt, R_bt, place = motion(np.random.default_rng(4))
    mount = ["sensors.mount_rpy_deg=[0.0, 0.0, 90.0]", "sensors.mount_position=[0.05, 0.0, 0.0]"]
    told = load_config(None, None, mount)
    R_told = Rotation.from_euler("z", 90.0, degrees=True)
    q = Rotation.from_quat(tracked.orientation, scalar_first=True) * R_told.inv()
    omega = R_told.apply(tracked.angular_velocity)
    velocity = tracked.velocity - q.apply(np.cross(omega, (0.05, 0.0, 0.0)))
    log = FlightLog(tmp_path / "flight.mcap", header={"config": dump_config(told)}, opening=1.4)
    for row in zip(tracked.stamp, q.as_quat(scalar_first=True), velocity, omega, strict=True):
        stamp, orientation, v, w = row
        log.write("pose", PoseSample(float(stamp), np.zeros(3), orientation, v, w, 3))
    for stamp, w, f in zip(felt.stamp, felt.angular_velocity, felt.specific_force, strict=True):
        log.write("imu", ImuSample(float(stamp), f, w))
    log.close()
    out, told_file = tmp_path / "new.toml", tmp_path / "r.json"
    arguments = ["tracker", str(tmp_path / "flight.mcap"), "--out", str(out), "--json", str(told_file)]
    result = CliRunner().invoke(commands, arguments)
    assert result.exit_code == 0, result.output
    sensors = load_config(out).sensors
    found = Rotation.from_euler("ZYX", sensors.mount_rpy_deg[::-1], degrees=True)
    assert (found * R_bt.inv()).magnitude() < math.radians(0.3)
    np.testing.assert_allclose(sensors.mount_position, place, atol=0.01)
    assert json.loads(told_file.read_text(encoding="utf-8"))["settings"].keys() == {"mount_rpy_deg", "mount_position"}


def test_what_is_missing_is_said(tmp_path):
    log = FlightLog(tmp_path / "flight.mcap", header={"config": ""}, opening=1.4)
    for i in range(100):
        log.write("pose", PoseSample(0.01 * i, np.zeros(3), np.array((1.0, 0, 0, 0)), np.zeros(3), np.zeros(3), 3))
    log.close()
    result = CliRunner().invoke(commands, ["tracker", str(tmp_path / "flight.mcap")])
    assert isinstance(result.exception, BadInputError)
    assert "--against" in str(result.exception)
