"""Where in the image to look for the markers of the gates that the map knows."""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flightapp.config import Detection
from flightapp.frames import Vector, quat_to_matrix
from flightapp.jit import kernel
from flightapp.messages import GateEstimate
from flightapp.perception.boxes import merge_regions
from flightapp.perception.camera import CameraModel
from flightapp.track import GateShape

SIGMAS = 3.0
"""How far, in standard deviations, a gate may be from where the map has it."""

NEAREST = 0.05
"""m in front of the camera, from where a pinhole sees."""


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
    boxes = _boxes(gates, position, quat_to_matrix(orientation), camera, _markers(shape), detection) if gates else []
    merged = merge_regions(boxes, camera.width, camera.height)
    searched = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in merged)
    if searched > detection.region_coverage * camera.width * camera.height:
        return None
    return boxes


@cache
def _markers(shape: GateShape) -> Vector:
    return shape.marker_corners()


def _boxes(
    gates: Sequence[GateEstimate],
    position: Vector,
    R_wb: Vector,
    camera: CameraModel,
    markers: Vector,
    detection: Detection,
) -> list[Vector]:
    """Boxes (4,) of the ``markers`` (k, 4, 3) that may be seen; they may reach out of the image."""
    points = np.empty((len(gates) * len(markers), 8 * markers.shape[1], 3))
    whole = np.empty(len(points), np.bool_)
    R_wc, p_wc = R_wb @ camera.R_bc, position + R_wb @ camera.p_bc
    count = _surround(_known(gates), markers, R_wc, p_wc, camera.fisheye, detection.max_distance, points, whole)
    pixels = camera.project(points[:count].reshape(-1, 3)).reshape(count, points.shape[1], 2)
    low = pixels.min(axis=1) - detection.region_margin
    high = pixels.max(axis=1) + detection.region_margin
    size = np.array((camera.width, camera.height))
    seen = whole[:count] | ~((high < 0.0) | (low >= size)).any(axis=1)
    found = np.concatenate((low, high), axis=1)
    found[whole[:count]] = (0.0, 0.0, camera.width, camera.height)
    return list(found[seen])


def _known(gates: Sequence[GateEstimate]) -> Vector:
    """(n, 6): position, yaw, and by how much the position (m) and the yaw (rad) may be off."""
    rows = np.empty((len(gates), 6))
    covariances = np.array([gate.covariance for gate in gates])
    for row, gate in zip(rows, gates, strict=True):
        row[0:3] = gate.position
        row[3] = gate.yaw
    rows[:, 4] = SIGMAS * np.sqrt(np.maximum(np.linalg.eigvalsh(covariances[:, :3, :3])[:, -1], 0.0))
    rows[:, 5] = np.minimum(SIGMAS * np.sqrt(np.maximum(covariances[:, 3, 3], 0.0)), np.pi)
    return rows


@kernel
def _surround(
    gates: Vector,
    markers: Vector,
    R_wc: Vector,
    p_wc: Vector,
    fisheye: bool,
    max_distance: float,
    points: Vector,
    whole: NDArray[np.bool_],
) -> int:
    """Points around every marker (k, 4, 3) of ``gates`` (n, 6) that may be seen; how many markers that are.

    ``points`` (n k, 32, 3), in the camera frame, become the corners of the cubes in which a marker's corners may
    be; ``whole`` (n k,) tells which markers may be about the camera, so anywhere in the image.
    """
    count = 0
    for g in range(gates.shape[0]):
        x, y, z, yaw, reach, swing = gates[g]
        c, s = math.cos(yaw), math.sin(yaw)
        dx, dy, dz = p_wc[0] - x, p_wc[1] - y, p_wc[2] - z
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        passed = c * dx + s * dy > reach + swing * distance
        if passed or distance > max_distance + reach:
            continue
        for marker in markers:
            slack = reach + swing * np.abs(marker[:, 1]).max()
            nearest, least = math.inf, math.inf
            for i in range(marker.shape[0]):
                u, v, w = marker[i]
                rx, ry, rz = c * u - s * v - dx, s * u + c * v - dy, w - dz
                nearest = min(nearest, rx * rx + ry * ry + rz * rz)
                for k in range(8):
                    for axis in range(3):
                        along = rx * R_wc[0, axis] + ry * R_wc[1, axis] + rz * R_wc[2, axis]
                        points[count, 8 * i + k, axis] = along + (slack if k >> (2 - axis) & 1 else -slack)
                least = min(least, points[count, 8 * i + 7, 2])
            whole[count] = slack > 0.0 and nearest < 3.0 * slack * slack
            if not fisheye:
                if not whole[count] and least < NEAREST:
                    continue
                # What might be nearer than a pinhole sees appears far outside the image, on the side where it is.
                for i in range(points.shape[1]):
                    points[count, i, 2] = max(points[count, i, 2], NEAREST)
            count += 1
    return count
