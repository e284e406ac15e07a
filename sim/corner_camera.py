"""The corner-level camera: what camera and detector would have found, without the image.

Marker corners are projected exactly; what hides them is found by rays. Whether a marker is found, and how far off
its corners are, follows `detector_model`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.messages import MarkerDetection
from flightapp.perception.camera import CameraModel
from sim.detector_model import WRONG, bowed_corners, chance_found, corner_scatter, marker_look, noise_told
from sim.render import PoseAt, camera_poses, ray_grid
from sim.scene import Quads, Scene

BORDER = 2.0
"""px, a marker nearer to the image's border is not found."""
QUIET = 1.15
"""A marker is hidden as soon as something covers a part of it magnified by this: its quiet zone counts."""
POINTS = 8


@kernel
def _hidden(quads: Quads, own: int, eye: Vector, px: float, py: float, pz: float) -> bool:
    """Whether a quad other than ``own`` stands between ``eye`` and a point."""
    for q in range(quads.origin.shape[0]):
        if q == own:
            continue
        a0, a1, a2 = quads.along[q, 0], quads.along[q, 1], quads.along[q, 2]
        b0, b1, b2 = quads.up[q, 0], quads.up[q, 1], quads.up[q, 2]
        n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        e0, e1, e2 = eye[0] - quads.origin[q, 0], eye[1] - quads.origin[q, 1], eye[2] - quads.origin[q, 2]
        d0, d1, d2 = px - eye[0], py - eye[1], pz - eye[2]
        here = e0 * n0 + e1 * n1 + e2 * n2
        step = d0 * n0 + d1 * n1 + d2 * n2
        if here * (here + step) >= 0.0:
            continue
        f = -here / step
        s = (e0 + f * d0) * a0 + (e1 + f * d1) * a1 + (e2 + f * d2) * a2
        t = (e0 + f * d0) * b0 + (e1 + f * d1) * b1 + (e2 + f * d2) * b2
        if s < quads.bounds[q, 0] or s > quads.bounds[q, 1] or t < quads.bounds[q, 2] or t > quads.bounds[q, 3]:
            continue
        if s <= quads.hole[q, 0] or s >= quads.hole[q, 1] or t <= quads.hole[q, 2] or t >= quads.hole[q, 3]:
            return True
    return False


@kernel
def _to_camera(points: Vector, R_wc: Vector, centres: Vector) -> Vector:
    """``points`` (n, 3) m, world, in the camera frame of each pose: (poses · n, 3)."""
    n = points.shape[0]
    out = np.empty((R_wc.shape[0] * n, 3))
    for k in range(R_wc.shape[0]):
        for i in range(n):
            for j in range(3):
                out[k * n + i, j] = 0.0
                for axis in range(3):
                    out[k * n + i, j] += (points[i, axis] - centres[k, axis]) * R_wc[k, axis, j]
    return out


@kernel
def _in_view(points: Vector, pixels: Vector, quads: Quads, own: int, eye: Vector, width: int, height: int) -> bool:
    """Whether all points (9, 3) of a marker can be seen, whose corners and sides have ``pixels`` (8, 2)."""
    for i in range(POINTS):
        u, v = pixels[i, 0], pixels[i, 1]
        if not (BORDER <= u <= width - 1 - BORDER and BORDER <= v <= height - 1 - BORDER):
            return False
    hidden = False
    for i in range(points.shape[0]):
        hidden = hidden or _hidden(quads, own, eye, points[i, 0], points[i, 1], points[i, 2])
    return not hidden


