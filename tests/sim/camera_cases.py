"""Tracks, cameras and motions for the tests of the simulated cameras."""

import numpy as np

from flightapp.config import Camera
from flightapp.frames import Vector, quat_from_euler, quat_from_rotvec, quat_multiply
from flightapp.perception.camera import CameraModel, Lens
from flightapp.track import Box, Cylinder, Gate, Start, Track
from sim.render import PoseAt, camera_poses
from sim.scene import Scene

PINHOLE = Camera().model()
FISHEYE = Camera(
    lens=Lens.FISHEYE,
    width=848,
    height=800,
    focal=(286.0, 286.0, 424.0, 400.0),
    distortion=(-0.0055, 0.045, -0.042, 0.0075),
).model()
LEVEL = quat_from_euler(0.0, np.radians(10.0), 0.0)
"""The camera, which is tilted up by 10°, looks at the horizon."""


def one_gate(position: tuple[float, float, float] = (4.0, 0.0, 1.5), yaw_deg: float = 0.0) -> Track:
    return make_track(Gate(id=0, position=position, yaw_deg=yaw_deg, markers=(0, 1, 2, 3)))


def make_track(*gates: Gate, obstacles: tuple[Box | Cylinder, ...] = ()) -> Track:
    return Track(name="test", start=Start(position=(0.0, 0.0, 1.0)), gates=gates, obstacles=obstacles)


def moving(
    position: tuple[float, float, float],
    orientation: Vector = LEVEL,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> PoseAt:
    p, v, w = (np.array(item, float) for item in (position, velocity, rates))
    return lambda stamp: (p + v * stamp, quat_multiply(orientation, quat_from_rotvec(w * stamp)))


def projected(scene: Scene, camera: CameraModel, pose_at: PoseAt) -> Vector:
    """(m, 4, 2) px: where the corners of the scene's markers are at stamp zero."""
    R_wc, centres = camera_poses(camera, pose_at, np.zeros(1))
    return camera.project((scene.boards.corners.reshape(-1, 3) - centres[0]) @ R_wc[0]).reshape(-1, 4, 2)
