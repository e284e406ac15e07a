"""Recorded poses: every format, what is derived, bad files, and their replay at real and virtual time."""

import asyncio
import math
import time

import numpy as np
import pytest
from fakes import virtually

from flightapp.config import load_config
from flightapp.frames import quat_from_euler
from flightapp.inputs import BadInputError
from flightapp.messages import PoseSample
from flightapp.recording.writer import FlightLog
from flightapp.sensors.intake import PoseFault
from flightapp.sensors.pose_files import read_poses, read_turning
from flightapp.sensors.replay import ReplayPoses
from flightapp.track import Start

RATE = 100.0
HEADER = "stamp,x,y,z,qw,qx,qy,qz"


def motion(t):
    """Position and orientation of a smooth flight."""
    return (
        np.array((2.0 * math.sin(0.8 * t), 1.5 * math.cos(0.6 * t), 1.0 + 0.2 * t)),
        quat_from_euler(0.3 * math.sin(1.1 * t), 0.2 * math.cos(t), 0.9 * t),
    )


def rows(seconds=2.0):
    for t in np.arange(0.0, seconds, 1.0 / RATE):
        yield t, *motion(t)


def write(path, lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def csv(path, rows, head=HEADER):
    return write(path, [head, *(",".join(repr(float(v)) for v in (t, *p, *q)) for t, p, q in rows)])


def tum(path, rows):
    order = (1, 2, 3, 0)
    return write(
        path, ["# a comment", *(" ".join(repr(float(v)) for v in (t, *p, *q[list(order)])) for t, p, q in rows)]
    )


def euroc(path, rows, extra=()):
    head = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
    names = ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1]" if extra else ""
    lines = [
        f"{1403636580838555648 + round(1e9 * t)},{','.join(map(repr, (*p.tolist(), *q.tolist(), *extra)))}"
        for t, p, q in rows
    ]
    return write(path, [head + names, *lines])


@pytest.mark.parametrize(("name", "make"), [("a.csv", csv), ("a.tum", tum), ("a.txt", tum), ("data.csv", euroc)])
def test_every_format_reads_back_with_derived_velocities(tmp_path, name, make):
    recording = read_poses(make(tmp_path / name, rows()))
    poses, h = recording.poses, 1e-5
    assert not recording.of_body
    assert len(poses.stamp) == 200
    np.testing.assert_allclose(poses.stamp - poses.stamp[0], np.arange(200) / RATE, atol=1e-6)
    for i in (1, 57, 198):
        t = i / RATE
        position, q = motion(t)
        np.testing.assert_allclose(poses.position[i], position)
        np.testing.assert_allclose(poses.orientation[i], q)
        np.testing.assert_allclose(poses.velocity[i], (motion(t + h)[0] - position) / h, atol=1e-3)
        a, b = q, motion(t + h)[1]
        turn = 2.0 * (a[0] * b[1:] - b[0] * a[1:] - np.cross(a[1:], b[1:])) / h
        np.testing.assert_allclose(poses.angular_velocity[i], turn, atol=1e-3)
    assert np.isnan(poses.acceleration).all()
    assert set(poses.confidence) == {3}
    assert set(poses.epoch) == {0}


def test_a_quaternions_sign_does_not_turn_anything(tmp_path):
    flipped = [(t, p, q if round(RATE * t) % 2 else -q) for t, p, q in rows()]
    here, there = read_poses(csv(tmp_path / "a.csv", rows())), read_poses(csv(tmp_path / "b.csv", flipped))
    np.testing.assert_allclose(there.poses.angular_velocity, here.poses.angular_velocity, atol=1e-12)


def test_columns_that_are_given_are_taken_in_any_order(tmp_path):
    head = "note,qw,qx,qy,qz,confidence,epoch,x,y,z,wx,wy,wz,vx,vy,vz,ax,ay,az,stamp"
    path = write(tmp_path / "a.csv", [head, "5,1,0,0,0,2,9,1,2,3,4,5,6,7,8,9,10,11,12,0.5"])
    poses = read_poses(path).poses
    np.testing.assert_array_equal(poses.position, [[1, 2, 3]])
    np.testing.assert_array_equal(poses.angular_velocity, [[4, 5, 6]])
    np.testing.assert_array_equal(poses.velocity, [[7, 8, 9]])
    np.testing.assert_array_equal(poses.acceleration, [[10, 11, 12]])
    assert (poses.stamp[0], poses.confidence[0], poses.epoch[0]) == (0.5, 2, 9)


def test_euroc_velocities_are_taken(tmp_path):
    poses = read_poses(euroc(tmp_path / "data.csv", rows(0.1), extra=(7.0, 8.0, 9.0, 0.01))).poses
    np.testing.assert_array_equal(poses.velocity, np.tile((7.0, 8.0, 9.0), (10, 1)))


def test_turning_of_a_gyroscope(tmp_path):
    path = write(tmp_path / "imu.csv", ["stamp,wx,wy,wz", "1,0.1,0.2,0.3", "1.01,0.4,0.5,0.6"])
    stamp, turning = read_turning(path)
    np.testing.assert_array_equal(stamp, [1.0, 1.01])
    np.testing.assert_array_equal(turning, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2]"
    path = write(tmp_path / "data.csv", [head, "1000000000,0.1,0.2,0.3,9", "1010000000,0.4,0.5,0.6,9"])
    np.testing.assert_allclose(read_turning(path)[0], [1.0, 1.01])
    with pytest.raises(BadInputError, match="w_"):
        read_turning(euroc(tmp_path / "poses.csv", rows(0.1)))


GOOD = "1.0,0,0,0,1,0,0,0"


