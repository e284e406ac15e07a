"""How likely the marker detector is to find a marker, and how far off its corners are.

Fitted by maximum likelihood to what `flightapp.perception.aruco.ArucoDetector`, tracking in the boxes of
`flightapp.perception.regions`, made of 3,840 images of `sim.render.Renderer`: pinhole 640×480 and fisheye 848×800, 1.2
to 16 m, up to 75° off the gate's axis, gates anywhere in the image, exposures of 4, 8 and 15 ms, body rates of 0, 0.45
and 1.5 rad/s and speeds of 0, 1.2 and 4 m/s (1 σ per axis); 13,304 markers of dictionary 4X4_50 wholly in view. In
whole images half of the markers are read at a size 0.1 px per cell away from that in boxes, at most.

Against 1,666 markers of other images: the shares found in 21 bins of size, blur and bend are met to 0.03 RMS, which is
chance, at worst 0.10; the corners' RMS in 10 bins to factors of 0.78 to 1.5. Of the markers fitted to, in 53 bins, to
factors of 0.83 to 1.38 (10 to 90 %), at worst 0.67 and 2.0. Errors of a marker's corners are drawn independently.

Since the detector fits pictures to small markers (`flightapp.perception.picture`) their corners are better: what size
adds was fitted anew to 1,817 markers narrower than 20 px, blurred by less than 0.8 cells, of 900 images more (pinhole,
3 to 12 m), in six bins of size to factors of 0.96 to 1.16, and what blur adds to 414 more that were blurred.
"""

import math
from typing import NamedTuple

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import kernel
from flightapp.perception.reading import expected_noise

NARROW, NARROW_STEEPNESS = 1.284, 11.3
"""px per cell across the narrow side at which every other marker is read; exponent of the odds."""
SIDE, SIDE_STEEPNESS = 8.71, 21.6
"""px, mean side at which every other marker is long enough around to be looked at; exponent."""
SMEARED, SMEARED_STEEPNESS = 1.733, 14.1
"""Blur along a marker's axes in cells at which every other marker is read; exponent."""
SOFT, SOFT_STEEPNESS = 16.7, 8.35
"""px, blur at which every other quad is seen at all; exponent."""
BENT, BENT_STEEPNESS = 0.232, 4.8
"""Sagitta in cells of a side that the lens bends, at which every other marker is read; exponent."""

CORE = 0.0303
"""px, standard deviation of the corners of a sharp marker of middling size."""
CORE_SMALL, SMALL, SMALL_POWER = 0.180, 6.0, 3.46
"""px of the smallest markers, whose cells pull at their corners; px of the narrow side at which it is half of that, and
the power with which it falls."""
CORE_BENT, CORE_BENT_POWER = 0.267, 1.44
"""Cells at a sagitta of one cell, and the power of the sagitta."""
CORE_SMEARED, CORE_SMEARED_POWER = 0.0164, 2.61
"""Cells at a blur of one cell, and the power of the blur with which it grows."""
PICTURE, PICTURE_SMEARED = 3.3, 0.67
"""px per cell below which the detector fits pictures, and the part of what blur does that is left then."""
WRONG, WRONG_TIMES = 0.563, 3.67
"""Share of the corners that blur puts so many times further off."""

WIDTH, WIDTH_BLURRED = 0.7, 0.17
"""px, width of a sharp marker's edges as the detector sees it, noise included, and what a blur's square adds to the
square of it: medians of 2,400 markers of `flightapp.evaluation.detection_images`, 18 px and larger."""

BOW = 2.0 / 3.0
"""A straight line fitted to a side that the lens bends lies this part of the sagitta off the corners' chord.

So the mean of a parabola has it.
"""
BOW_SIDE = 30.0
"""px, length of a side at which half of its bend is seen; it is seen the better, the longer the side.

The detector expects little bend: it fits nearly straight lines to shorter sides, and parabolas to longer ones, whose
ends scatter twice as much. For sharp markers of 14 px and more in the fisheye's images its corners lie 0.09 px RMS off
the true corners, but 0.06 px off these.
"""


class Look(NamedTuple):
    """What of a marker's looks matters to the detector."""

    narrow: float
    """px, the narrower of its two widths."""
    side: float
    """px, mean side."""
    blur: float
    """px that it moves during the exposure."""
    smear: float
    """The same in its own cells, along the axis where it is more."""
    bend: float
    """Sagitta in cells of the side that is bent most."""


