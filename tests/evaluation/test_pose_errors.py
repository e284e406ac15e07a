"""Pose errors and alignments against evo, and against what is known."""

import math
from dataclasses import asdict

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core import sync, trajectory
from evo.core.units import Unit as EvoUnit
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.evaluation.alignment import Align, AlignmentError, align
from flightapp.evaluation.paths import TimedPath, associate, interpolate
from flightapp.evaluation.pose_errors import Unit, absolute_errors, relative_errors, statistics, steps
from flightapp.evaluation.rotations import angle, conjugate, from_yaw, multiply, rotate

SEEDS = st.integers(0, 2**32 - 1)
NAMES = ("rmse", "mean", "median", "std", "min", "max")
TRANSLATION = evo_metrics.PoseRelation.translation_part
ROTATION = evo_metrics.PoseRelation.rotation_angle_rad


def quaternions(rng, n, spread=1.0):
    q = np.column_stack((np.ones(n), spread * rng.normal(size=(n, 3))))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def pair(seed, n=60):
    """A random walk, and the same seen from another frame, at another scale, with noise."""
    rng = np.random.default_rng(seed)
    stamp = np.cumsum(rng.uniform(0.01, 0.1, n))
    position, q = np.cumsum(rng.normal(size=(n, 3)), axis=0), quaternions(rng, n)
    turn = quaternions(rng, 1)[0]
    moved = 1.1 * rotate(turn, position) + rng.normal(size=3) + 0.1 * rng.normal(size=(n, 3))
    turned = multiply(multiply(turn, q), quaternions(rng, n, 0.05))
    return TimedPath("reference", stamp, position, q), TimedPath("estimate", stamp, moved, turned)


def evo(path):
    return trajectory.PoseTrajectory3D(path.position.copy(), path.orientation.copy(), path.stamp.copy())


def same(ours, theirs):
    for name in NAMES:
        assert getattr(ours, name) == pytest.approx(theirs[name], rel=1e-9, abs=1e-9), name


def evo_ape(reference, estimate, relation):
    metric = evo_metrics.APE(relation)
    metric.process_data((reference, estimate))
    return metric.get_all_statistics()


def evo_aligned(reference, estimate, how):
    reference, estimate = evo(reference), evo(estimate)
    if how is Align.FIRST:
        estimate.align_origin(reference)
    elif how is not Align.NONE:
        estimate.align(reference, correct_scale=how is Align.SIM3)
    return reference, estimate


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from((Align.NONE, Align.FIRST, Align.SE3, Align.SIM3)))
def test_absolute_errors_are_those_of_evo(seed, how):
    reference, estimate = pair(seed)
    theirs = evo_aligned(reference, estimate, how)
    ours = absolute_errors(reference, align(reference, estimate, how).apply(estimate))
    same(ours.translation, evo_ape(*theirs, TRANSLATION))
    same(ours.rotation, evo_ape(*theirs, ROTATION))


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([(1, Unit.FRAMES), (7, Unit.FRAMES), (3.0, Unit.METRES), (20.0, Unit.METRES)]))
def test_relative_errors_are_those_of_evo(seed, step):
    reference, estimate = pair(seed)
    delta, unit = step
    ours = relative_errors(reference, estimate, delta, unit)
    for relation, found in ((TRANSLATION, ours.translation), (ROTATION, ours.rotation)):
        named = EvoUnit.frames if unit is Unit.FRAMES else EvoUnit.meters
        metric = evo_metrics.RPE(relation, delta, named, pairs_from_reference=True)
        metric.process_data((evo(reference), evo(estimate)))
        same(found, metric.get_all_statistics())


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(1, 40), st.integers(1, 40), st.floats(0.0, 0.2))
def test_association_is_that_of_evo(seed, n, m, difference):
    rng = np.random.default_rng(seed)

    def path(name, k):
        return TimedPath(name, np.sort(rng.uniform(0.0, 3.0, k)), rng.normal(size=(k, 3)), quaternions(rng, k))

    reference, estimate = path("reference", n), path("estimate", m)
    ours = associate(reference, estimate, difference)
    try:
        theirs = sync.associate_trajectories(evo(reference), evo(estimate), max_diff=difference)
    except sync.SyncException:
        assert ours[0].stamp.size == ours[1].stamp.size == 0
        return
    for a, b in zip(ours, theirs, strict=True):
        assert np.array_equal(a.stamp, b.timestamps)
        assert np.array_equal(a.position, b.positions_xyz)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.floats(-3.1, 3.1), st.floats(-50.0, 50.0))
