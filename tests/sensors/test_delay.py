"""The tracker's delay: recovered from made-up motion, refused where the motion doesn't tell."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flightapp.delay_command import calibrate_delay, delay_json, delay_lines
from flightapp.frames import quat_from_rotvec, quat_multiply
from flightapp.inputs import BadInputError
from flightapp.messages import ImuSample, PoseSample, RateCommand
from flightapp.recording.writer import FlightLog
from flightapp.sensors.delay import find_delay

SECONDS = 30.0
FINE = np.arange(-1.0, SECONDS + 1.0, 0.0005)


def turning(rng, size=0.4, quickest=4.0):
    """Angular velocities (n, 3) on `FINE`: a sum of sines about every axis."""
    w = np.zeros((len(FINE), 3))
    for axis in range(3):
        for f in rng.uniform(0.3, quickest, 12):
            w[:, axis] += rng.normal(0.0, size) * np.sin(2.0 * np.pi * f * FINE + rng.uniform(0.0, 6.0))
    return w


def at(w, stamps, rng, noise):
    """``w`` at ``stamps`` as a gyroscope with white ``noise`` (rad/s) has it."""
    values = np.column_stack([np.interp(stamps, FINE, w[:, axis]) for axis in range(3)])
    return values + rng.normal(0.0, noise, values.shape)


def speed(w):
    return np.linalg.norm(w, axis=1)


@pytest.mark.parametrize("delay", [-0.04, -0.0113, 0.0, 0.0062, 0.04])
@pytest.mark.parametrize("rate", [50.0, 250.0])
def test_a_known_delay_is_found_within_a_millisecond(delay, rate):
    rng = np.random.default_rng(20100)
    w = turning(rng)
    poses = np.sort(np.arange(0.0, SECONDS, 0.005) + rng.uniform(-0.001, 0.001, 6000))
    imu = np.arange(0.0, SECONDS, 1.0 / rate)
    found = find_delay(poses + delay, speed(at(w, poses, rng, 0.03)), imu, speed(at(w, imu, rng, 0.05)))
    assert found.delay == pytest.approx(delay, abs=0.001)
    assert 1e-6 < found.error < 0.001
    assert found.correlation > 0.95
    assert found.duration > 0.9 * (SECONDS - 1.0)


def test_the_standard_error_is_honest():
    misses = []
    for seed in range(20101, 20121):
        rng = np.random.default_rng(seed)
        w = turning(rng, size=0.25, quickest=2.0)
        poses, imu = np.arange(0.0, SECONDS, 0.005), np.arange(0.0, SECONDS, 0.01)
        found = find_delay(poses + 0.02, speed(at(w, poses, rng, 0.3)), imu, speed(at(w, imu, rng, 0.3)))
        misses.append((found.delay - 0.02) / found.error)
    assert 0.5 < np.sqrt(np.mean(np.square(misses))) < 2.0


def test_gaps_and_what_is_not_finite_are_left_out():
    rng = np.random.default_rng(20130)
    w = turning(rng)
    poses, imu = np.arange(0.0, SECONDS, 0.005), np.arange(0.0, SECONDS, 0.01)
    here = speed(at(w, poses, rng, 0.03))
    here[::50] = np.nan
    kept = (poses < 8.0) | (poses > 14.0)
    found = find_delay(poses[kept] + 0.015, here[kept], imu, speed(at(w, imu, rng, 0.05)))
    assert found.delay == pytest.approx(0.015, abs=0.001)
    assert found.duration == pytest.approx(SECONDS - 6.0, abs=1.5)


@pytest.mark.parametrize(
    ("told", "change"),
    [
        ("too little motion in the poses", lambda w, t: (0.02 * w, w)),
        ("too little motion in the reference", lambda w, t: (w, 0.0 * w)),
        ("do not show the same motion", lambda w, t: (w, w[::-1])),
        ("repeats itself", lambda w, t: 2 * (np.column_stack((np.sin(2 * np.pi * 4 * t) + 2.0, 0 * t, 0 * t)),)),
        ("beyond 0.3 s", lambda w, t: (w, np.roll(w, 62, axis=0))),
    ],
)
def test_where_the_motion_does_not_tell_it_is_refused_in_words(told, change):
    rng, t = np.random.default_rng(20140), np.arange(0.0, SECONDS, 0.005)
    a, b = change(at(turning(rng, quickest=1.0), t, rng, 0.0), t)
    with pytest.raises(BadInputError, match=told):
        find_delay(t, speed(a), t, speed(b))


def test_too_little_in_common_is_refused():
    rng, t = np.random.default_rng(20150), np.arange(0.0, SECONDS, 0.005)
    w = speed(at(turning(rng), t, rng, 0.0))
    with pytest.raises(BadInputError, match=r"4\.0 s in common"):
        find_delay(t, w, t + SECONDS - 4.0, w)
    with pytest.raises(BadInputError, match=r"0\.0 s in common"):
        find_delay(t, w, t + 100.0, w)


def orientations(w, step):
    q, out = np.array((1.0, 0.0, 0.0, 0.0)), []
    for row in w:
        out.append(q)
        q = quat_multiply(q, quat_from_rotvec(row * step))
    return out


def flight_log(path, delay, *, imu, config=""):
    rng = np.random.default_rng(20160)
    w = turning(rng)
    log = FlightLog(path, header={"config": config})
    stamps = np.arange(0.0, SECONDS, 0.005)
    turned, sent, felt = at(w, stamps, rng, 0.01), at(w, stamps + 0.03, rng, 0.0), at(w, stamps, rng, 0.02)
    rest, level = np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0))
    for i, t in enumerate(stamps.tolist()):
        log.write("pose", PoseSample(t + delay, rest, level, rest, turned[i], 3))
        log.write("command", RateCommand(t, sent[i], 9.8))
        if imu:
            log.write("imu", ImuSample(t, rest, felt[i]))
    log.close()
    return path


def test_a_flight_logs_own_imu_is_used_and_what_was_configured_is_added(tmp_path):
    path = flight_log(tmp_path / "flight.mcap", 0.012, imu=True, config="[sensors]\ndelay = 0.005\n")
    found = calibrate_delay(path)
    assert found.reference == "imu"
    assert found.found.delay == pytest.approx(0.012, abs=0.001)
    assert found.setting == pytest.approx(0.017, abs=0.001)
    result = json.loads(json.dumps(delay_json(found)))
    assert (result["setting"], result["includes_response"]) == (found.setting, False)
    assert "set sensors.delay = 0.01" in " ".join(delay_lines(found))


def test_commands_are_second_best_and_say_so(tmp_path):
    found = calibrate_delay(flight_log(tmp_path / "flight.mcap", 0.012, imu=False))
    # 12 ms of the tracker's, and 30 ms of the vehicle's response.
    assert found.found.delay == pytest.approx(0.042, abs=0.001)
    assert delay_json(found)["includes_response"]
    text = " ".join(delay_lines(found))
    assert "response lag" in text
    assert "set sensors.delay" not in text


@pytest.fixture
def files(tmp_path):
    """Poses without angular velocities, 25 ms late, and a gyroscope."""
    rng = np.random.default_rng(20170)
    w = turning(rng)
    t = np.arange(0.0, SECONDS, 0.005)
    poses, imu = tmp_path / "poses.csv", tmp_path / "imu.csv"
    q = orientations(at(w, t + 0.0025, rng, 0.0), 0.005)
    rows = [f"{s + 0.025!r},0,0,0,{','.join(map(repr, turn.tolist()))}" for s, turn in zip(t.tolist(), q, strict=True)]
    poses.write_text("\n".join(["stamp,x,y,z,qw,qx,qy,qz", *rows]), encoding="utf-8")
    rows = [",".join(map(repr, (s, *v))) for s, v in zip(t.tolist(), at(w, t, rng, 0.03).tolist(), strict=True)]
    imu.write_text("\n".join(["stamp,wx,wy,wz", *rows]), encoding="utf-8")
    return poses, imu


def test_two_plain_files(files):
    poses, imu = files
    found = calibrate_delay(poses, imu)
    assert found.found.delay == pytest.approx(0.025, abs=0.001)
    assert found.reference == str(imu)
    with pytest.raises(BadInputError, match="--against"):
        calibrate_delay(poses)


def test_the_command(files, tmp_path):
    from flightapp.cli import cli

    poses, imu = files
    out = tmp_path / "delay.json"
    result = CliRunner().invoke(cli, ["calibrate", "delay", str(poses), "--against", str(imu), "--json", str(out)])
    assert result.exit_code == 0, result.output
    assert "late by 25." in result.output or "late by 24." in result.output
    assert json.loads(out.read_text(encoding="utf-8"))["delay"] == pytest.approx(0.025, abs=0.001)