@pytest.mark.parametrize(
    ("name", "lines", "told"),
    [
        ("a.csv", [HEADER, GOOD, "1.1,0,0,0,1,0,0"], r"a\.csv:3: 7 values where there must be 8"),
        ("a.csv", [HEADER, GOOD, "", "1.1,0,zero,0,1,0,0,0"], r"a\.csv:4: not a number: 'zero'"),
        ("a.csv", [HEADER, GOOD, "1.1,0,0,0,1,0,0,0", GOOD], r"a\.csv:4: the stamp does not come after"),
        ("a.csv", [HEADER, "nan,0,0,0,1,0,0,0"], r"a\.csv:2: the stamp"),
        ("a.csv", ["stamp,x,y,z", "1,2,3,4"], r"a\.csv:1: there is no column qw, qx, qy, qz"),
        ("a.csv", ["time,x", "1,2"], r"a\.csv:1: there is no column stamp; known here: time, x"),
        ("a.csv", [HEADER], "no samples"),
        ("a.csv", [""], "no samples"),
        ("a.csv", [HEADER + ",confidence", GOOD + ",-1"], r"a\.csv:2: confidence must be a whole number"),
        ("a.csv", ["#timestamp [ns],w_RS_S_x [rad s^-1]", "1,2"], r"a\.csv:1: not the EuRoC file"),
        ("a.tum", ["# t x y z", "1 2 3 4 0 0 0"], r"a\.tum:2: 7 values where there must be 8"),
        ("a.bag", ["x"], r"end in \.mcap, \.csv, \.txt, \.tum"),
        ("a.mcap", ["x"], "not an MCAP file"),
    ],
)
def test_bad_files_are_told_with_their_lines(tmp_path, name, lines, told):
    with pytest.raises(BadInputError, match=told):
        read_poses(write(tmp_path / name, lines))


def test_files_that_are_missing_or_no_text(tmp_path):
    with pytest.raises(BadInputError, match="no such"):
        read_poses(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInputError, match="not a text file"):
        read_poses(tmp_path / "b.csv")


def settings(*texts):
    return load_config(None, None, [f"sensors.{text}" for text in texts])


async def replayed(path, *texts, start=None):
    source, loop = ReplayPoses(path, settings(*texts), start), asyncio.get_running_loop()
    begin = loop.time()
    got = [(loop.time() - begin, sample) async for sample in source.poses()]
    return got, begin, source.intake


def test_virtual_time_gives_every_sample_at_its_stamp(tmp_path):
    got, begin, intake = virtually(replayed(csv(tmp_path / "a.csv", rows())))
    assert intake.taken == len(got) == 200
    for i, (elapsed, sample) in enumerate(got):
        assert elapsed == pytest.approx(i / RATE, abs=1e-6)
        assert sample.stamp == pytest.approx(begin + i / RATE, abs=1e-6)
    np.testing.assert_allclose(got[57][1].position, motion(0.57)[0])


async def test_real_time_is_kept_and_a_slow_consumer_skips(tmp_path):
    path = csv(tmp_path / "a.csv", rows(0.5))
    begin = time.monotonic()
    got, _, _ = await replayed(path)
    assert 0.45 < time.monotonic() - begin < 2.0
    assert len(got) > 10
    loop, seen = asyncio.get_running_loop(), []
    async for sample in ReplayPoses(path, settings()).poses():
        seen.append(loop.time() - sample.stamp)
        await asyncio.sleep(0.1)
    assert len(seen) < 8
    assert max(seen) < 0.09


def test_mount_delay_and_start_apply_to_a_trackers_recording(tmp_path):
    path = csv(tmp_path / "a.csv", rows(0.1))
    start = Start(position=(5.0, 6.0, 0.5), yaw_deg=30.0)
    for delay in (0.03, -0.03):
        got, begin, intake = virtually(replayed(path, f"delay={delay}", "frame='start'", start=start))
        assert len(got) == 10, intake.report()
        np.testing.assert_allclose(got[0][1].position, start.position, atol=1e-12)
        assert got[0][1].stamp == pytest.approx(begin - delay)


def test_a_flight_logs_poses_are_the_bodys(tmp_path):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header={})
    for i, (t, p, q) in enumerate(rows(0.5)):
        frame, told = (1, None) if i >= 25 else (0, np.array((1.0, 2.0, 3.0)))
        log.write("pose", PoseSample(50.0 + t, p + 20.0 * frame, q, np.ones(3), np.ones(3), 2, told, frame))
    log.close()
    got, begin, _ = virtually(replayed(path, "mount_position=[1.0, 0.0, 0.0]", "delay=0.1"))
    assert len(got) == 50
    assert [sample.epoch for _, sample in got] == [0] * 25 + [1] * 25
    np.testing.assert_allclose(got[7][1].position, motion(0.07)[0])
    np.testing.assert_allclose(got[7][1].acceleration, (1.0, 2.0, 3.0))
    assert got[30][1].acceleration is None
    assert got[0][1].stamp == pytest.approx(begin)


def test_a_log_without_poses_is_told(tmp_path):
    path = tmp_path / "flight.mcap"
    FlightLog(path, header={}).close()
    with pytest.raises(BadInputError, match="no poses"):
        ReplayPoses(path, settings())


def test_what_is_wrong_in_a_recording_is_refused_by_the_intake(tmp_path):
    data = list(rows(0.2))
    data[7] = (data[7][0], np.full(3, math.nan), data[7][2])
    got, _, intake = virtually(replayed(csv(tmp_path / "a.csv", data)))
    # Central differences take the samples beside it along.
    assert len(got) == 17
    assert intake.refused[PoseFault.NOT_FINITE] == 3
