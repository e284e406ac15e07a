"""The camera's place in the body from synthetic recordings whose truth is known."""

import math

import numpy as np
import pytest
from board_images import BOARD
from scipy.spatial.transform import Rotation

from flightapp.calibration.body_poses import BodyPoses
from flightapp.calibration.mount import Sight, find_mount
from flightapp.frames import camera_mount
from flightapp.inputs import BadInputError
from flightapp.perception.camera import CameraModel, Lens

PLACE = np.array((0.09, -0.02, 0.035))
TOLD = camera_mount(math.radians(15.0)), np.array((0.05, 0.0, 0.0))
BOARD_POINTS = BOARD.corners * 6.0


def lens(kind):
    if kind is Lens.FISHEYE:
        return Lens.FISHEYE, 640, 480, np.array((230.0, 231.0, 322.0, 238.0)), np.array((0.01, -0.005, 0.0, 0.0))
    return Lens.PINHOLE, 640, 480, np.array((420.0, 421.0, 318.0, 242.0)), np.array((-0.2, 0.04, 0.0, 0.0))


def recording(rng, kind=Lens.PINHOLE, axes=(1.0, 1.0, 1.0), late=0.0, noise=(0.2, 0.001, 0.001), seconds=24.0):
    """A camera that is told to be elsewhere, sights of the board from it, and the body's poses, 2.5 m in front."""
    R_bc = camera_mount(math.radians(20.0), math.radians(2.0), math.radians(-3.0))
    true = CameraModel(*lens(kind), R_bc, PLACE)
    told = CameraModel(*lens(kind), *TOLD)
    phases, speeds = rng.uniform(0.0, 6.0, 6), rng.uniform(0.8, 2.0, 6)

    def body(t):
        wave = np.sin(speeds * np.asarray(t)[:, None] + phases)
        turns = wave[:, :3] * (0.35, 0.25, 0.3) * np.array(axes)
        return Rotation.from_euler("xyz", turns), wave[:, 3:] * (0.4, 0.5, 0.3) + (0.0, 0.0, 1.4)

    stamps = np.arange(0.0, seconds, 0.005)
    R, p = body(stamps)
    turned = Rotation.from_rotvec(noise[2] * rng.standard_normal((len(stamps), 3)))
    poses = BodyPoses(stamps, p + noise[1] * rng.standard_normal(p.shape), (R * turned).as_quat(scalar_first=True))
    facing = np.array(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
    target = BOARD_POINTS @ facing.T + (2.5, 0.8, 2.3)
    sights = []
    for stamp in np.arange(0.5, seconds - 0.5, 0.3):
        R, p = body([stamp])
        in_camera = (R[0].inv().apply(target - p[0]) - true.p_bc) @ true.R_bc
        pixels = true.project(in_camera)
        seen = true.contains(np.nan_to_num(pixels, nan=-1.0)) & (in_camera[:, 2] > 0.1)
        if seen.sum() >= 8:
            measured = pixels[seen] + noise[0] * rng.standard_normal((int(seen.sum()), 2))
            sights.append(Sight(stamp + late, BOARD_POINTS[seen], measured))
    return true, told, sights, poses


def errors(found, true):
    """Of rotation (rad, about the body's axes) and position."""
    return Rotation.from_matrix(found.R_bc @ true.R_bc.T).as_rotvec(), found.p_bc - true.p_bc


@pytest.mark.parametrize(("kind", "late"), [(Lens.PINHOLE, 0.0), (Lens.FISHEYE, 0.012)])
def test_mount_and_lateness_are_found(kind, late):
    true, told, sights, poses = recording(np.random.default_rng(1), kind, late=late)
    found = find_mount(told, sights, poses)
    turn, shift = errors(found, true)
    assert found.shortfalls == ()
    assert np.linalg.norm(turn) < math.radians(0.1)
    assert np.linalg.norm(shift) < 0.004
    assert abs(found.late - late) < 0.0015
    assert found.late_deviation < 0.001


def test_standard_deviations_are_what_the_errors_are():
    scores = []
    for seed in range(3):
        true, told, sights, poses = recording(np.random.default_rng(20 + seed), seconds=12.0)
        found = find_mount(told, sights, poses)
        turn, shift = errors(found, true)
        scores += [*(turn / found.rotation_deviation), *(shift / found.position_deviation)]
        scores.append(found.late / found.late_deviation)
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 2.0


@pytest.mark.parametrize("axes", [(0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_too_poor_a_motion_is_said(axes):
    _, told, sights, poses = recording(np.random.default_rng(2), axes=axes)
    found = find_mount(told, sights, poses)
    assert any("turn it about two axes" in text for text in found.shortfalls)


def test_wrong_sights_do_not_matter():
    rng = np.random.default_rng(3)
    true, told, sights, poses = recording(rng)
    for sight in sights[::15]:
        sight.pixels[:] += rng.normal(0.0, 30.0, 2)
    turn, shift = errors(find_mount(told, sights, poses), true)
    assert np.linalg.norm(turn) < math.radians(0.3)
    assert np.linalg.norm(shift) < 0.012


def test_a_target_that_moved_or_another_clock_is_noticed():
    _, told, sights, poses = recording(np.random.default_rng(4))
    moved = [Sight(s.stamp, s.points, s.pixels + (60.0 if s.stamp > 12.0 else 0.0)) for s in sights]
    assert any("the target moved" in text for text in find_mount(told, moved, poses).shortfalls)
    other = [Sight(s.stamp + 1000.0, s.points, s.pixels) for s in sights]
    with pytest.raises(BadInputError, match="by the same clock"):
        find_mount(told, other, poses)
    with pytest.raises(BadInputError, match="at least 10"):
        find_mount(told, sights[:4], poses)
