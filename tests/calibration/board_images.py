"""Images of a board as a camera takes them, by tracing its rays to the board."""

import cv2
import numpy as np

from flightapp.calibration.board import Board, View
from flightapp.perception.camera import CameraModel, Lens

BOARD = Board()
SAMPLES = 2
"""Rays per pixel, squared."""
PIXEL = 0.0005
"""m, of the board's own picture."""
MOUNT = np.eye(3), np.zeros(3)
PINHOLE = CameraModel(
    Lens.PINHOLE, 480, 360, np.array((265.0, 266.5, 243.0, 176.0)), np.array((-0.28, 0.07, 0.0008, -0.0005)), *MOUNT
)
FISHEYE = CameraModel(
    Lens.FISHEYE, 480, 360, np.array((160.0, 161.0, 236.0, 183.0)), np.array((-0.008, 0.041, -0.038, 0.0065)), *MOUNT
)


class Photographer:
    """Takes pictures of the board with the camera ``model``."""

    def __init__(self, model, board=BOARD):
        self.model, self.board = model, board
        steps = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
        u = (np.arange(model.width)[:, None] + steps).ravel()
        v = (np.arange(model.height)[:, None] + steps).ravel()
        grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        self.rays = model.bearings(grid).reshape(len(v), len(u), 3)
        width, height = (round(side / PIXEL) for side in board.size)
        picture = board.pattern.generateImage((width, height), marginSize=0, borderBits=1)
        self.margin = 0.006
        rim = round(self.margin / PIXEL)
        self.picture = cv2.copyMakeBorder(picture, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=255)

    def take(self, R, t, rng):
        """The image with the board at pose ``R``, ``t``, board to camera."""
        light = np.full(self.rays.shape[:2], 90.0, np.float32)
        window = self._window(R, t)
        rays, origin, normal = self.rays[window], R.T @ t, R[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (normal @ t) / (rays @ normal)
            cells = ((rays * reach[..., None]) @ R[:, :2] - origin[:2] + self.margin) / PIXEL
        rows, columns = self.picture.shape
        ok = (reach > 0) & (cells >= 0).all(axis=-1) & (cells[..., 0] < columns) & (cells[..., 1] < rows)
        inside = cells[ok].astype(int)
        light[window][ok] = 30.0 + 0.65 * self.picture[inside[:, 1], inside[:, 0]]
        small = cv2.resize(light, (self.model.width, self.model.height), interpolation=cv2.INTER_AREA)
        noisy = cv2.GaussianBlur(small, (0, 0), 0.6) + 2.0 * rng.standard_normal(small.shape)
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)

    def _window(self, R, t):
        """The part of the rays that may meet the board."""
        width, height = self.board.size
        edge = np.linspace(-0.01, 1.01, 12)
        outline = np.array([(x * width, y * height, 0.0) for x in edge for y in edge]) @ R.T + t
        pixels = self.model.project(outline[outline[:, 2] > 0.005])
        low, high = np.nanmin(pixels, axis=0), np.nanmax(pixels, axis=0)
        low = np.clip(SAMPLES * (low - 3), 0, None).astype(int)
        high = np.clip(SAMPLES * (high + 4), 1, None).astype(int)
        return slice(low[1], high[1]), slice(low[0], high[0])


def pose(model, rng, place=None, tilt=0.6, distance=None):
    """A pose of the board, which faces the camera but for some ``tilt`` (rad), at ``place`` (shares of the image)."""
    distance = distance or ((0.09, 0.2) if model.fisheye else (0.16, 0.4))
    where = rng.uniform(0.12, 0.88, 2) if place is None else np.asarray(place)
    ray = model.bearings((where * (model.width, model.height))[None])[0]
    right = np.cross((0.0, 1.0, 0.0), ray)
    right /= np.linalg.norm(right)
    facing = np.stack((right, np.cross(ray, right), ray), axis=1)
    R = facing @ cv2.Rodrigues(rng.uniform(-tilt, tilt, 3))[0]
    return R, rng.uniform(*distance) * ray - R @ BOARD.corners.mean(axis=0)


def view(model, R, t, rng, noise=0.1, name=""):
    """What a detector would find of the board, without an image; None where too little is seen."""
    points = BOARD.corners @ R.T + t
    pixels = model.project(points)
    seen = np.isfinite(pixels).all(axis=1) & (points[:, 2] > 0.02)
    seen[seen] = model.contains(pixels[seen], 2.0)
    if seen.sum() < 12:
        return None
    ids = np.flatnonzero(seen)
    return View(name, 0.0, ids, pixels[ids] + noise * rng.standard_normal((len(ids), 2)))


def tour(model, rng, count=26):
    """Poses that cover the image, near and far."""
    places = [(x, y) for y in (0.15, 0.5, 0.85) for x in (0.12, 0.38, 0.62, 0.88)]
    return [pose(model, rng, places[i % len(places)]) for i in range(count)]
