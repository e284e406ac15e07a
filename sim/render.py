"""The rendering camera: images of the scene as a global-shutter grey camera takes them."""

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector, quat_to_matrix
from flightapp.jit import kernel
from flightapp.perception.camera import CameraModel
from sim.ground import Image, make_ground, paint_background
from sim.order import far_to_near, quad_normals, quad_spheres, quad_vertices
from sim.raster import TILE, paint_quads
from sim.scene import Quads, Scene

PoseAt = Callable[[float], tuple[Vector, Vector]]
"""The true position (3,) m and orientation q_wb (4,) of the body at a stamp."""

READ_NOISE = 1.8
"""Grey levels."""
SHOT_NOISE = 0.03
"""Grey levels² per grey level."""
VIGNETTING = 0.3
"""Share of the light lost at the image's corner."""
NOISE_POOL = 1 << 18
LEG_TURN = 0.04
"""rad, a pixel's path over a quad is taken as straight while the camera turns by this."""
LEG_SHIFT = 0.1
"""m, and while it moves by this."""
MAX_LEGS = 16
BACKGROUND_SCALE = 3
"""The background is painted at this fraction of the resolution: it has no detail that a marker detector needs."""
MAX_BACKGROUND_POSES = 4
CONE_MARGIN = 0.02
"""rad, room for the point spread around a tile."""


@kernel
def _develop(out: NDArray[np.uint8], light: Image, gain: Image, noise: Image, offsets: NDArray[np.int64]) -> None:
    for row in range(out.shape[0]):
        start = offsets[row]
        for column in range(out.shape[1]):
            level = light[row, column] * gain[row, column]
            sigma = math.sqrt(np.float32(READ_NOISE * READ_NOISE) + np.float32(SHOT_NOISE) * level)
            level += sigma * noise[start + column]
            out[row, column] = np.uint8(min(max(level + np.float32(0.5), np.float32(0.0)), np.float32(255.0)))


@kernel
def _mounted(position: Vector, q_wb: Vector, R_bc: Vector, p_bc: Vector, R_wc: Vector, centre: Vector) -> None:
    R_wb = quat_to_matrix(q_wb)
    for i in range(3):
        centre[i] = position[i]
        for k in range(3):
            centre[i] += R_wb[i, k] * p_bc[k]
        for j in range(3):
            R_wc[i, j] = R_wb[i, 0] * R_bc[0, j] + R_wb[i, 1] * R_bc[1, j] + R_wb[i, 2] * R_bc[2, j]


def camera_poses(camera: CameraModel, pose_at: PoseAt, stamps: Vector) -> tuple[Vector, Vector]:
    """Rotations R_wc (n, 3, 3) and centres (n, 3) m, world, of the camera at each of ``stamps`` (n,)."""
    R_wc = np.empty((len(stamps), 3, 3))
    centres = np.empty((len(stamps), 3))
    for i, stamp in enumerate(stamps.tolist()):
        position, orientation = pose_at(stamp)
        _mounted(position, orientation, camera.R_bc, camera.p_bc, R_wc[i], centres[i])
    return R_wc, centres


def turn_between(R_a: Vector, R_b: Vector) -> float:
    """Angle in rad between two rotations (3, 3)."""
    return math.acos(min(max(0.5 * (float((R_a * R_b).sum()) - 1.0), -1.0), 1.0))


