"""Gusts: low-altitude turbulence of MIL-F-8785C.

Each component is white noise through a first-order filter, whose correlation length and ratio of intensities
are those of MIL-F-8785C, section 3.7.3.4 (low-altitude model), for frozen turbulence that the vehicle flies
through. (The Dryden spectra of the two components across the flow have a further zero and pole, which this
leaves out; lengths and variances are the same.)
"""

import math

from flightapp.jit import lean_kernel

Triple = tuple[float, float, float]

FOOT = 0.3048
HEIGHT_MIN = 10.0
HEIGHT_MAX = 1000.0
"""ft, validity of the low-altitude model; outside, its nearest value is used."""
SPEED_MIN = 1.0
"""m/s: eddies move past a vehicle that hovers in still air at about the speed of the gusts themselves."""


@lean_kernel
def length_horizontal(height: float) -> float:
    """Correlation length of the horizontal gusts, m, ``height`` m above the ground."""
    h = min(max(height / FOOT, HEIGHT_MIN), HEIGHT_MAX)
    return float(FOOT * h / (0.177 + 0.000823 * h) ** 1.2)


@lean_kernel
def length_vertical(height: float) -> float:
    """Correlation length of the vertical gusts, m, ``height`` m above the ground."""
    return FOOT * min(max(height / FOOT, HEIGHT_MIN), HEIGHT_MAX)


@lean_kernel
def vertical_ratio(height: float) -> float:
    """Vertical over horizontal standard deviation, ``height`` m above the ground."""
    h = min(max(height / FOOT, HEIGHT_MIN), HEIGHT_MAX)
    return float((0.177 + 0.000823 * h) ** 0.4)


@lean_kernel
def update_gust(gust: Triple, sigma: float, airspeed: float, height: float, noise: Triple, step: float) -> Triple:
    """``gust`` in m/s, world, moved on by ``step`` s.

    ``sigma`` m/s is the horizontal standard deviation and ``noise`` standard normal. The update is the exact
    discretisation of the filter, so the variance does not depend on the step.
    """
    speed = max(airspeed, SPEED_MIN)
    ratio = vertical_ratio(height)
    length = length_vertical(height)
    # The horizontal length is the vertical one over ratio³.
    keep = math.exp(-step * speed * ratio * ratio * ratio / length)
    spread = sigma * math.sqrt(1.0 - keep * keep)
    x, y = keep * gust[0] + spread * noise[0], keep * gust[1] + spread * noise[1]
    keep = math.exp(-step * speed / length)
    return x, y, keep * gust[2] + sigma * ratio * math.sqrt(1.0 - keep * keep) * noise[2]
