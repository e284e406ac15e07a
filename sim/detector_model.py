"""How likely the marker detector is to find a marker, and how far off its corners are.

Fitted to what `flightapp.perception.aruco.ArucoDetector` made of 2,900 images of `sim.render.Renderer`: pinhole
640×480 and fisheye 848×800, 1.2 to 12 m, up to 70° off the gate's axis, exposures of 4, 8 and 15 ms, body rates of
0, 0.45 and 1.5 rad/s and speeds of 0, 1.2 and 4 m/s (1 σ per axis); 8,967 markers of dictionary 4X4_50 wholly in
view, up to 25 px of blur. In 103 bins of size, aspect and blur the share found is met to 0.04 RMS, at worst 0.19; in
53 of them the corners' RMS is met to a factor of 0.82 to 1.43 (10 to 90 %), at worst 0.5 and 2.2.
"""

import math
from typing import NamedTuple

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import kernel

NARROW, NARROW_STEEPNESS = 6.56 / 6.0, 6.0
"""px per cell across the narrow side at which every other marker is read; exponent of the odds."""
FORESHORTENED, FORESHORTENING = 0.87, 0.83
"""Narrower over wider side from which on it matters, and the exponent with which the narrow side counts less."""
SIDE, SIDE_STEEPNESS = 11.1, 24.0
"""px, mean side at which every other marker is long enough around to be looked at; exponent."""
SMEARED, SMEARED_STEEPNESS = 1.63, 24.7
"""Blur along a marker's axes in cells at which every other marker is read; exponent."""
SOFT, SOFT_STEEPNESS = 15.0, 8.7
"""px, blur at which every other quad is seen at all; exponent."""

CORE = 0.035
"""px, standard deviation of the corners of a large, sharp marker."""
CORE_SMALL, CORE_SMALL_POWER = 0.204, 2.77
"""px at a narrow side of 10 px, and the power of the narrow side with which it falls."""
CORE_SMEARED, CORE_SMEARED_POWER = 0.128, 2.57
"""px at a blur of one cell, and the power of the blur with which it grows."""
CORE_SOFT = 0.5
"""px at a blur of 10 px; grows with its third power."""
WRONG_ASPECT, WRONG_SLOPE = 0.45, 10.0
"""Narrower over wider side at which every other corner of a small marker is far off; how steeply the odds fall."""
WRONG_SIZE, WRONG_POWER = 19.5, 16.0
"""px, narrow side at which their share is halved, and how steeply it falls."""
WRONG_SMEARED = 0.016
"""Share of corners far off at a blur of one cell; grows with its fourth power."""
WRONG_SIGMA = 1.0
"""px, standard deviation of these."""

BOW = 2.0 / 3.0
"""A straight line fitted to a side that the lens bends lies this part of the sagitta off the corners' chord.

So the mean of a parabola has it. For markers of 35 to 50 px in the fisheye's images, the detector's corners lie
0.34 px RMS off the true corners, but 0.07 px off these.
"""


class Look(NamedTuple):
    """What of a marker's looks matters to the detector."""

    narrow: float
    """px, the narrower of its two widths."""
    aspect: float
    """Narrower over wider."""
    side: float
    """px, mean side."""
    blur: float
    """px that it moves during the exposure."""
    smear: float
    """The same in its own cells, along the axis where it is more."""