class Renderer:
    """A camera that takes pictures of a scene.

    The image is formed as by a global shutter that is open for ``exposure`` s around the stamp; the gain is taken
    to be set so that brightness does not depend on it. Lens, point spread, motion blur, vignetting, shot and
    read noise are modelled.
    """

    def __init__(self, scene: Scene, camera: CameraModel, exposure: float, seed: int) -> None:
        self._camera = camera
        self._exposure = exposure
        self._ground = make_ground(np.random.default_rng([scene.seed, 1]))
        self._rng = np.random.default_rng(seed)
        w, h = camera.width, camera.height
        wb, hb = -(-w // BACKGROUND_SCALE), -(-h // BACKGROUND_SCALE)
        self._rays = ray_grid(camera, w, h)
        self._background_rays = ray_grid(camera, wb, hb)
        self._cones = _tile_cones(self._rays)
        self._gain = _vignetting(self._rays)
        self._noise = self._rng.standard_normal(NOISE_POOL + w, np.float32)
        self._background = np.empty((hb, wb), np.float32)
        self._light = np.empty((h, w), np.float32)
        self.look_at(scene)

    def look_at(self, scene: Scene) -> None:
        """From now on look at another ``scene``, on the same ground."""
        self._scene = scene
        self._outlines = _outlines(scene.quads)

    def render(self, stamp: float, pose_at: PoseAt) -> NDArray[np.uint8]:
        """The image (h, w) whose exposure is centred on ``stamp``."""
        ends = stamp + 0.5 * self._exposure * np.array([-1.0, 0.0, 1.0])
        R_wc, centres = camera_poses(self._camera, pose_at, ends)
        turn = turn_between(R_wc[0], R_wc[2])
        shift = float(np.linalg.norm(centres[2] - centres[0]))
        focal = float(self._camera.focal[0])
        eye = centres[1]
        self._paint_background(stamp, pose_at, turn * focal / BACKGROUND_SCALE)
        cv2.resize(self._background, (self._camera.width, self._camera.height), dst=self._light)
        legs = min(max(math.ceil(turn / LEG_TURN), math.ceil(shift / LEG_SHIFT), 1), MAX_LEGS)
        if legs > 1:
            nodes = stamp + self._exposure * np.linspace(-0.5, 0.5, legs + 1)
            R_wc, centres = camera_poses(self._camera, pose_at, nodes)
        else:
            R_wc, centres = R_wc[::2], centres[::2]
        quads, boards = self._scene.seen_from(eye), self._scene.boards
        vertices, normals, spheres = _outlines(quads) if len(self._scene.pillars) else self._outlines
        order = far_to_near(vertices, normals, eye)
        poses = np.ascontiguousarray(R_wc), np.ascontiguousarray(centres)
        image = np.empty(self._light.shape, np.uint8)
        offsets = self._rng.integers(0, NOISE_POOL, len(image))
        paint_quads(self._light, self._rays, self._cones, quads, boards, order, spheres, *poses, turn)
        _develop(image, self._light, self._gain, self._noise, offsets)
        return image

    def _paint_background(self, stamp: float, pose_at: PoseAt, motion: float) -> None:
        """``motion`` is how many of the background's pixels it moves during the exposure."""
        n = min(max(round(motion), 1), MAX_BACKGROUND_POSES)
        times = stamp + self._exposure * ((np.arange(n) + 0.5) / n - 0.5)
        R_wc, centres = camera_poses(self._camera, pose_at, times)
        pixel = BACKGROUND_SCALE / float(self._camera.focal[0])
        paint_background(self._background, self._background_rays, self._ground, R_wc, centres, pixel)


def _outlines(quads: Quads) -> tuple[Vector, Vector, Vector]:
    """Vertices (n, 4, 3) m, normals (n, 3) and spheres (n, 4) m of the quads."""
    vertices = quad_vertices(quads)
    return vertices, quad_normals(quads), quad_spheres(vertices)


def ray_grid(camera: CameraModel, width: int, height: int) -> Image:
    """Unit rays (height, width, 3) through the middles of equal parts of the image; zero where the lens ends."""
    u = (np.arange(width) + 0.5) * camera.width / width - 0.5
    v = (np.arange(height) + 0.5) * camera.height / height - 0.5
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = camera.bearings(pixels)
    seen = np.hypot(*(camera.project(rays) - pixels).T) < 0.01
    return np.where(seen[:, None], rays, 0.0).reshape(height, width, 3).astype(np.float32)


def _tile_cones(rays: Image) -> Vector:
    """(rows, columns, 5) axis, cosine and sine of the half-angle of the cone around each tile's rays."""
    h, w = rays.shape[:2]
    rows, columns = -(-h // TILE), -(-w // TILE)
    padded = np.zeros((rows * TILE, columns * TILE, 3))
    padded[:h, :w] = rays
    tiles = padded.reshape(rows, TILE, columns, TILE, 3).swapaxes(1, 2).reshape(rows, columns, -1, 3)
    axis = tiles.sum(axis=2)
    axis /= np.maximum(np.linalg.norm(axis, axis=2, keepdims=True), 1e-9)
    along = np.einsum("rcpi,rci->rcp", tiles, axis)
    along[~tiles.any(axis=3)] = 1.0
    half_angle = np.arccos(np.clip(along.min(axis=2), -1.0, 1.0)) + CONE_MARGIN
    return np.concatenate([axis, np.cos(half_angle)[..., None], np.sin(half_angle)[..., None]], axis=2)


def _vignetting(rays: Image) -> Image:
    h, w = rays.shape[:2]
    y, x = np.mgrid[:h, :w]
    radius = np.hypot(x - 0.5 * (w - 1), y - 0.5 * (h - 1)) / math.hypot(0.5 * w, 0.5 * h)
    gain = np.where(rays.any(axis=2), 1.0 - VIGNETTING * radius**2, 0.0)
    return gain.astype(np.float32)
