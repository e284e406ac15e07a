"""Where the camera looks along a trajectory: at the next gate, as fast as the heading may be turned.

A reference heading is followed with bounded rate and acceleration, so that a switch from one gate to the
next becomes a swift turn. Within one piece the angular acceleration is constant: the heading is continuous,
so is its rate, and the rate is greatest where pieces meet.
"""

import math

from flightapp.frames import Vector, wrap_angle
from flightapp.jit import inlined, lean_kernel

TURNING, FOLLOWING = 0.05, 0.2
"""s, one piece of the heading: while it turns to its reference, and once it moves with it."""
SETTLING = 4.0
"""s after the end of the trajectory within which the heading turns to its last reference."""
NEAR = 1.5
"""m before a gate at which to look at what comes after it: its plan is settled, and its markers leave the view."""
SOONEST, LATEST = 1.0, 0.3
"""s before a gate, bounds of that moment at low and at high speed."""
SLOW = 0.3
"""m/s of horizontal speed, or m of horizontal distance, below which no direction is told from it."""
GAIN = 6.0
"""1/s, at which a small error of heading is removed."""
SHARE = 0.5
"""Greatest part of an error that is to be removed within one piece."""
BRAKING = 0.7
"""Share of the angular acceleration that is counted on when stopping at the reference."""
ON_AIM, CENTRED = 0.05, 1e-3
"""rad of error below which the heading counts as following its reference, and below which it is left alone."""
SPARE = 8
"""Pieces beyond those that the duration, the settling and the gates account for."""


def most_pieces(duration: float, gates: int) -> int:
    """How many pieces `heading_pieces` may need for a trajectory of ``duration`` s through so many gates."""
    return math.ceil((duration + SETTLING) / TURNING) + gates + SPARE


