"""The intake: each fault is told, counted and handled; the mount, the delay and the start are taken out."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.frames import quat_from_euler, quat_from_yaw, quat_multiply, quat_rotate, quat_to_matrix, quat_yaw
from flightapp.messages import PoseSample
from flightapp.sensors.intake import PoseFault, PoseIntake
from flightapp.track import Start

LEVEL = np.array((1.0, 0.0, 0.0, 0.0))
PERIOD = 0.005


def intake(*settings, start=None):
    return PoseIntake(load_config(None, None, [f"sensors.{text}" for text in settings]), start)


def walk(stamp, speed=2.0, **changes):
    """Along x at ``speed``, with a little noise, since a living tracker has some."""
    noise = 1e-4 * math.sin(7919.0 * stamp)
    fields = {"position": np.array((speed * stamp, noise, 1.0)), "orientation": LEVEL.copy()}
    fields |= {"velocity": np.array((speed, noise, 0.0)), "angular_velocity": np.zeros(3), "confidence": 3}
    return PoseSample(stamp, **(fields | changes))


def feed(door, samples):
    return [door.take(sample, sample.stamp + 0.004) for sample in samples]


def stamps(count, begin=1.0):
    return [begin + PERIOD * i for i in range(count)]


def counted(door):
    return {fault.name: n for fault, n in door.refused.items() if n}


def test_what_is_well_passes_unchanged():
    door = intake()
    sample = walk(1.0, acceleration=np.array((0.1, 0.2, 0.3)))
    got = door.take(sample, 1.004)
    for name in ("position", "orientation", "velocity", "angular_velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(got, name), getattr(sample, name))
        assert getattr(got, name).flags.writeable
    assert (got.stamp, got.confidence, got.epoch) == (1.0, 3, 0)
    assert (door.taken, door.fault, counted(door)) == (1, PoseFault.NONE, {})
    assert door.take(walk(1.005), 1.009).acceleration is None


@pytest.mark.parametrize(
    ("fault", "changes"),
    [
        ("NOT_FINITE", {"position": np.array((0.0, math.nan, 0.0))}),
        ("NOT_FINITE", {"velocity": np.array((math.inf, 0.0, -math.inf))}),
        ("NOT_FINITE", {"acceleration": np.array((0.0, 0.0, math.nan))}),
        ("NOT_FINITE", {"stamp": math.nan}),
        ("IMPLAUSIBLE", {"position": np.array((1e300, 0.0, 0.0))}),
        ("IMPLAUSIBLE", {"velocity": np.array((0.0, -200.0, 0.0))}),
        ("IMPLAUSIBLE", {"angular_velocity": np.array((0.0, 0.0, 1e3))}),
        ("NOT_UNIT", {"orientation": np.zeros(4)}),
        ("NOT_UNIT", {"orientation": 1.002 * LEVEL}),
        ("FUTURE", {"stamp": 2.02}),
        ("STALE", {"stamp": 1.75}),
        ("DUPLICATE", {"stamp": 1.9}),
        ("OUT_OF_ORDER", {"stamp": 1.89}),
        ("LOST", {"confidence": 0}),
        ("JUMP", {"position": np.array((9.0, 0.0, 1.0))}),
        ("JUMP", {"orientation": quat_from_yaw(0.5)}),
    ],
)
def test_each_fault_is_told_counted_and_refused_and_the_next_good_one_passes(fault, changes):
    door = intake()
    assert door.take(walk(1.9), 1.9) is not None
    assert door.take(replace(walk(2.0), **changes), 2.0) is None
    assert (door.fault.name, counted(door)) == (fault, {fault: 1})
    assert fault.lower().replace("_", " ") in door.report()
    assert door.take(walk(2.005), 2.005) is not None
    assert (door.taken, door.epoch, door.fault) == (2, 0, PoseFault.NONE)


def test_nearly_unit_is_normalised():
    got = intake().take(walk(1.0, orientation=0.9995 * quat_from_yaw(0.3)), 1.0)
    assert np.linalg.norm(got.orientation) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(got.orientation, quat_from_yaw(0.3), atol=1e-15)


def test_frozen_is_refused_after_50_ms_until_it_moves():
    door = intake()
    feed(door, [walk(t) for t in stamps(4)])
    stuck = walk(1.02)
    got = feed(door, [replace(stuck, stamp=t) for t in (1.02, *stamps(30, 1.022))])
    passed = [sample is not None for sample in got]
    assert passed == [True] * 11 + [False] * 20
    assert counted(door) == {"FROZEN": 20}
    # Alive again where its speed has taken it meanwhile: no jump.
    assert door.take(walk(1.17), 1.17) is not None
    assert door.epoch == 0


def test_standing_still_without_noise_is_not_frozen():
    rest = replace(walk(1.0, speed=0.0), velocity=np.zeros(3))
    assert None not in feed(intake(), [replace(rest, stamp=t) for t in stamps(100)])
    # Nothing stops dead from 2 m/s: a tracker that says so has frozen, whatever speed it reports.
    door = intake()
    feed(door, [walk(t) for t in stamps(4)])
    stuck = replace(walk(1.02), velocity=np.zeros(3))
    assert None in feed(door, [replace(stuck, stamp=t) for t in stamps(30, 1.02)])


def test_one_outlier_is_dropped_and_agreeing_jumps_are_a_relocalisation():
    door = intake()
    feed(door, [walk(t) for t in stamps(10)])
    away = np.array((2.0, -1.0, 0.0))
    assert door.take(walk(1.05, position=walk(1.05).position + away), 1.05) is None
    assert door.take(walk(1.055), 1.055).epoch == 0
    got = feed(door, [walk(t, position=walk(t).position + away) for t in stamps(20, 1.06)])
    taken = [sample for sample in got if sample is not None]
    assert [sample is None for sample in got] == [True] * 9 + [False] * 11
    assert {sample.epoch for sample in taken} == {1}
    assert (door.epoch, counted(door)) == (1, {"JUMP": 10})
    # And back, after a second relocalisation.
    back = feed(door, [walk(t) for t in stamps(20, 1.16)])
    assert back[-1].epoch == 2


def test_a_turn_that_no_rate_explains_is_a_jump_and_one_that_it_does_is_not():
    door = intake()
    spin = {"angular_velocity": np.array((0.0, 0.0, 10.0))}
    turning = [walk(t, orientation=quat_from_yaw(10.0 * t), **spin) for t in stamps(40)]
    assert None not in feed(door, turning)
    late = replace(turning[-1], stamp=1.3, position=walk(1.3).position, orientation=quat_from_yaw(13.0))
    assert door.take(late, 1.3) is not None, "after 0.1 s of silence"
    got = feed(door, [walk(t, orientation=quat_from_yaw(13.0 + 1.5)) for t in stamps(12, 1.305)])
    assert (got[0], got[-1].epoch) == (None, 1)


def test_jumps_that_do_not_agree_never_move_the_frame():
    door, rng = intake(), np.random.default_rng(20001)
    feed(door, [walk(1.0)])
    for t in stamps(400, 1.005):
        away = rng.uniform(-50.0, 50.0, 3) + np.array((100.0 * rng.integers(-3, 4), 200.0, 0.0))
        assert door.take(walk(t, position=away), t) is None
    assert (door.epoch, counted(door)) == (0, {"JUMP": 400})


def test_a_source_that_tells_of_another_frame_is_believed_at_once():
    door = intake()
    feed(door, [walk(t) for t in stamps(3)])
    moved = walk(1.015, position=np.array((7.0, 7.0, 1.0)), epoch=40)
    assert door.take(replace(moved, confidence=0), 1.015) is None
    assert door.take(replace(moved, stamp=1.02), 1.02).epoch == 1
    assert door.take(replace(walk(1.025, position=np.array((7.01, 7.0, 1.0))), epoch=40), 1.025).epoch == 1
    assert door.epoch == 1


def test_the_first_epoch_is_none():
    door = intake()
    assert door.take(walk(1.0, epoch=123456789012), 1.0).epoch == 0


def test_the_delay_is_taken_out_before_stamps_are_judged():
    door = intake("delay=0.03")
    assert door.take(walk(1.0), 0.99).stamp == pytest.approx(0.97), "late stamps, so not from the future"
    assert door.take(walk(1.1), 1.28) is None
    assert counted(door) == {"STALE": 1}
    assert intake("delay=-0.02").take(walk(1.0), 1.03).stamp == pytest.approx(1.02)


def body_motion(t):
    """A smooth motion of the body: position, attitude, velocity, acceleration, angular velocity and acceleration."""
    position = np.array((math.sin(1.3 * t), 0.5 * math.cos(2.1 * t), 0.3 * math.sin(0.7 * t)))
    return position, quat_from_euler(0.4 * math.sin(2.0 * t), 0.3 * math.cos(1.7 * t), 0.8 * t)


def derivative(function, t, h=1e-4):
    return (function(t + h) - function(t - h)) / (2.0 * h)


def turning_of(q_at, t, h=1e-4):
    R, R_dot = quat_to_matrix(q_at(t)), (quat_to_matrix(q_at(t + h)) - quat_to_matrix(q_at(t - h))) / (2.0 * h)
    W = R.T @ R_dot
    return np.array((W[2, 1], W[0, 2], W[1, 0]))


def test_mount_is_taken_out_of_pose_velocity_rate_and_acceleration():
    arm, rpy = np.array((0.1, -0.05, 0.03)), (10.0, -35.0, 80.0)
    door = intake(f"mount_position={arm.tolist()}", f"mount_rpy_deg={list(rpy)}")
    q_bt = quat_from_euler(*np.radians(rpy))

    def tracker(t):
        position, q = body_motion(t)
        return position + quat_rotate(q, arm)

    def tracker_q(t):
        return quat_multiply(body_motion(t)[1], q_bt)

    def measured(t):
        velocity = derivative(tracker, t)
        push = derivative(lambda s: derivative(tracker, s), t)
        return PoseSample(t, tracker(t), tracker_q(t), velocity, turning_of(tracker_q, t), 3, push)

    for t in stamps(40):
        got = door.take(measured(t), t)
    position, q = body_motion(t)
    body = lambda s: body_motion(s)[0]  # noqa: E731
    np.testing.assert_allclose(got.position, position, atol=1e-12)
    assert abs(got.orientation @ q) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(got.velocity, derivative(body, t), atol=1e-6)
    np.testing.assert_allclose(got.angular_velocity, turning_of(lambda s: body_motion(s)[1], t), atol=1e-6)
    # The angular acceleration is by the last difference, so half a sample late.
    np.testing.assert_allclose(got.acceleration, derivative(lambda s: derivative(body, s), t), atol=0.01)
    assert door.refused[PoseFault.JUMP] == 0


def test_start_moves_the_frame_so_that_the_first_sample_is_there():
    start = Start(position=(4.0, -2.0, 0.1), yaw_deg=90.0)
    door = intake("frame='start'", start=start)
    begin = walk(1.0, orientation=quat_from_yaw(-0.4), acceleration=np.array((1.0, 0.0, 0.5)))
    first = door.take(begin, 1.0)
    np.testing.assert_allclose(first.position, start.position, atol=1e-12)
    assert quat_yaw(first.orientation) == pytest.approx(0.5 * math.pi)
    turned = quat_from_yaw(0.5 * math.pi + 0.4)
    np.testing.assert_allclose(first.velocity, quat_rotate(turned, begin.velocity), atol=1e-12)
    np.testing.assert_allclose(first.acceleration, quat_rotate(turned, begin.acceleration), atol=1e-12)
    later = door.take(walk(1.1, orientation=quat_from_yaw(-0.4)), 1.1)
    way = quat_rotate(turned, walk(1.1).position - begin.position)
    np.testing.assert_allclose(later.position - first.position, way, atol=1e-12)


def test_of_body_heeds_neither_mount_nor_delay_nor_start():
    settings = ["sensors.mount_position=[1.0, 0.0, 0.0]", "sensors.delay=0.05", "sensors.frame='start'"]
    door = PoseIntake.of_body(load_config(None, None, [*settings, "sensors.mount_rpy_deg=[0.0, 0.0, 90.0]"]))
    got, sample = door.take(walk(1.0), 1.0), walk(1.0)
    np.testing.assert_array_equal(got.position, sample.position)
    np.testing.assert_array_equal(got.orientation, sample.orientation)
    assert got.stamp == 1.0


NUMBER = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(st.lists(NUMBER, min_size=13, max_size=13), NUMBER, NUMBER, st.integers(0, 3)), max_size=20))
def test_whatever_comes_what_leaves_is_finite_unit_timely_and_in_order(storm):
    door, last = intake("mount_position=[0.1, 0.0, 0.0]"), -math.inf
    for numbers, stamp, now, confidence in storm:
        n = np.array(numbers)
        got = door.take(PoseSample(stamp, n[:3], n[3:7], n[7:10], n[10:13], confidence), now)
        if got is not None:
            assert np.isfinite(np.concatenate((got.position, got.velocity, got.angular_velocity))).all()
            assert abs(np.linalg.norm(got.orientation) - 1.0) < 1e-9
            assert last < got.stamp <= now + 0.005
            last = got.stamp
    assert door.taken + sum(door.refused.values()) == len(storm)


def test_a_storm_of_nan_leaves_the_next_good_sample_alone():
    door = intake()
    feed(door, [walk(1.0)])
    for t in stamps(1000, 1.001):
        assert door.take(walk(1.002, position=np.full(3, math.nan)), t) is None
    assert door.take(walk(1.005), 1.005) is not None
    assert counted(door) == {"NOT_FINITE": 1000}


def test_arrays_of_other_lengths_are_an_error():
    with pytest.raises(ValueError, match=r"shape|dimension|match"):
        intake().take(walk(1.0, position=np.zeros(2)), 1.0)
