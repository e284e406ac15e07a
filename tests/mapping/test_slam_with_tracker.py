"""History, estimator and map together, on the drifting tracker of the simulator."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from flightapp.config import Config
from flightapp.estimation.history import PoseHistory
from flightapp.estimation.tracker import TrackerEstimator
from flightapp.frames import (
    Vector,
    quat_conjugate,
    quat_from_rotvec,
    quat_from_yaw,
    quat_multiply,
    quat_rotate,
    quat_rotate_inverse,
)
from flightapp.mapping.slam import SlamMapper
from flightapp.messages import GateSighting, GroundTruth
from flightapp.track import Gate, Start, Track, Uncertainty
from sim.t265 import T265

DT = 0.005
GATES = np.array(
    [
        (-4.0, -8.0, 1.5, 17.0),
        (4.0, -5.0, 2.5, 35.0),
        (9.0, 1.0, 4.5, 100.0),
        (2.0, 6.0, 3.0, 149.0),
        (-6.0, 10.0, 1.5, 190.0),
    ]
)
"""The five gates: position in m, yaw in degrees."""
MOUNT_ERROR = 0.005
"""rad, of the camera against the tracker."""


def surveyed(rng: np.random.Generator) -> Track:
    """The gates as known beforehand: within 3 m across, 0.5 m in height and 10° of yaw."""
    gates = []
    for i, (x, y, z, yaw) in enumerate(GATES):
        radius, angle = 3.0 * math.sqrt(rng.random()), rng.uniform(0.0, 2.0 * math.pi)
        off = (radius * math.cos(angle), radius * math.sin(angle), rng.uniform(-0.5, 0.5))
        gates.append(
            Gate(
                id=i,
                position=(x + off[0], y + off[1], z + off[2]),
                yaw_deg=yaw + rng.uniform(-10.0, 10.0),
                markers=tuple(range(4 * i, 4 * i + 4)),
            )
        )
    start = Start(position=(-12.5, -10.0, 1.0))
    known = Uncertainty(horizontal=3.0, vertical=0.5, yaw_deg=10.0)
    return Track(name="test", start=start, gates=tuple(gates), uncertainty=known)


def flown(speed: float) -> list[GroundTruth]:
    """The truth of a flight through the gates that looks where it flies."""
    points = np.vstack(((-12.5, -10.0, 1.0), GATES[:, :3], (-10.0, 4.0, 1.0)))
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    path = CubicSpline(np.append(0.0, np.cumsum(chords)), points)
    t = np.arange(0.0, chords.sum() / speed + 2.0, DT)
    progress = np.cumsum(np.minimum(np.minimum(t, t[-1] - t), 1.0))
    positions = path(progress / progress[-1] * chords.sum())
    velocities = np.gradient(positions, DT, axis=0)
    return [
        GroundTruth(float(s), p, quat_from_yaw(math.atan2(v[1], v[0])), v, np.zeros(3))
        for s, p, v in zip(t, positions, velocities, strict=True)
    ]


def seen_from(truth: GroundTruth, mount: Vector, rng: np.random.Generator) -> list[GateSighting]:
    """Gates within 8 m in the field of view, with errors that grow with the distance."""
    sightings = []
    for i, (x, y, z, yaw_deg) in enumerate(GATES):
        q_bg = quat_multiply(quat_conjugate(truth.orientation), quat_from_yaw(math.radians(yaw_deg)))
        p_b = quat_rotate_inverse(truth.orientation, np.array((x, y, z)) - truth.position)
        distance = float(np.linalg.norm(p_b))
        in_view = p_b[0] > 0.8 and abs(p_b[1]) < p_b[0] and abs(p_b[2]) < 0.75 * p_b[0]
        faces = quat_rotate(q_bg, np.array((1.0, 0.0, 0.0)))[0] > 0.3
        if distance < 8.0 and in_view and faces:
            sigma, sigma_yaw = 0.01 * distance + 0.003 * distance**2, 0.02 + 0.02 * distance
            position = quat_rotate(mount, p_b) + sigma * rng.standard_normal(3)
            orientation = quat_multiply(q_bg, quat_from_rotvec(sigma_yaw * rng.standard_normal(3)))
            covariance = np.diag([sigma**2] * 3 + [sigma_yaw**2] * 3)
            sightings.append(GateSighting(truth.stamp, i, position, orientation, covariance, None, 4, 0.5))
    return sightings


def gate_errors(speed: float, seed: int) -> Vector:
    """How far each gate is believed to be from where it is, both relative to the vehicle, 1.2 m before it; m."""
    rng = np.random.default_rng(seed)
    mount = quat_from_rotvec(MOUNT_ERROR * rng.standard_normal(3))
    mapper, estimator = SlamMapper(Config(), surveyed(rng), 0.0), TrackerEstimator(Config())
    history, tracker = PoseHistory(), T265(seed)
    latest, errors = mapper.snapshot(0.0), np.full(len(GATES), np.nan)
    for k, truth in enumerate(flown(speed)):
        measured = tracker.sample(truth)
        if measured is None:
            continue
        history.add(measured[0])
        state = estimator.on_pose(measured[0])
        assert state is not None
        pose = history.at(truth.stamp)
        if k % 7 == 0 and pose is not None:
            latest = mapper.update(seen_from(truth, mount, rng), pose)
            estimator.on_drift(latest.drift)
        for i, gate in enumerate(GATES[:, :3]):
            if math.isnan(errors[i]) and math.dist(gate, truth.position) < 1.2:
                believed = latest.gates[i].position - state.position
                errors[i] = np.linalg.norm(believed - (gate - truth.position))
    return errors


@pytest.mark.parametrize(("speed", "seed"), [(1.0, 1), (4.0, 2), (8.0, 3)])
def test_each_gate_is_where_the_vehicle_believes_it_to_be(speed: float, seed: int) -> None:
    """Well inside an opening of 1.4 m less a vehicle of 0.25 m radius, though the tracker drifts by half a metre."""
    assert np.all(gate_errors(speed, seed) < 0.2)
