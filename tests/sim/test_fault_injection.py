"""What is injected into the sensors and the gates of a world in the same process."""

import asyncio

import numpy as np
import pytest

from flightapp.config import Config, load_config
from flightapp.inputs import BadInputError
from flightapp.messages import Frame, GroundTruth, MarkerDetection, PoseSample
from flightapp.track import Gate, GateShape, Start, Track
from sim.clock import VirtualLoop
from sim.faults import read_faults
from sim.gate_faults import rearranged
from sim.mavlink.faults import Faults
from sim.rig import SimRig
from sim.sensor_faults import ASIDE, CameraFaults, PoseFaults
from sim.world import World

TRACK = Track(
    name="two",
    start=Start(position=(0.0, 0.0, 0.0), yaw_deg=0.0),
    finish=(9.0, 0.0, 1.5),
    gate=GateShape(layout="top"),
    gates=(
        Gate(id=1, position=(3.0, 0.0, 1.5), yaw_deg=0.0, markers=(0,)),
        Gate(id=2, position=(6.0, 1.0, 2.0), yaw_deg=90.0, markers=(1,)),
    ),
)


def pose(stamp, x):
    turned = np.array((np.cos(0.1), 0.0, 0.0, np.sin(0.1)))
    return PoseSample(stamp, np.array((x, 2.0, 1.0)), turned, np.array((4.0, 0.0, 0.0)), np.zeros(3), 3)


def told(entry, stamps):
    faults = PoseFaults(read_faults([entry]))
    return [faults.apply(pose(stamp, 4.0 * stamp)) for stamp in stamps]


def at(stamp):
    return np.array((stamp, 0.0, 1.0)), np.array((1.0, 0.0, 0.0, 0.0))


def shown(entries, stamps, seed=0):
    """The frames, or None, at ``stamps``; a frame's only marker shows from where it was taken."""
    faults = CameraFaults(read_faults(entries), seed)
    frames = []
    for i, stamp in enumerate(stamps):
        take = lambda pose_at, stamp=stamp, i=i: Frame(  # noqa: E731
            stamp, i, np.full((4, 4), 90, np.uint8), (MarkerDetection(0, np.resize(pose_at(stamp)[0], (4, 2))),)
        )
        frames.append(faults.expose(stamp, at, take))
    return frames


def test_a_silent_tracker_is_silent_for_as_long_as_it_was_told():
    got = told((1.0, "pose_silent", 0.2), [0.99, 1.0, 1.1, 1.19, 1.2, 1.3])
    assert [sample is not None for sample in got] == [True, False, False, False, True, True]


def test_a_jump_comes_back():
    got = told((1.0, "pose_jump", 2.0), [0.99, 1.0, 1.025, 1.03])
    assert [round(sample.position[0] - 4.0 * sample.stamp, 6) for sample in got] == [0.0, 2.0, 2.0, 0.0]


def test_a_frozen_tracker_repeats_its_last_pose_with_new_stamps():
    got = told((1.0, "pose_frozen", "0.5"), [0.99, 1.0, 1.4, 1.5])
    assert [sample.stamp for sample in got] == [0.99, 1.0, 1.4, 1.5]
    assert [sample.position[0] for sample in got] == pytest.approx([3.96, 3.96, 3.96, 6.0])


def test_a_relocalised_tracker_goes_on_in_a_frame_that_lies_elsewhere():
    before, first, second = told((1.0, "pose_relocalised", "2:90"), [0.9, 1.0, 1.5])
    assert before.position[0] == pytest.approx(3.6)
    assert first.position == pytest.approx((6.0, 2.0, 1.0))
    assert second.position == pytest.approx((6.0, 4.0, 1.0))
    assert second.velocity == pytest.approx((0.0, 4.0, 0.0))
    yaw = 2.0 * np.arctan2(second.orientation[3], second.orientation[0])
    assert yaw == pytest.approx(0.2 + np.pi / 2.0)


def test_a_frozen_camera_repeats_its_last_image_with_new_stamps():
    frames = shown([(1.0, "camera_frozen", 0.2)], [0.9, 1.0, 1.1, 1.3])
    assert [frame.stamp for frame in frames] == [0.9, 1.0, 1.1, 1.3]
    assert [frame.sequence for frame in frames] == [0, 1, 2, 3]
    assert [frame.markers[0].corners[0, 0] for frame in frames] == [0.9, 0.9, 0.9, 1.3]


def test_a_black_image_shows_nothing():
    seen, black = shown([(1.0, "camera_black", 0.2)], [0.9, 1.0])
    assert seen.markers
    assert seen.image.any()
    assert not black.markers
    assert not black.image.any()


def test_a_slow_camera_shows_as_many_images_as_it_was_told():
    frames = shown([(1.0, "camera_slow", 5.0)], 1.0 + np.arange(61) / 30.0)
    assert sum(frame is not None for frame in frames) == 11


def test_a_late_camera_is_late_from_then_on():
    faults = CameraFaults(read_faults([(1.0, "camera_late", 0.185)]), 0)
    assert [faults.lateness(stamp) for stamp in (0.9, 1.0, 50.0)] == [0.0, 0.185, 0.185]


