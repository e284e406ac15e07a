import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.local_frame import LocalFrame
from flightapp.autopilot.telemetry import odometry
from flightapp.autopilot.vision import VisionEncoder
from flightapp.config import load_config
from flightapp.frames import quat_from_euler
from flightapp.messages import PoseSample


def sample(stamp=0.0, position=(1.0, 2.0, 3.0), yaw=0.3, velocity=(0.4, -0.5, 0.6), confidence=3):
    orientation = quat_from_euler(0.1, -0.2, yaw)
    return PoseSample(stamp, np.array(position), orientation, np.array(velocity), np.array((0.1, 0.2, 0.3)), confidence)


def encoder(frame=None, **settings):
    config = load_config(None, {f"external_vision.{k}": v for k, v in settings.items()}).external_vision
    return VisionEncoder(config, frame or LocalFrame(config.jump))


@given(st.tuples(*[st.floats(-50.0, 50.0)] * 3), st.floats(-3.1, 3.1), st.tuples(*[st.floats(-20.0, 20.0)] * 3))
def test_what_is_sent_as_odometry_reads_back_as_it_was(position, yaw, velocity):
    pose = sample(position=position, yaw=yaw, velocity=velocity)
    frame = LocalFrame(math.inf)
    frame.take(sample(position=(0.0, 0.0, 0.0)))
    vision = encoder(frame)
    fields = json.loads(vision.encode(pose, 123))
    assert (fields["frame_id"], fields["child_frame_id"], fields["time_usec"]) == (1, 12, 123)
    assert math.hypot(*fields["q"]) == pytest.approx(1.0, abs=1e-7)
    back = odometry(pose.stamp, fields)
    np.testing.assert_allclose(back.position, pose.position, atol=1e-6)
    np.testing.assert_allclose(back.velocity, pose.velocity, atol=1e-6)
    np.testing.assert_allclose(back.angular_velocity, pose.angular_velocity, atol=1e-6)
    assert abs(back.orientation @ pose.orientation) == pytest.approx(1.0, abs=1e-9)


def test_the_origin_is_where_the_vehicle_stands_and_moves_with_a_reset_that_is_told():
    frame = LocalFrame(0.3)
    vision = encoder(frame)
    assert not frame.move()
    first = json.loads(vision.encode(sample(stamp=0.0), 0))
    assert (first["x"], first["y"], first["z"], first["reset_counter"]) == (0.0, 0.0, 0.0, 0)
    later = json.loads(vision.encode(sample(stamp=1.0, position=(1.5, 1.8, 3.3)), 0))
    assert (later["x"], later["y"], later["z"]) == pytest.approx((0.5, 0.2, -0.3))
    resets = frame.resets
    assert frame.move()
    assert not frame.move()
    moved = json.loads(vision.encode(sample(stamp=2.0, position=(1.5, 1.8, 3.4)), 0))
    assert (moved["x"], moved["y"], moved["z"]) == pytest.approx((0.0, 0.0, -0.1))
    assert moved["reset_counter"] == resets + 1


def test_the_frame_follows_the_configured_message():
    assert json.loads(encoder(message="odometry_frd").encode(sample(), 0))["frame_id"] == 20


def test_position_estimates_carry_ned_angles():
    frame = LocalFrame(math.inf)
    frame.take(sample(position=(0.0, 0.0, 0.0)))
    vision = encoder(frame, message="position")
    assert vision.name == "VISION_POSITION_ESTIMATE"
    fields = json.loads(vision.encode(sample(), 5))
    assert (fields["x"], fields["y"], fields["z"], fields["usec"]) == (1.0, -2.0, -3.0, 5)
    assert (fields["roll"], fields["pitch"], fields["yaw"]) == pytest.approx((0.1, 0.2, -0.3), abs=1e-6)


def test_covariances_are_variances_on_the_diagonal():
    fields = json.loads(encoder(position_noise=0.1, velocity_noise=0.2, attitude_noise=0.3).encode(sample(), 0))
    place = [0, 6, 11, 15, 18, 20]
    assert np.array(fields["pose_covariance"])[place] == pytest.approx([0.01] * 3 + [0.09] * 3)
    assert np.array(fields["velocity_covariance"])[place][:3] == pytest.approx([0.04] * 3)
    assert len(fields["pose_covariance"]) == len(fields["velocity_covariance"]) == 21
    poor = json.loads(encoder(position_noise=0.1).encode(sample(confidence=1), 0))
    assert poor["pose_covariance"][0] == pytest.approx(1.0)


def test_poses_at_200_hz_are_thinned_to_the_configured_rate():
    vision = encoder(rate=40.0)
    sent = sum(vision.encode(sample(stamp=k / 200.0), 0) is not None for k in range(400))
    assert sent == pytest.approx(80, abs=2)


def test_a_jump_is_counted_and_told():
    frame = LocalFrame(0.3)
    vision = encoder(frame)
    vision.encode(sample(stamp=0.0), 0)
    vision.encode(sample(stamp=0.005), 0)
    assert frame.resets == 0
    fields = json.loads(vision.encode(sample(stamp=0.1, position=(2.0, 2.0, 3.0)), 0))
    assert (frame.resets, fields["reset_counter"]) == (1, 1)


def test_fast_flight_is_no_jump():
    frame = LocalFrame(0.3)
    vision = encoder(frame)
    for k in range(200):
        t = k / 200.0
        vision.encode(sample(stamp=t, position=(20.0 * t, 0.0, 1.0), velocity=(20.0, 0.0, 0.0)), 0)
    vision.encode(sample(stamp=1.2, position=(24.0, 0.0, 1.0), velocity=(20.0, 0.0, 0.0)), 0)  # after a gap
    assert frame.resets == 0


@pytest.mark.parametrize(
    "bad",
    [
        {"position": np.array((math.nan, 0.0, 0.0))},
        {"velocity": np.array((0.0, math.inf, 0.0))},
        {"orientation": np.zeros(4)},
        {"confidence": 0},
    ],
)
def test_poses_without_worth_are_not_passed_on(bad):
    vision = encoder()
    assert vision.encode(replace(sample(), **bad), 0) is None
    assert vision.refused == 1
