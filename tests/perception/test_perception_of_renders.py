"""From the simulator's rendered images to gate poses: the whole of perception, judged by the truth."""

import numpy as np
import pytest

from flightapp.config import Config
from flightapp.frames import (
    Vector,
    quat_from_euler,
    quat_from_yaw,
    quat_multiply,
    quat_rotate_inverse,
    quat_to_rotvec,
)
from flightapp.messages import Frame, GateEstimate
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.gate_pose import GatePoseSolver
from flightapp.perception.regions import expected_regions
from flightapp.track import Gate, Start, Track
from sim.render import Renderer
from sim.scene import Scene

GATE = Gate(id=7, position=(0.0, 0.0, 2.0), yaw_deg=0.0, markers=(4, 5, 6, 7))
TRACK = Track(name="one", start=Start(position=(-5.0, 0.0, 0.0)), gates=(GATE,))
KNOWN = GateEstimate(7, np.array(GATE.position), 0.0, np.diag([0.02, 0.02, 0.02, 0.001]), 3, 0.0)


def pose(rng: np.random.Generator, distance: float) -> tuple[Vector, Vector]:
    position = np.array([-distance, rng.uniform(-0.3, 0.3) * distance, 2.0 + rng.uniform(-0.1, 0.1) * distance])
    heading = float(np.arctan2(-position[1], distance))
    return position, quat_from_euler(rng.uniform(-0.3, 0.3), rng.uniform(-0.1, 0.3), heading + rng.uniform(-0.1, 0.1))


def _error(candidate: tuple[Vector, Vector], position: Vector, orientation: Vector) -> Vector:
    """(6,) error of a gate's pose in the body, in the axes of a sighting's covariance."""
    true_position = quat_rotate_inverse(orientation, np.array(GATE.position) - position)
    return np.concatenate((candidate[0] - true_position, quat_to_rotvec(quat_multiply(orientation, candidate[1]))))


@pytest.mark.parametrize("turning", [0.0, 2.0])
def test_rendered_gates_are_sighted_within_their_covariance(turning: float) -> None:
    """At 2.5 to 8 m, still and turning at 2 rad/s: one of the candidates is as good as its covariance."""
    config = Config()
    camera = config.camera.model()
    renderer = Renderer(Scene.from_track(TRACK, 4), camera, config.camera.exposure, 5)
    detector, solver = ArucoDetector(config, TRACK), GatePoseSolver(config, TRACK, camera)
    rng = np.random.default_rng(2)
    normalised, reprojections, counts = [], [], []
    for distance in np.linspace(2.5, 8.0, 12):
        position, orientation = pose(rng, distance)

        def pose_at(stamp: float, position: Vector = position, level: Vector = orientation) -> tuple[Vector, Vector]:
            return position, quat_multiply(quat_from_yaw(turning * stamp), level)

        frame = Frame(0.0, 0, renderer.render(0.0, pose_at))
        boxes = expected_regions([KNOWN], position, orientation, camera, TRACK.gate, config.detection)
        (sighting,) = solver.solve(0.0, detector.detect(frame, boxes))
        candidates = [(sighting.position, sighting.orientation)]
        candidates += [sighting.alternative] if sighting.alternative else []
        weight = np.linalg.inv(sighting.covariance)
        errors = [_error(candidate, position, orientation) for candidate in candidates]
        normalised.append(min(error @ weight @ error for error in errors))
        reprojections.append(sighting.reprojection)
        counts.append(sighting.markers)
    assert np.mean(normalised) < 6.0
    assert np.median(reprojections) < 0.3
    assert np.mean(counts) > 3.5
