"""Where the camera looks along a trajectory: at the next gate, as fast as the heading may be turned.

A reference heading is followed with bounded rate and acceleration, so that a switch from one gate to the
next becomes a swift turn. Within one piece the angular acceleration is constant: the heading is continuous,
so is its rate, and the rate is greatest where pieces meet.
"""

import math

import numpy as np

from flightapp.frames import Vector, wrap_angle
from flightapp.jit import kernel
from flightapp.trajectory import evaluate

PIECE = 0.05
"""s, one piece of the heading."""
SETTLING = 4.0
"""s after the end of the trajectory within which the heading comes to rest."""
NEAR = 1.5
"""m from a gate at which to look at what comes after it."""
SLOW = 0.3
"""m/s of horizontal speed, or m of horizontal distance, below which no direction is told from it."""
GAIN = 6.0
"""1/s, at which a small error of heading is removed."""
BRAKING = 0.7
"""Share of the angular acceleration that is counted on when stopping at the reference."""


@kernel
def _reference(row: Vector, t: float, aims: Vector, passages: Vector, watch: Vector) -> tuple[bool, float, float]:
    """Whether there is a direction to look in at time ``t``, its heading and that heading's rate.

    ``row`` (17,) is the motion; ``aims`` (m, 3) the gates, left behind at ``passages`` (m,); ``watch`` (3,)
    is looked at afterwards, the path where it is NaN.
    """
    x, y, dx, dy = row[3], row[4], row[6], row[7]
    for k in range(aims.shape[0] + 1):
        last = k == aims.shape[0]
        if last and math.isnan(watch[0]):
            break
        target = watch if last else aims[k]
        if not last:
            gap = (target[0] - row[0]) ** 2 + (target[1] - row[1]) ** 2 + (target[2] - row[2]) ** 2
            if t >= passages[k] or (k + 1 < aims.shape[0] and gap < NEAR * NEAR and t > passages[k] - 1.0):
                continue
        x, y, dx, dy = target[0] - row[0], target[1] - row[1], -row[3], -row[4]
        break
    square = x * x + y * y
    if square < SLOW * SLOW:
        return False, 0.0, 0.0
    return True, math.atan2(y, x), (x * dy - y * dx) / square


@kernel
def heading_pieces(
    knots: Vector,
    coefficients: Vector,
    yaw: float,
    yaw_rate: float,
    aims: Vector,
    passages: Vector,
    watch: Vector,
    rate_max: float,
    acceleration: float,
) -> tuple[Vector, Vector, int]:
    """Knots (≥ m + 1,), coefficients (≥ m, 4) and m of a heading that starts with ``yaw`` and ``yaw_rate``.

    It keeps to ``rate_max`` (rad/s) and ``acceleration`` (rad/s²), and comes to rest with or after the
    trajectory (``knots``, ``coefficients``). For the other arguments see `_reference`.
    """
    duration = knots[-1]
    moving = max(1, math.ceil(duration / PIECE))
    step = duration / moving
    most = moving + math.ceil(SETTLING / step)
    places, pieces = np.empty(most + 1), np.zeros((most, 4))
    still, rest = np.zeros(2), np.zeros((1, 4))
    still[1] = duration
    row = np.empty(17)
    places[0] = 0.0
    used = most
    for i in range(most):
        t = (i + 1) * step
        evaluate(knots, coefficients, still, rest, min(t, duration), row)
        known, aim, wanted = _reference(row, t, aims, passages, watch)
        if known:
            error = wrap_angle(aim - step * wanted - yaw)
            catch_up = min(GAIN * abs(error), math.sqrt(2.0 * BRAKING * acceleration * abs(error)))
            wanted += math.copysign(catch_up, error) if abs(error) > 1e-4 else 0.0
        wanted = min(max(wanted, -rate_max), rate_max)
        change = min(max(wanted - yaw_rate, -acceleration * step), acceleration * step)
        following = wanted if change == wanted - yaw_rate else yaw_rate + change
        places[i + 1] = t
        pieces[i, 0], pieces[i, 1], pieces[i, 2] = yaw, yaw_rate, 0.5 * (following - yaw_rate) / step
        yaw += 0.5 * step * (yaw_rate + following)
        yaw_rate = following
        if i + 1 >= moving and yaw_rate == 0.0:
            used = i + 1
            break
    return places, pieces, used