@kernel
def marker_look(before: Vector, pixels: Vector, after: Vector, cells: int) -> Look:
    """How a marker of ``cells`` cells a side looks; corners (4.., 2) px before, in and after mid exposure."""
    side = 0.0
    for i in range(4):
        j = (i + 1) % 4
        side += 0.25 * math.hypot(pixels[j, 0] - pixels[i, 0], pixels[j, 1] - pixels[i, 1])
    bx = 0.25 * (after[:4, 0].sum() - before[:4, 0].sum())
    by = 0.25 * (after[:4, 1].sum() - before[:4, 1].sum())
    ux = 0.5 * (pixels[1, 0] - pixels[0, 0] + pixels[2, 0] - pixels[3, 0])
    uy = 0.5 * (pixels[1, 1] - pixels[0, 1] + pixels[2, 1] - pixels[3, 1])
    vx = 0.5 * (pixels[3, 0] - pixels[0, 0] + pixels[2, 0] - pixels[1, 0])
    vy = 0.5 * (pixels[3, 1] - pixels[0, 1] + pixels[2, 1] - pixels[1, 1])
    area = max(abs(ux * vy - uy * vx), 1e-6)
    u, v = max(math.hypot(ux, uy), 1e-6), max(math.hypot(vx, vy), 1e-6)
    smear = cells * max(abs(bx * vy - by * vx), abs(ux * by - uy * bx)) / area
    return Look(area / max(u, v), min(u, v) / max(u, v), side, math.hypot(bx, by), smear)


@kernel
def chance_found(look: Look, cells: int) -> float:
    """Probability that the detector finds a marker."""
    read = look.narrow / (NARROW * cells) * min(1.0, look.aspect / FORESHORTENED) ** FORESHORTENING
    chance: float = 1.0 / (1.0 + max(read, 1e-3) ** -NARROW_STEEPNESS)
    chance /= 1.0 + max(look.side / SIDE, 1e-3) ** -SIDE_STEEPNESS
    chance /= 1.0 + min(look.smear / SMEARED, 1e3) ** SMEARED_STEEPNESS
    chance /= 1.0 + min(look.blur / SOFT, 1e3) ** SOFT_STEEPNESS
    return chance


@kernel
def corner_scatter(look: Look) -> tuple[float, float]:
    """Standard deviation (px) of a good corner, and the share of corners that are far off (`WRONG_SIGMA`)."""
    small = CORE_SMALL * (10.0 / max(look.narrow, 5.0)) ** CORE_SMALL_POWER
    smeared = CORE_SMEARED * look.smear**CORE_SMEARED_POWER
    soft = CORE_SOFT * (0.1 * look.blur) ** 3
    core = math.sqrt(CORE * CORE + small * small + smeared * smeared + soft * soft)
    wrong = 1.0 / (1.0 + math.exp(WRONG_SLOPE * (look.aspect - WRONG_ASPECT)))
    wrong /= 1.0 + (look.narrow / WRONG_SIZE) ** WRONG_POWER
    wrong += WRONG_SMEARED * look.smear**4
    return core, min(wrong, 0.6)


@kernel
def bowed_corners(pixels: Vector, out: Vector) -> None:
    """Fill ``out`` (4, 2) with where lines fitted to the sides meet; ``pixels`` (8, 2) corners, then middles of sides.

    Side i goes from corner i to the next.
    """
    for i in range(4):
        before = (i + 3) % 4
        nx = np.empty(2)
        ny = np.empty(2)
        shift = np.empty(2)
        for j in range(2):
            a = before if j == 0 else i
            b = (a + 1) % 4
            ex, ey = pixels[b, 0] - pixels[a, 0], pixels[b, 1] - pixels[a, 1]
            length = max(math.hypot(ex, ey), 1e-9)
            nx[j], ny[j] = ey / length, -ex / length
            mx = pixels[4 + a, 0] - 0.5 * (pixels[a, 0] + pixels[b, 0])
            my = pixels[4 + a, 1] - 0.5 * (pixels[a, 1] + pixels[b, 1])
            shift[j] = BOW * (mx * nx[j] + my * ny[j])
        determinant = nx[0] * ny[1] - nx[1] * ny[0]
        out[i, 0], out[i, 1] = pixels[i, 0], pixels[i, 1]
        if abs(determinant) > 0.05:
            out[i, 0] += (shift[0] * ny[1] - shift[1] * ny[0]) / determinant
            out[i, 1] += (nx[0] * shift[1] - nx[1] * shift[0]) / determinant