def test_yaw_alignment_undoes_a_turn_about_the_vertical_and_is_the_best(seed, yaw, shift):
    reference, _ = pair(seed)
    rng = np.random.default_rng(seed)
    turn = from_yaw(np.array(yaw))
    moved = TimedPath(
        "moved", reference.stamp, rotate(turn, reference.position) + shift, multiply(turn, reference.orientation)
    )
    exact = absolute_errors(reference, align(reference, moved, Align.YAW).apply(moved))
    assert exact.translation.max < 1e-9
    assert exact.rotation.max < 1e-7
    noisy = TimedPath("noisy", moved.stamp, moved.position + rng.normal(size=moved.position.shape))
    found = align(reference, noisy, Align.YAW)
    least = absolute_errors(reference, found.apply(noisy)).translation.rmse
    for change in (-1e-3, 1e-3):
        other = multiply(from_yaw(np.array(change)), found.rotation)
        middle = reference.position.mean(axis=0) - rotate(other, noisy.position.mean(axis=0))
        again = TimedPath("again", noisy.stamp, rotate(other, noisy.position) + middle)
        assert absolute_errors(reference, again).translation.rmse > least
        shifted = found.apply(noisy)
        shifted = TimedPath("shifted", shifted.stamp, shifted.position + np.array((0.0, 0.0, change)))
        assert absolute_errors(reference, shifted).translation.rmse > least


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_the_more_is_forgiven_the_less_is_left(seed):
    reference, estimate = pair(seed)
    left = [
        absolute_errors(reference, align(reference, estimate, how).apply(estimate)).translation.rmse
        for how in (Align.NONE, Align.YAW, Align.SE3, Align.SIM3)
    ]
    assert left == sorted(left, reverse=True)


def test_a_straight_line_does_not_tell_how_it_is_turned():
    line = np.linspace(0.0, 1.0, 9)[:, None] * np.array((1.0, 2.0, 0.5))
    path = TimedPath("line", np.arange(9.0), line)
    for how in (Align.SE3, Align.SIM3):
        with pytest.raises(AlignmentError, match="straight line"):
            align(path, path, how)
    assert absolute_errors(path, align(path, path, Align.YAW).apply(path)).translation.max < 1e-12
    up = TimedPath("up", np.arange(9.0), line * (0.0, 0.0, 1.0))
    with pytest.raises(AlignmentError, match="heading"):
        align(up, up, Align.YAW)
    with pytest.raises(AlignmentError, match="orientations"):
        align(path, path, Align.FIRST)


def test_interpolation_reads_between_poses_and_not_across_gaps():
    yaw = np.array((0.0, 0.4, 1.0, 1.0))
    estimate = TimedPath(
        "e", np.array((0.0, 1.0, 2.0, 9.0)), np.array([[0.0, 0, 0], [2, 0, 0], [2, 4, 0], [9, 9, 9]]), from_yaw(yaw)
    )
    at = np.array((-0.5, 0.25, 1.0, 1.5, 5.0, 9.5))
    reference = TimedPath("r", at, np.zeros((6, 3)), from_yaw(np.zeros(6)))
    a, b = interpolate(reference, estimate, 1.0)
    assert a.stamp.tolist() == b.stamp.tolist() == [0.25, 1.0, 1.5]
    assert np.allclose(b.position, [[0.5, 0, 0], [2, 0, 0], [2, 2, 0]])
    turned = multiply(conjugate(from_yaw(np.array((0.1, 0.4, 0.7)))), b.orientation)
    assert np.allclose(angle(turned), 0.0, atol=1e-9)


def test_steps_by_the_clock_lose_nothing_to_rounding():
    """Ten seconds at 200 Hz with stamps that are rounded: steps of exactly a second."""
    path = TimedPath("p", np.arange(2001) * 0.005, np.zeros((2001, 3)))
    first, last = steps(path, 1.0, Unit.SECONDS)
    assert (last - first).tolist() == [200] * 10
    with pytest.raises(ValueError, match="is none"):
        steps(path, 0.5, Unit.FRAMES)
    with pytest.raises(ValueError, match="orientations"):
        relative_errors(path, path, 1.0, Unit.SECONDS)


def test_statistics_by_hand():
    found = statistics(np.array((3.0, 1.0, 2.0, 2.0)))
    expected = {"rmse": math.sqrt(4.5), "mean": 2.0, "median": 2.0, "std": math.sqrt(0.5), "min": 1.0, "max": 3.0}
    assert asdict(found) == pytest.approx({**expected, "count": 4})
    assert statistics(np.zeros(0)) is None
