"""A small square leaves two poses: which one is right, the map tells."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_world import GATES, Circling, a_track

from flightapp.config import Config
from flightapp.estimation.fusion import FusionEstimator
from flightapp.frames import quat_from_yaw, quat_multiply
from flightapp.messages import Sightings


def seen_twofold(world, stamp, turned, wrong_first):
    """Gate 1 with its right pose and one that is ``turned`` about the vertical (rad)."""
    right = world.sighting(1, stamp)
    wrong = right.position, quat_multiply(right.orientation, quat_from_yaw(turned))
    if not wrong_first:
        return replace(right, alternative=wrong)
    return replace(right, orientation=wrong[1], alternative=(right.position, right.orientation))


@pytest.mark.parametrize("turned", [-0.8, 0.8])
@pytest.mark.parametrize("wrong_first", [False, True])
def test_the_pose_that_fits_the_map_is_used(turned: float, wrong_first: bool) -> None:
    world = Circling(Config(), 5)
    estimator = FusionEstimator(Config(), a_track({1: np.array((0.8, -0.6, 0.2))}))
    for count in range(500):
        pose, felt = world.advance()
        estimator.on_imu(felt)
        estimator.on_pose(pose)
        if count % 6 == 0 and count > 12:
            seen = seen_twofold(world, world.stamp - 0.03, turned, wrong_first)
            estimator.on_sightings(Sightings(seen.stamp, count, (), (seen,)))
    (gate,) = (gate for gate in estimator.gate_map(world.stamp).gates if gate.gate_id == 1)
    x, y, z, yaw = GATES[1]
    assert gate.sightings > 50
    assert np.linalg.norm(gate.position - (x, y, z)) < 0.3
    assert abs(gate.yaw - yaw) < 0.1
