"""Ground and sky: paving with perspective, and a sky that brightens towards the horizon.

The ground is one periodic texture, averaged beforehand to halves of its resolution (L. Williams, "Pyramidal
parametrics", 1983), so that it fades with distance and does not alias.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel

Image = NDArray[np.float32]

TEXELS = 512
TEXEL = 0.025
"""m."""
SLAB = 32
"""Texels on the side of a paving slab."""
GROUND_SHADE = 88.0
HAZE_SHADE = 150.0
HAZE_RANGE = 150.0
"""m, distance in which 63 % of the ground's light is lost to the haze."""
ZENITH_SHADE = 165.0
HORIZON_SHADE = 215.0
LEVEL_STEPS = 1024


class Ground(NamedTuple):
    """A pyramid of ever coarser copies of the ground's texture."""

    texels: NDArray[np.uint8]
    """All levels one after the other, each square, grey levels."""
    starts: NDArray[np.int64]
    """(levels,) where each level begins."""


def make_ground(rng: np.random.Generator) -> Ground:
    """Paving slabs of differing brightness with joints, stains and grain."""
    slabs = TEXELS // SLAB
    tone = rng.normal(0.0, 9.0, (slabs, slabs)).repeat(SLAB, 0).repeat(SLAB, 1)
    at = np.arange(TEXELS) % SLAB < 2
    joints = np.where(at[:, None] | at[None, :], -28.0, 0.0)
    level = GROUND_SHADE + tone + joints + _noise(rng, 16, 5.0) + _noise(rng, 4, 5.0) + _noise(rng, 1, 6.0)
    levels = [level]
    while len(level) > 1:
        level = level.reshape(len(level) // 2, 2, -1, 2).mean(axis=(1, 3))
        levels.append(level)
    starts = np.cumsum([0] + [item.size for item in levels[:-1]])
    return Ground(np.concatenate([item.ravel() for item in levels]).round().astype(np.uint8), starts)


def _noise(rng: np.random.Generator, grain: int, sigma: float) -> Vector:
    """Periodic noise (TEXELS, TEXELS) whose grain is about so many texels wide."""
    f = np.fft.fftfreq(TEXELS)
    low = np.exp(-0.5 * ((f[:, None] ** 2 + f[None, :] ** 2) * (math.pi * grain) ** 2))
    noise = np.fft.ifft2(np.fft.fft2(rng.standard_normal((TEXELS, TEXELS))) * low).real
    scaled: Vector = sigma * noise / noise.std()
    return scaled


@kernel
def _sample(texels: NDArray[np.uint8], start: int, size: int, x: float, y: float) -> float:
    fx, fy = math.floor(x), math.floor(y)
    u, v = x - fx, y - fy
    mask = size - 1
    x0, y0 = int(fx) & mask, int(fy) & mask
    x1, y1 = (x0 + 1) & mask, (y0 + 1) & mask
    low = texels[start + y0 * size + x0] * (1.0 - u) + texels[start + y0 * size + x1] * u
    high = texels[start + y1 * size + x0] * (1.0 - u) + texels[start + y1 * size + x1] * u
    mixed: float = low * (1.0 - v) + high * v
    return mixed


@kernel
def _descent_tables(height: float, pixel: float, levels: int) -> tuple[NDArray[np.int64], Vector, Vector]:
    """For rays that descend by (i + ½)/`LEVEL_STEPS` per metre: pyramid level, its texels per texel, haze (0..1)."""
    level = np.empty(LEVEL_STEPS, np.int64)
    scale = np.empty(LEVEL_STEPS)
    haze = np.empty(LEVEL_STEPS)
    for i in range(LEVEL_STEPS):
        descent = (i + 0.5) / LEVEL_STEPS
        reach = height / descent
        footprint = pixel * reach / math.sqrt(descent)
        level[i] = min(max(round(math.log2(max(footprint / TEXEL, 1e-9))), 0), levels - 1)
        scale[i] = 1.0 / (1 << level[i])
        haze[i] = 1.0 - math.exp(-reach / HAZE_RANGE)
    return level, scale, haze


@kernel
def paint_background(out: Image, rays: Image, ground: Ground, R_wc: Vector, centres: Vector, pixel: float) -> None:
    """Fill ``out`` (h, w) with the mean of what the camera sees at each of its poses.

    ``rays`` (h, w, 3) unit, camera frame, zero outside the lens; ``R_wc`` (n, 3, 3) and ``centres`` (n, 3) m are
    the poses; ``pixel`` rad is the angle that a pixel of ``out`` covers.
    """
    n = len(R_wc)
    levels = len(ground.starts)
    for i in range(n):
        R = R_wc[i]
        height = max(centres[i, 2], 0.02)
        level, scales, haze = _descent_tables(height, pixel, levels)
        x0, y0 = centres[i, 0] / TEXEL, centres[i, 1] / TEXEL
        for row in range(out.shape[0]):
            for column in range(out.shape[1]):
                x, y, z = rays[row, column, 0], rays[row, column, 1], rays[row, column, 2]
                rise = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
                cover = min(0.5 - rise / pixel, 1.0)
                light = 0.0
                if cover < 1.0:
                    low = 1.0 - min(abs(rise), 1.0)
                    light = ZENITH_SHADE + (HORIZON_SHADE - ZENITH_SHADE) * low * low
                if cover > 0.0:
                    descent = max(-rise, 1e-3)
                    step = min(int(descent * LEVEL_STEPS), LEVEL_STEPS - 1)
                    scale = scales[step]
                    reach = scale * height / (descent * TEXEL)
                    shade = _sample(
                        ground.texels,
                        ground.starts[level[step]],
                        TEXELS >> level[step],
                        x0 * scale + reach * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z) - 0.5,
                        y0 * scale + reach * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z) - 0.5,
                    )
                    shade += haze[step] * (HAZE_SHADE - shade)
                    light += cover * (shade - light)
                if i == 0:
                    out[row, column] = light / n
                else:
                    out[row, column] += light / n