@inlined
def _motion(coefficients: Vector, i: int, axis: int, s: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration of one axis, ``s`` into segment ``i``."""
    p = v = a = 0.0
    for k in range(coefficients.shape[2] - 1, -1, -1):
        a = a * s + 2.0 * v
        v = v * s + p
        p = p * s + coefficients[i, axis, k]
    return p, v, a


@inlined
def _switch(coefficients: Vector, i: int, s: float, passage: float) -> float:
    """When to look away from the gate that is passed at ``passage``, ``s`` into segment ``i``."""
    speed = 0.0
    for axis in range(3):
        _, v, _ = _motion(coefficients, i, axis, s)
        speed += v * v
    return passage - min(max(NEAR / max(math.sqrt(speed), 1e-3), LATEST), SOONEST)


@inlined
def _segment(knots: Vector, i: int, t: float) -> int:
    """The segment that holds ``t``, from segment ``i`` on."""
    while i < knots.size - 2 and t >= knots[i + 1]:
        i += 1
    return i


@inlined
def _reference(
    coefficients: Vector, i: int, s: float, ended: bool, aims: Vector, k: int, watch: Vector
) -> tuple[bool, float, float]:
    """Whether there is a direction to look in ``s`` into segment ``i``, its heading and that heading's rate.

    It is that of ``aims[k]``, behind the last of them that of ``watch``, and of the path where that is NaN. Once the
    trajectory has ``ended`` the vehicle rests.
    """
    px, vx, ax = _motion(coefficients, i, 0, s)
    py, vy, ay = _motion(coefficients, i, 1, s)
    if ended:
        vx = vy = ax = ay = 0.0
    if k < aims.shape[0]:
        x, y, dx, dy = aims[k, 0] - px, aims[k, 1] - py, -vx, -vy
    elif watch[0] == watch[0]:
        x, y, dx, dy = watch[0] - px, watch[1] - py, -vx, -vy
    else:
        x, y, dx, dy = vx, vy, ax, ay
    square = x * x + y * y
    if square < SLOW * SLOW:
        return False, 0.0, 0.0
    return True, math.atan2(y, x), (x * dy - y * dx) / square


@inlined
def _pursuit(
    yaw: float, yaw_rate: float, step: float, known: bool, aim: float, wanted: float, limits: Vector
) -> tuple[float, bool]:
    """The yaw rate after ``step`` s towards a reference at ``aim`` with rate ``wanted``; whether it moves with it."""
    rate_max, reach = limits[0], limits[1] * step
    calm = True
    if known:
        error = wrap_angle(aim - step * wanted - yaw)
        size = abs(error)
        calm = size < ON_AIM
        if size > CENTRED:
            gain = min(GAIN, SHARE / step)
            wanted += math.copysign(min(gain * size, math.sqrt(2.0 * BRAKING * limits[1] * size)), error)
    wanted = min(max(wanted, -rate_max), rate_max)
    if abs(wanted - yaw_rate) > reach:
        return yaw_rate + math.copysign(reach, wanted - yaw_rate), False
    return wanted, calm


@lean_kernel
def heading_pieces(
    knots: Vector,
    coefficients: Vector,
    start: Vector,
    aims: Vector,
    passages: Vector,
    watch: Vector,
    limits: Vector,
    places: Vector,
    pieces: Vector,
) -> int:
    """Fill ``places`` (m + 1,) s and ``pieces`` (m, 4) with a heading along a trajectory; returns m.

    ``start`` is its yaw and yaw rate; ``limits`` the greatest rate (rad/s) and acceleration (rad/s²), which it keeps
    exactly. It comes to rest with or after the trajectory (``knots`` (n + 1,), ``coefficients`` (n, 3, 8)). ``aims``
    (g, 3) are the gates, left behind at ``passages`` (g,) s; ``watch`` (3,) is looked at afterwards, the path where it
    is NaN. `most_pieces` says how many rows there must be.
    """
    yaw, yaw_rate = start[0], start[1]
    duration = knots[knots.size - 1]
    t, i, used, k = 0.0, 0, 0, -1
    passing, switch = 0, -1.0
    calm = False
    places[0] = 0.0
    while used < pieces.shape[0] - 2 and t < duration + SETTLING:
        while t >= switch - 1e-6:  # look at the next one
            k += 1
            calm = False
            switch = math.inf
            if k < aims.shape[0]:
                passing = _segment(knots, passing, passages[k])
                switch = _switch(coefficients, passing, passages[k] - knots[passing], passages[k])
        step = FOLLOWING if calm else TURNING
        stop = min(switch, duration if t < duration else duration + SETTLING)
        end = t + step if t + 1.5 * step < stop else stop
        step = end - t
        i = _segment(knots, i, end)
        s = min(end, duration) - knots[i]
        known, aim, wanted = _reference(coefficients, i, s, end >= duration, aims, k, watch)
        following, calm = _pursuit(yaw, yaw_rate, step, known, aim, wanted, limits)
        pieces[used, 0], pieces[used, 1], pieces[used, 2] = yaw, yaw_rate, 0.5 * (following - yaw_rate) / step
        pieces[used, 3] = 0.0
        yaw += 0.5 * step * (yaw_rate + following)
        yaw_rate, t, used = following, end, used + 1
        places[used] = t
        if t >= duration and yaw_rate == 0.0:
            return used
    return brake(yaw, yaw_rate, limits[1], t, used, places, pieces)


@lean_kernel
def brake(yaw: float, yaw_rate: float, acceleration: float, t: float, used: int, places: Vector, pieces: Vector) -> int:
    """Append to ``used`` pieces, which end at ``t``, one in which the heading comes to rest; returns their number."""
    if yaw_rate == 0.0:
        return used
    time = abs(yaw_rate) / acceleration
    pieces[used, 0], pieces[used, 1] = yaw, yaw_rate
    pieces[used, 2], pieces[used, 3] = -0.5 * yaw_rate / time, 0.0
    places[used + 1] = t + time
    return used + 1
