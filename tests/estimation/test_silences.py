"""Silences of the tracker, of the inertial sensors and of the whole process, in the midst of a race."""

import numpy as np
import pytest
from fusion_world import a_track
from racing_world import Racing
from scipy.stats import chi2

from flightapp.config import Config
from flightapp.estimation.fusion import FusionEstimator
from flightapp.estimation.imu import ImuMemory
from flightapp.messages import ImuSample

BEGIN = 3.0
"""s, at which the silence begins."""
PUSH = np.array((8.0, 0.0, 0.0))
"""m/s² that an accelerometer shows too much."""
WAITING = 4
"""Inertial samples that are kept for a process that does not listen, as the autopilot's link does."""


class Watched:
    """An estimator, and how far off each of its states is."""

    def __init__(self, seed):
        self.world = Racing(seed, 0.7 * seed)
        self.estimator = FusionEstimator(Config(), a_track())
        self.states = []

    def take(self, pose=None, felt=None):
        """Hand over what was measured."""
        state = None
        if felt is not None:
            state = self.estimator.on_imu(felt)
        if pose is not None:
            state = self.estimator.on_pose(pose) or state
        if state is not None:
            self.states.append(state)

    def fly(self, until):
        """With all sensors up to that stamp."""
        while self.world.stamp < until - 1e-9:
            pose, felt = self.world.advance()
            self.take(pose, felt)

    def nees(self, state):
        """Of position and velocity."""
        p, v, *_ = self.world.motion(state.stamp)
        e = np.concatenate((state.position - p, state.velocity - v))
        return float(e @ np.linalg.solve(state.covariance[:6, :6], e))


def stalled(seed, seconds, inertial_first, all_poses):
    """A process that does not listen for ``seconds``: then what was kept comes all at once, in either order."""
    watched = Watched(seed)
    watched.fly(BEGIN)
    missed = [watched.world.advance() for _ in range(round(200 * seconds))]
    poses = [{"pose": pose} for pose, _ in missed if pose is not None]
    poses, felt = poses if all_poses else poses[-1:], [{"felt": felt} for _, felt in missed[-WAITING:]]
    watched.states.clear()
    for given in felt + poses if inertial_first else poses + felt:
        watched.take(**given)
    watched.fly(watched.world.stamp + 0.3)
    return watched


@pytest.mark.parametrize("seconds", [0.2, 0.5, 0.7])
@pytest.mark.parametrize("inertial_first", [True, False], ids=["inertial first", "poses first"])
@pytest.mark.parametrize("all_poses", [True, False], ids=["all poses", "newest pose"])
def test_after_a_stall_the_poses_are_believed(seconds, inertial_first, all_poses):
    """What was felt just before its end tells nothing of the rest of it."""
    runs = [stalled(seed, seconds, inertial_first, all_poses) for seed in range(4)]
    assert all(state.doubt == "" for run in runs for state in run.states)
    for which in (5, -1):
        assert np.mean([run.nees(run.states[which]) for run in runs]) < chi2.ppf(0.995, 6 * len(runs)) / len(runs)
    assert all(np.sqrt(run.states[-1].covariance[range(3, 6), range(3, 6)]).max() < 0.3 for run in runs)


@pytest.mark.parametrize("seconds", [0.2, 0.5])
def test_a_silent_tracker_is_stood_in_for_and_then_believed(seconds):
    runs, coasting, back = [Watched(seed) for seed in range(6)], [], []
    for run in runs:
        run.fly(BEGIN)
        run.states.clear()
        while run.world.stamp < BEGIN + seconds - 1e-9:
            run.take(felt=run.world.advance()[1])
        assert len(run.states) > 200 * (seconds - 0.03)
        coasting.append(run.nees(run.states[-1]))
        run.fly(run.world.stamp + 0.05)
        back.append(run.nees(run.states[-1]))
        assert all(state.doubt == "" for state in run.states)
    for nees in (coasting, back):
        assert np.mean(nees) < chi2.ppf(0.995, 6 * len(runs)) / len(runs)


def test_what_was_felt_wrongly_in_a_silence_counts_as_nothing_when_poses_are_back():
    """The vehicle was elsewhere, and not where the pose is wrong."""
    run = Watched(2)
    run.fly(BEGIN)
    while run.world.stamp < BEGIN + 0.3 - 1e-9:
        felt = run.world.advance()[1]
        run.take(felt=ImuSample(felt.stamp, felt.specific_force + PUSH, felt.angular_velocity))
    off = run.states[-1].velocity - run.world.motion(run.world.stamp)[1]
    assert np.linalg.norm(off) > 2.0
    run.states.clear()
    run.fly(run.world.stamp + 0.1)
    assert all(state.doubt == "" for state in run.states)
    error = run.states[-1].position - run.world.motion(run.world.stamp)[0]
    off = run.states[-1].velocity - run.world.motion(run.world.stamp)[1]
    assert (abs(off) < 4.0 * np.sqrt(run.states[-1].covariance[range(3, 6), range(3, 6)])).all()
    assert (abs(error) < 4.0 * np.sqrt(run.states[-1].covariance[range(3), range(3)])).all()


def test_while_nothing_is_felt_inertial_sensors_do_not_stand_in():
    run = Watched(2)
    run.fly(BEGIN)
    missed = [run.world.advance() for _ in range(40)]
    run.states.clear()
    for _, felt in missed[-WAITING:]:
        run.take(felt=felt)
    assert run.states == []


@pytest.mark.parametrize("gap", [0.05, 0.15, 0.4, 1.0])
def test_the_share_that_was_felt_reckons_with_every_hole(gap):
    """Also with one that is longer than what is remembered."""
    memory, one = ImuMemory(), np.ones(3)
    for stamp in (0.0, 0.005, 0.01, 0.01 + gap, 0.015 + gap):
        assert memory.add(ImuSample(stamp, one, one))
    felt = memory.felt(0.01, 0.015 + gap)
    assert felt is not None
    assert felt[1] == pytest.approx(0.017 / (gap + 0.005), abs=0.01)
