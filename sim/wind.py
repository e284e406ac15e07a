"""Gusts: low-altitude turbulence of MIL-F-8785C.

Each component is white noise through a first-order filter, whose correlation length and ratio of intensities
are those of MIL-F-8785C, section 3.7.3.4 (low-altitude model), for frozen turbulence that the vehicle flies
through. (The Dryden spectra of the two components across the flow have a further zero and pole, which this
leaves out; lengths and variances are the same.)
"""

import math

from flightapp.frames import Vector
from flightapp.jit import kernel

FOOT = 0.3048
HEIGHT_MIN = 10.0
HEIGHT_MAX = 1000.0
"""ft, validity of the low-altitude model; outside, its nearest value is used."""
SPEED_MIN = 1.0
"""m/s: eddies move past a vehicle that hovers in still air at about the speed of the gusts themselves."""


@kernel
def length_horizontal(height: float) -> float:
    """Correlation length of the horizontal gusts, m, ``height`` m above the ground."""
    h = min(max(height / FOOT, HEIGHT_MIN), HEIGHT_MAX)
    return float(FOOT * h / (0.177 + 0.000823 * h) ** 1.2)


@kernel
def length_vertical(height: float) -> float:
    """Correlation length of the vertical gusts, m, ``height`` m above the ground."""
    return FOOT * min(max(height / FOOT, HEIGHT_MIN), HEIGHT_MAX)


@kernel
def vertical_ratio(height: float) -> float:
    """Vertical over horizontal standard deviation, ``height`` m above the ground."""
    h = min(max(height / FOOT, HEIGHT_MIN), HEIGHT_MAX)
    return float((0.177 + 0.000823 * h) ** 0.4)


@kernel
def update_gust(gust: Vector, sigma: float, airspeed: float, height: float, noise: Vector, step: float) -> None:
    """Move ``gust`` (3,) m/s, world, on by ``step`` s.

    ``sigma`` m/s is the horizontal standard deviation and ``noise`` (3,) standard normal. The update is the
    exact discretisation of the filter, so the variance does not depend on the step.
    """
    speed = max(airspeed, SPEED_MIN)
    keep = math.exp(-step * speed / length_horizontal(height))
    spread = sigma * math.sqrt(1.0 - keep * keep)
    gust[0] = keep * gust[0] + spread * noise[0]
    gust[1] = keep * gust[1] + spread * noise[1]
    keep = math.exp(-step * speed / length_vertical(height))
    spread = sigma * vertical_ratio(height) * math.sqrt(1.0 - keep * keep)
    gust[2] = keep * gust[2] + spread * noise[2]
