"""Where in the image to look for the markers of the gates that the map knows."""

from collections.abc import Sequence

import numpy as np

from flightapp.config import Detection
from flightapp.frames import Vector, quat_from_yaw, quat_to_matrix
from flightapp.messages import GateEstimate
from flightapp.perception.camera import CameraModel
from flightapp.track import GateShape

SIGMAS = 3.0
"""How far, in standard deviations, a gate may be from where the map has it."""

NEAREST = 0.05
"""m in front of the camera, from where a pinhole sees."""

COST_OF_A_BOX = 6000
"""px that could be searched in the time that it takes to begin another box."""

CUBE: Vector = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])

Box = tuple[int, int, int, int]


def expected_regions(
    gates: Sequence[GateEstimate],
    position: Vector,
    orientation: Vector,
    camera: CameraModel,
    shape: GateShape,
    detection: Detection,
) -> list[Vector] | None:
    """Boxes (4,) x0, y0, x1, y1 in pixels, in which the markers of ``gates`` should be seen.

    ``position`` (3,) and ``orientation`` (4,) q_wb are the body's pose in the world at the exposure. A box holds
    one marker, moved by up to three sigma of the gate's position and yaw, and ``detection.region_margin`` around
    it. Gates out of reach, behind the camera or seen from behind are left out: where none is expected in the
    image the list is empty. None, for the whole image, where the boxes would cover more of it than
    ``detection.region_coverage``.
    """
    R_wc = quat_to_matrix(orientation) @ camera.R_bc
    p_wc = position + quat_to_matrix(orientation) @ camera.p_bc
    markers = shape.marker_corners()
    boxes: list[Vector] = []
    for gate in gates:
        reach = SIGMAS * float(np.sqrt(max(np.linalg.eigvalsh(gate.covariance[:3, :3])[-1], 0.0)))
        swing = min(SIGMAS * float(np.sqrt(max(gate.covariance[3, 3], 0.0))), np.pi)
        R_wg = quat_to_matrix(quat_from_yaw(gate.yaw))
        from_gate = R_wg.T @ (p_wc - gate.position)
        distance = float(np.linalg.norm(from_gate))
        passed = from_gate[0] > reach + swing * distance
        if passed or distance > detection.max_distance + reach:
            continue
        for corners in markers:
            slack = reach + swing * float(np.abs(corners[:, 1]).max())
            in_camera = (corners @ R_wg.T + gate.position - p_wc) @ R_wc
            box = _box(in_camera, slack, camera, detection.region_margin)
            if box is not None:
                boxes.append(box)
    merged = merge_regions(boxes, camera.width, camera.height)
    searched = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in merged)
    if searched > detection.region_coverage * camera.width * camera.height:
        return None
    return [np.array(box, float) for box in merged]


def _box(corners: Vector, slack: float, camera: CameraModel, margin: float) -> Vector | None:
    """Box (4,) around ``corners`` (n, 3) in the camera frame that may be off by ``slack`` m; None if unseen."""
    if slack > 0.0 and np.linalg.norm(corners, axis=1).min() < np.sqrt(3.0) * slack:
        return np.array([0.0, 0.0, camera.width, camera.height])
    points = (corners[:, None] + slack * CUBE).reshape(-1, 3)
    if not camera.fisheye:
        # What might be nearer than a pinhole sees appears far outside the image, on the side where it is.
        if points[:, 2].reshape(len(corners), -1).max(axis=1).min() < NEAREST:
            return None
        points[:, 2] = np.maximum(points[:, 2], NEAREST)
    pixels = camera.project(points)
    x0, y0 = pixels.min(axis=0) - margin
    x1, y1 = pixels.max(axis=0) + margin
    if x1 < 0.0 or y1 < 0.0 or x0 >= camera.width or y0 >= camera.height:
        return None
    return np.array([x0, y0, x1, y1])


def merge_regions(regions: Sequence[Vector], width: int, height: int) -> list[Box]:
    """Whole-pixel boxes inside an image that cover ``regions``, with no pixel searched twice.

    Boxes are merged where they overlap, and where one search of both costs less than two. Boxes that are empty,
    outside the image or not finite are left out.
    """
    boxes: list[Box] = []
    for region in regions:
        if not np.isfinite(region).all():
            continue
        x0, y0 = max(int(np.floor(region[0])), 0), max(int(np.floor(region[1])), 0)
        x1, y1 = min(int(np.ceil(region[2])), width), min(int(np.ceil(region[3])), height)
        if x1 <= x0 or y1 <= y0:
            continue
        box = (x0, y0, x1, y1)
        while (partner := next((other for other in boxes if _better_together(box, other)), None)) is not None:
            boxes.remove(partner)
            box = _union(box, partner)
        boxes.append(box)
    return boxes


def _union(a: Box, b: Box) -> Box:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def _area(box: Box) -> int:
    return (box[2] - box[0]) * (box[3] - box[1])


def _better_together(a: Box, b: Box) -> bool:
    overlap = a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
    return overlap or _area(_union(a, b)) <= _area(a) + _area(b) + COST_OF_A_BOX
