"""Camera models: pinhole with Brown distortion, and Kannala–Brandt fisheye.

The fisheye follows J. Kannala and S. Brandt, "A generic camera model and calibration method for
conventional, wide-angle, and fish-eye lenses" (2006), with the four coefficients of OpenCV's `fisheye`;
the pinhole follows D. Brown (1966) with OpenCV's (k1, k2, p1, p2).
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel

NDArrayBool = NDArray[np.bool_]


class Lens(StrEnum):
    """How rays become pixels."""

    PINHOLE = "pinhole"
    FISHEYE = "fisheye"


@kernel
def _distort_fisheye(theta: float, k: Vector) -> float:
    t2 = theta * theta
    scale: float = 1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))
    return theta * scale


@kernel
def _project(fisheye: bool, f: Vector, k: Vector, points: Vector) -> Vector:
    out = np.empty((points.shape[0], 2))
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if fisheye:
            r = math.sqrt(x * x + y * y)
            scale = 1.0 / z if r < 1e-9 and z > 0.0 else _distort_fisheye(math.atan2(r, z), k) / max(r, 1e-12)
            u, v = scale * x, scale * y
        elif z > 1e-9:
            u, v = x / z, y / z
            r2 = u * u + v * v
            radial = 1.0 + r2 * (k[0] + r2 * k[1])
            u, v = (
                u * radial + 2.0 * k[2] * u * v + k[3] * (r2 + 2.0 * u * u),
                v * radial + k[2] * (r2 + 2.0 * v * v) + 2.0 * k[3] * u * v,
            )
        else:
            u, v = math.nan, math.nan
        out[i, 0] = f[0] * u + f[2]
        out[i, 1] = f[1] * v + f[3]
    return out


@kernel
def _unproject(fisheye: bool, f: Vector, k: Vector, pixels: Vector) -> Vector:
    out = np.empty((pixels.shape[0], 3))
    for i in range(pixels.shape[0]):
        u = (pixels[i, 0] - f[2]) / f[0]
        v = (pixels[i, 1] - f[3]) / f[1]
        if fisheye:
            distorted = math.sqrt(u * u + v * v)
            theta = min(distorted, math.pi)
            for _ in range(12):
                t2 = theta * theta
                slope = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])))
                step = (_distort_fisheye(theta, k) - distorted) / slope
                theta -= step
                if abs(step) < 1e-12:
                    break
            scale = math.sin(theta) / distorted if distorted > 1e-9 else 1.0
            x, y, z = scale * u, scale * v, math.cos(theta)
        else:
            x, y = u, v
            for _ in range(20):
                r2 = x * x + y * y
                radial = 1.0 + r2 * (k[0] + r2 * k[1])
                x, y = (
                    (u - 2.0 * k[2] * x * y - k[3] * (r2 + 2.0 * x * x)) / radial,
                    (v - k[2] * (r2 + 2.0 * y * y) - 2.0 * k[3] * x * y) / radial,
                )
            z = 1.0
        n = math.sqrt(x * x + y * y + z * z)
        out[i, 0] = x / n
        out[i, 1] = y / n
        out[i, 2] = z / n
    return out


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Intrinsics and mount of a camera."""

    lens: Lens
    width: int
    height: int
    focal: Vector
    """(4,) fx, fy, cx, cy in pixels."""
    distortion: Vector
    """(4,) k1..k4 (fisheye) or k1, k2, p1, p2 (pinhole)."""
    R_bc: Vector
    """(3, 3) camera (optical) to body."""
    p_bc: Vector
    """(3,) m, the camera's centre in the body frame."""

    @property
    def fisheye(self) -> bool:
        """Whether rays at more than 90° from the axis can be seen."""
        return self.lens is Lens.FISHEYE

    @property
    def matrix(self) -> Vector:
        """Intrinsic matrix K (3, 3)."""
        fx, fy, cx, cy = self.focal
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def project(self, points: Vector) -> Vector:
        """Pixels (n, 2) of ``points`` (n, 3) in the camera frame.

        A pinhole gives NaN for points behind it. Pixels outside the image are returned as they are.
        """
        return _project(self.fisheye, self.focal, self.distortion, np.ascontiguousarray(points, float))

    def bearings(self, pixels: Vector) -> Vector:
        """Unit rays (n, 3) in the camera frame through ``pixels`` (n, 2)."""
        return _unproject(self.fisheye, self.focal, self.distortion, np.ascontiguousarray(pixels, float))

    def contains(self, pixels: Vector, margin: float = 0.0) -> NDArrayBool:
        """Whether each of ``pixels`` (n, 2) lies inside the image by at least ``margin`` pixels."""
        u, v = pixels[:, 0], pixels[:, 1]
        inside: NDArrayBool = (
            (u >= margin) & (u <= self.width - 1 - margin) & (v >= margin) & (v <= self.height - 1 - margin)
        )
        return inside