@kernel
def marker_look(before: Vector, pixels: Vector, after: Vector, cells: int) -> Look:
    """How a marker of ``cells`` cells a side looks; (8, 2) px before, in and after mid exposure as `bowed_corners`'."""
    side, sagitta = 0.0, 0.0
    for i in range(4):
        length, off = _bent(pixels, i)
        side, sagitta = side + 0.25 * length, max(sagitta, abs(off))
    bx = 0.25 * (after[:4, 0].sum() - before[:4, 0].sum())
    by = 0.25 * (after[:4, 1].sum() - before[:4, 1].sum())
    ux = 0.5 * (pixels[1, 0] - pixels[0, 0] + pixels[2, 0] - pixels[3, 0])
    uy = 0.5 * (pixels[1, 1] - pixels[0, 1] + pixels[2, 1] - pixels[3, 1])
    vx = 0.5 * (pixels[3, 0] - pixels[0, 0] + pixels[2, 0] - pixels[1, 0])
    vy = 0.5 * (pixels[3, 1] - pixels[0, 1] + pixels[2, 1] - pixels[1, 1])
    area = max(abs(ux * vy - uy * vx), 1e-6)
    u, v = max(math.hypot(ux, uy), 1e-6), max(math.hypot(vx, vy), 1e-6)
    smear = cells * max(abs(bx * vy - by * vx), abs(ux * by - uy * bx)) / area
    narrow = area / max(u, v)
    return Look(narrow, side, math.hypot(bx, by), smear, cells * sagitta / narrow)


@kernel
def chance_found(look: Look, cells: int) -> float:
    """Probability that the detector finds a marker."""
    chance: float = 1.0 / (1.0 + max(look.narrow / (NARROW * cells), 1e-3) ** -NARROW_STEEPNESS)
    chance /= 1.0 + max(look.side / SIDE, 1e-3) ** -SIDE_STEEPNESS
    chance /= 1.0 + min(look.smear / SMEARED, 1e3) ** SMEARED_STEEPNESS
    chance /= 1.0 + min(look.blur / SOFT, 1e3) ** SOFT_STEEPNESS
    chance /= 1.0 + min(look.bend / BENT, 1e3) ** BENT_STEEPNESS
    return chance


@kernel
def corner_scatter(look: Look, cells: int) -> tuple[float, float]:
    """Standard deviations (px) of a good corner, and of the share `WRONG` of the corners."""
    cell = look.narrow / cells
    sharp = CORE * (1.0 + _bend_seen(look.side))
    small = CORE_SMALL / (1.0 + (look.narrow / SMALL) ** SMALL_POWER)
    bent = CORE_BENT * cell * look.bend**CORE_BENT_POWER
    smeared = CORE_SMEARED * cell * look.smear**CORE_SMEARED_POWER
    if cell < PICTURE:
        smeared *= PICTURE_SMEARED
    least = sharp * sharp + small * small + bent * bent
    return math.sqrt(least + smeared * smeared), math.sqrt(least + (WRONG_TIMES * smeared) ** 2)


@kernel
def noise_told(look: Look, cells: int) -> float:
    """px, standard deviation of the corners that the detector tells with a marker, from the width of its edges."""
    width = math.sqrt(WIDTH**2 + WIDTH_BLURRED * look.blur**2)
    return expected_noise(width, look.narrow / cells)


@kernel
def _bend_seen(side: float) -> float:
    """Part of a side's bend that the detector fits; ``side`` in px."""
    return 1.0 - 1.0 / (1.0 + (side / BOW_SIDE) ** 4)


@kernel
def _bent(pixels: Vector, i: int) -> tuple[float, float]:
    """Length of side ``i`` and its sagitta to the left, as seen in the image; px (8, 2) as `bowed_corners`'."""
    j = (i + 1) % 4
    dx, dy = pixels[j, 0] - pixels[i, 0], pixels[j, 1] - pixels[i, 1]
    length = max(math.hypot(dx, dy), 1e-9)
    mx = pixels[4 + i, 0] - 0.5 * (pixels[i, 0] + pixels[j, 0])
    my = pixels[4 + i, 1] - 0.5 * (pixels[i, 1] + pixels[j, 1])
    return length, (mx * dy - my * dx) / length


@kernel
def bowed_corners(pixels: Vector, out: Vector) -> None:
    """Fill ``out`` (4, 2) with where lines fitted to the sides meet; ``pixels`` (8, 2) corners, then middles of sides.

    Side i goes from corner i to the next.
    """
    normals, shifts = np.empty((4, 2)), np.empty(4)
    for i in range(4):
        j = (i + 1) % 4
        length, sagitta = _bent(pixels, i)
        normals[i, 0] = (pixels[j, 1] - pixels[i, 1]) / length
        normals[i, 1] = (pixels[i, 0] - pixels[j, 0]) / length
        shifts[i] = BOW * sagitta * (1.0 - _bend_seen(length))
    for i in range(4):
        p, q = normals[i - 1], normals[i]
        determinant = p[0] * q[1] - p[1] * q[0]
        out[i, 0], out[i, 1] = pixels[i, 0], pixels[i, 1]
        if abs(determinant) > 0.05:
            out[i, 0] += (shifts[i - 1] * q[1] - shifts[i] * p[1]) / determinant
            out[i, 1] += (p[0] * shifts[i] - q[0] * shifts[i - 1]) / determinant