@kernel
def _observe(
    pixels: Vector,
    rays: Vector,
    least_cos: float,
    margins: Vector,
    owners: NDArray[np.int64],
    quads: Quads,
    eye: Vector,
    width: int,
    height: int,
    cells: int,
    chance: Vector,
    scatter: Vector,
    out: Vector,
    noise: Vector,
) -> NDArray[np.bool_]:
    """Which markers are found, (m,); their corners go to ``out`` (m, 4, 2), what noise they are told with to ``noise``.

    ``pixels`` (3, m, 8, 2) and ``rays`` (m, 8, 3) m, camera frame, of corners and middles of sides at the start,
    middle and end of the exposure, and in its middle; ``margins`` (m, 9, 3) m, world, the points that must not be
    hidden; ``cells`` a marker's cells a side; ``chance`` (m, 5) in 0..1; ``scatter`` (m, 4, 2) standard normal.
    """
    found = np.zeros(len(owners), np.bool_)
    for m in range(len(owners)):
        q = owners[m]
        facing = 0.0
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            normal = quads.along[q, a] * quads.up[q, b] - quads.along[q, b] * quads.up[q, a]
            facing += (eye[j] - quads.origin[q, j]) * normal
        if facing >= 0.0:
            continue
        inside = True
        for i in range(POINTS):
            x, y, z = rays[m, i, 0], rays[m, i, 1], rays[m, i, 2]
            inside = inside and z > least_cos * math.sqrt(x * x + y * y + z * z)
        if not inside:
            continue
        look = marker_look(pixels[0, m], pixels[1, m], pixels[2, m], cells)
        if chance[m, 4] >= chance_found(look, cells):
            continue
        if not _in_view(margins[m], pixels[1, m], quads, q, eye, width, height):
            continue
        found[m] = True
        bowed_corners(pixels[1, m], out[m])
        noise[m] = noise_told(look, cells)
        good, wrong = corner_scatter(look, cells)
        for i in range(4):
            sigma = wrong if chance[m, i] < WRONG else good
            out[m, i, 0] += sigma * scatter[m, i, 0]
            out[m, i, 1] += sigma * scatter[m, i, 1]
    return found


class CornerCamera:
    """A camera that finds the markers itself."""

    def __init__(self, scene: Scene, camera: CameraModel, exposure: float, seed: int) -> None:
        self._camera = camera
        self._exposure = exposure
        self._rng = np.random.default_rng(seed)
        rays = ray_grid(camera, 64, 64).reshape(-1, 3)
        self._least_cos = float(rays[rays.any(axis=1), 2].min()) - 0.05
        self.look_at(scene)

    def look_at(self, scene: Scene) -> None:
        """From now on look at another ``scene``."""
        self._scene = scene
        boards = scene.boards
        whole = boards.corners[:, :, 2].min(axis=1, initial=np.inf) >= 0.0
        corners = boards.corners[whole]
        centres = corners.mean(axis=1, keepdims=True)
        points = np.concatenate([corners, 0.5 * (corners + np.roll(corners, -1, axis=1))], axis=1)
        self._points = points.reshape(-1, 3)
        self._margins = np.concatenate([centres + QUIET * (points - centres), centres], axis=1)
        self._cells = boards.black.shape[1] - 1
        self._owners = boards.quad[whole]
        self._ids = [int(marker) for marker in boards.ids[whole]]

    def detect(self, stamp: float, pose_at: PoseAt) -> tuple[MarkerDetection, ...]:
        """The markers found in the exposure that is centred on ``stamp``, in the order of the track."""
        m = len(self._ids)
        chance, scatter = self._rng.random((m, 5)), self._rng.standard_normal((m, 4, 2))
        ends = stamp + 0.5 * self._exposure * np.array([-1.0, 0.0, 1.0])
        R_wc, centres = camera_poses(self._camera, pose_at, ends)
        rays = _to_camera(self._points, R_wc, centres)
        pixels = self._camera.project(rays).reshape(3, m, POINTS, 2)
        corners, noise = np.empty((m, 4, 2)), np.empty(m)
        found = _observe(
            pixels,
            rays.reshape(3, m, POINTS, 3)[1],
            self._least_cos,
            self._margins,
            self._owners,
            self._scene.seen_from(centres[1]),
            centres[1],
            self._camera.width,
            self._camera.height,
            self._cells,
            chance,
            scatter,
            corners,
            noise,
        )
        return tuple(MarkerDetection(self._ids[i], corners[i], noise=noise[i]) for i in np.flatnonzero(found))
