import asyncio
import math

import numpy as np
import pytest
from mavlink_cases import Rig
from pymavlink.dialects.v20 import development as dialect

from flightapp.frames import quat_from_euler, quat_rotate
from sim.mavlink.codec import Decoder
from sim.mavlink.timesync import WINDOW, Timesync
from sim.mavlink.vision import UnsupportedError, from_odometry, from_position_estimate

Q = quat_from_euler(0.1, -0.2, 0.4)
"""Body FLU to z up."""
NAN21 = [math.nan] * 21


@pytest.fixture(autouse=True)
def quick_position(monkeypatch):
    """A position counts sooner than PX4 lets it."""
    monkeypatch.setattr("sim.px4.commander.PROBATION", 0.2)


def read(message):
    (frame,) = Decoder().frames(message.pack(dialect.MAVLink(None, 1, 191)))
    return frame


def odometry(frame=1, child=12, position=(1.0, -2.0, -3.0), q=None, velocity=(0.5, 0.0, 0.0), kind=3, quality=0):
    w, x, y, z = Q if q is None else q
    return read(
        dialect.MAVLink_odometry_message(
            2_000_000, frame, child, *position, [w, x, -y, -z], *velocity, 0, 0, 0, NAN21, NAN21, 7, kind, quality
        )
    )


@pytest.mark.parametrize(
    "frame, position",
    [(1, (1.0, -2.0, -3.0)), (20, (1.0, -2.0, -3.0)), (21, (1.0, 2.0, 3.0)), (4, (-2.0, 1.0, 3.0))],
)
def test_frames_of_the_position(frame, position):
    pose = from_odometry(odometry(frame=frame, position=position))
    assert pose.position.tolist() == [1.0, 2.0, 3.0]
    assert pose.orientation == pytest.approx(Q, abs=1e-6)
    assert (pose.stamp, pose.reset_counter) == (2.0, 7)


def test_frames_of_the_velocity():
    assert from_odometry(odometry(child=12)).velocity == pytest.approx(quat_rotate(Q, np.array((0.5, 0.0, 0.0))))
    assert from_odometry(odometry(child=1, velocity=(0.5, 1.0, 2.0))).velocity.tolist() == [0.5, -1.0, -2.0]
    assert from_odometry(odometry(child=21, velocity=(0.5, 1.0, 2.0))).velocity.tolist() == [0.5, 1.0, 2.0]
    assert from_odometry(odometry(child=0)).velocity is None
    assert from_odometry(odometry(velocity=(math.nan, 0.0, 0.0))).velocity is None


@pytest.mark.parametrize("scale, taken", [(1.0, True), (1.0 + 5e-6, True), (1.0001, False), (0.9, False), (0.0, False)])
def test_quaternions_must_be_unit(scale, taken):
    assert (from_odometry(odometry(q=scale * Q)) is not None) is taken


@pytest.mark.parametrize("bad", [{"frame": 0}, {"frame": 12}, {"position": (math.nan, 0.0, 0.0)}, {"kind": 6}])
def test_poses_that_ekf2_does_not_use(bad):
    assert from_odometry(odometry(**bad)) is None


def test_a_nan_quaternion_is_not_used():
    assert from_odometry(odometry(q=(math.nan, 0.0, 0.0, 0.0))) is None


def test_estimators_that_px4_complains_of():
    with pytest.raises(UnsupportedError, match="estimator_type 8 unsupported"):
        from_odometry(odometry(kind=8))


def test_a_least_quality():
    assert from_odometry(odometry(quality=-1), 0) is not None
    assert from_odometry(odometry(quality=10), 50) is None
    assert from_odometry(odometry(quality=50), 50) is not None


def test_position_estimates():
    message = dialect.MAVLink_vision_position_estimate_message(3_000_000, 1, -2, -3, 0.1, 0.2, -0.4, NAN21, 9)
    pose = from_position_estimate(read(message))
    assert pose.position.tolist() == [1.0, 2.0, 3.0]
    assert pose.orientation == pytest.approx(Q, abs=1e-6)
    assert (pose.stamp, pose.velocity, pose.reset_counter) == (3.0, None, 9)
    message.yaw = math.nan
    assert from_position_estimate(read(message)) is None


def test_a_peers_clock_is_believed_after_500_answers():
    clock, offset = Timesync(), -1234.5
    for n in range(WINDOW):
        assert clock.translate(50.0 - offset, 99.0) == 99.0
        sent = 0.1 * n
        clock.add(sent, sent + 0.0005 - offset, sent + 0.001)
    assert clock.converged
    assert clock.translate(50.0 - offset, 99.0) == pytest.approx(50.0, abs=1e-4)


def test_late_answers_do_not_count_and_a_jump_starts_anew():
    clock = Timesync()
    for n in range(2 * WINDOW):
        clock.add(0.1 * n, 0.0, 0.1 * n + 0.02)
    assert not clock.converged
    for n in range(WINDOW):
        clock.add(0.1 * n, 0.1 * n, 0.1 * n)
    assert clock.converged
    for n in range(10):
        clock.add(60.0 + n, 90.0 + n, 60.0 + n)
    assert not clock.converged


@pytest.mark.parametrize("form", ["odometry", "frd", "position"])
async def test_each_form_gives_a_local_position(form):
    async with Rig() as rig:
        for _ in range(150):
            if form == "position":
                x, y, z = rig.world.plant.position.tolist()
                message = dialect.MAVLink_vision_position_estimate_message(0, x, -y, -z, 0, 0, 0, NAN21, 0)
            else:
                message = rig.vision(frame=20 if form == "frd" else 1)
            rig.client.send(message)
            await asyncio.sleep(0.025)
            if rig.px4.ready:
                break
        assert rig.px4.ready


async def test_px4_says_what_it_cannot_use():
    async with Rig() as rig:
        text = asyncio.ensure_future(rig.client.wait("STATUSTEXT", lambda m: "estimator_type" in m.text))
        await asyncio.sleep(0)
        rig.client.send(rig.vision(estimator=8))
        assert (await text).text == "ODOMETRY: estimator_type 8 unsupported"
        assert not rig.px4.ready