def test_the_told_share_of_the_images_is_taken_from_elsewhere():
    stamps = np.arange(1000) / 30.0
    off = [abs(f.markers[0].corners[0, 0] - f.stamp) for f in shown([(0.0, "sightings_wrong", 0.3)], stamps, 3)]
    assert 250 < sum(way > 1e-9 for way in off) < 350
    assert max(off) <= ASIDE[1]


def test_a_wrong_calibration_is_the_one_that_flight_code_gets():
    faults = "sim.faults=[[0.0, 'calibration_wrong', 0.05]]"
    config = load_config(None, None, [faults, "sim.camera='corners'"])

    async def focal():
        return SimRig(config, TRACK, 0).camera.model.focal

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        assert runner.run(focal()) == pytest.approx((336.0, 336.0, 319.5, 239.5))


def test_gates_are_missing_move_and_change_places():
    faults = read_faults([(0.0, "gate_missing", 1.0), (3.0, "gate_moved", "2:2")])
    (begin, first), (then, second) = rearranged(TRACK, faults)
    assert (begin, then) == (0.0, 3.0)
    assert [gate.id for gate in first.gates] == [2]
    assert second.gates[0].position == pytest.approx((4.0, 1.0, 2.0))
    ((_, swapped),) = rearranged(TRACK, read_faults([(0.0, "gates_swapped", "1:2")]))
    assert [(gate.id, gate.position, gate.yaw_deg, gate.markers) for gate in swapped.gates] == [
        (1, (6.0, 1.0, 2.0), 90.0, (0,)),
        (2, (3.0, 0.0, 1.5), 0.0, (1,)),
    ]


def test_referee_truth_and_camera_follow_a_gate_that_moves():
    now = [0.0]
    world = World(Config(), TRACK, np.random.SeedSequence(0), lambda: now[0])
    (_, _), (stamp, moved) = rearranged(TRACK, read_faults([(1.0, "gate_moved", "1:2")]))
    world.rearrange(stamp, moved)
    world.announce()
    now[0] = 1.0
    world.advance()
    assert world.track is moved
    assert world.truth.gates.latest[0].position == pytest.approx((3.0, 2.0, 1.5))
    path = np.zeros((2, 14))
    path[:, 0], path[:, 1], path[:, 2], path[:, 3], path[:, 4] = (2.0, 2.1), (2.9, 3.1), 2.0, 1.5, 1.0
    assert [passage.gate_id for passage in world.referee.observe(path[:1])] == []
    assert [passage.gate_id for passage in world.referee.observe(path)] == [1]


@pytest.mark.parametrize("camera", ["corners", "rendered"])
def test_both_cameras_see_a_gate_where_it_has_moved_to(camera):
    entries = "[[0.5, 'gate_moved', '1:-0.4']]"
    config = load_config(None, None, [f"sim.faults={entries}", f"sim.camera='{camera}'", "camera.pitch_up_deg=45.0"])

    async def looks():
        rig = SimRig(config, TRACK, 0)
        stood = GroundTruth(0.0, np.array((0.0, 0.0, 1.0)), np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3), np.zeros(3))
        views = []
        async for frame in rig.camera.frames():
            again = rig.camera.expose(frame.stamp, 0, lambda _: (stood.position, stood.orientation))
            views.append(again.image.astype(int) if again.image is not None else again.markers[0].corners)
            if frame.stamp > 0.6:
                return views
        raise AssertionError("the camera ended")

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        views = runner.run(looks())
    still, moved = np.abs(views[4] - views[3]).mean(), np.abs(views[-1] - views[3]).mean()
    assert moved > 2.0 * still


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ((1.0, "pose_silnt", 1.0), "unknown fault 'pose_silnt'; did you mean 'pose_silent'"),
        ((1.0, "silence", 1.0), "--mavlink"),
        ((1.0, "pose_silent", -1.0), "0 s or more"),
        ((1.0, "pose_jump", "far"), "'far' is not a number"),
        ((1.0, "camera_slow", 0.0), "more than 0 Hz"),
        ((1.0, "camera_late", 0.5), "at most 0.4 s"),
        ((1.0, "sightings_wrong", 30.0), "a share is 0 to 1"),
        ((0.0, "calibration_wrong", 5.0), "at most 0.5"),
        ((1.0, "calibration_wrong", 0.05), "from the start"),
        ((1.0, "gate_missing", 1.0), "from the start"),
        ((1.0, "gate_moved", 1.0), "two numbers with a colon"),
    ],
)
def test_what_cannot_be_injected_is_an_error(entry, text):
    with pytest.raises(BadInputError, match=text):
        read_faults([entry])


def test_a_gate_that_is_not_there_cannot_move():
    with pytest.raises(BadInputError, match="the track has no gate 7"):
        rearranged(TRACK, read_faults([(1.0, "gate_moved", "7:1")]))


def test_over_mavlink_the_sensors_have_no_faults():
    with pytest.raises(BadInputError, match="fly without --mavlink"):
        Faults(None, lambda: 0.0).apply("pose_silent", 1.0)
