"""Tracks, cameras and exact sightings that the perception tests share."""

from flightapp.config import Camera, Config, Detection
from flightapp.frames import Vector, quat_to_matrix
from flightapp.messages import MarkerDetection
from flightapp.perception.camera import CameraModel
from flightapp.track import Gate, GateShape, MarkerLayout, Start, Track

PINHOLE = Camera(distortion=(-0.25, 0.06, 0.001, -0.0005)).model()
WIDE = Camera(
    lens="fisheye", width=848, height=800, focal=(286.0, 286.0, 424.0, 400.0), distortion=(-0.008, 0.04, -0.037, 0.006)
).model()
"""About what a T265 has: 163° of view."""
LENSES = {"pinhole": PINHOLE, "fisheye": WIDE}


def config(**detection: float) -> Config:
    return Config(detection=Detection(**detection))


def track(gates: int = 1, layout: MarkerLayout = MarkerLayout.CORNERS, dictionary: str = "4X4_50") -> Track:
    shape = GateShape(layout=layout, dictionary=dictionary)
    k = shape.marker_count
    return Track(
        name="test",
        start=Start(position=(0.0, 0.0, 1.0)),
        gate=shape,
        gates=tuple(
            Gate(id=10 + n, position=(5.0 * n, 0.0, 2.0), yaw_deg=0.0, markers=tuple(range(k * n, k * n + k)))
            for n in range(gates)
        ),
    )


def gate_pixels(camera: CameraModel, shape: GateShape, position: Vector, orientation: Vector) -> Vector:
    """(k, 4, 2) exact pixels of a gate's markers; the gate's pose is relative to the body."""
    points = shape.marker_corners().reshape(-1, 3) @ quat_to_matrix(orientation).T + position
    return camera.project((points - camera.p_bc) @ camera.R_bc).reshape(-1, 4, 2)


def as_markers(pixels: Vector) -> list[MarkerDetection]:
    return [MarkerDetection(n, corners) for n, corners in enumerate(pixels)]
