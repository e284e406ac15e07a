"""Where the vehicle will be when a command takes effect.

The newest state is as old as its capture, and a command sent now acts `delay` later. What happens in
between is already decided by the commands sent before, so it is computed from them: body rates and
thrust follow their commands with first-order lags, and the body moves under thrust, linear drag and
gravity (the Smith predictor of O. J. Smith, 1957, for a nonlinear vehicle).
"""

import math

from flightapp.control.parameters import Parameters
from flightapp.control.vectors import Quaternion, Triple, along, axes, dot, turned
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import kernel

HISTORY = 128
"""Commands remembered: half a second at 250 Hz. A power of two, so that a ring index is a mask away."""
MASK = HISTORY - 1
ENTRY = 6
"""Numbers per command: stamp of effect, three rates, thrust, and the thrust that acted at that stamp."""
STEP = 0.01
"""s, longest step."""

Motion = tuple[Triple, Triple, Quaternion, Triple, float]
"""Position, velocity (world), q_wb, body rates, specific thrust."""


@kernel
def remainder(duration: float, lag: float) -> float:
    """The share of a difference that a first-order lag leaves after ``duration``."""
    return math.exp(-duration / lag) if lag > 1e-4 else 0.0


@kernel
def lagged(value: float, command: float, left: float) -> float:
    """What a first-order lag makes of ``value`` at a constant ``command`` while ``left`` remains of the difference."""
    return command + (value - command) * left


@kernel
def acceleration(p: Parameters, q: Quaternion, velocity: Triple, thrust: float) -> Triple:
    """Acceleration (world, m/s²) under ``thrust`` (m/s²) along body z, linear body drag and gravity."""
    x, y, z = axes(q)
    a = along((0.0, 0.0, -GRAVITY), thrust - p.drag_z * dot(z, velocity), z)
    a = along(a, -p.drag_x * dot(x, velocity), x)
    return along(a, -p.drag_y * dot(y, velocity), y)


@kernel
def _advance(p: Parameters, motion: Motion, rates: Triple, thrust: float, duration: float) -> Motion:
    """``motion`` after ``duration`` under a constant command, by the midpoint rule."""
    position, velocity, q, w, f = motion
    left = remainder(duration, p.rate_lag)
    w1 = (
        lagged(w[0], rates[0], left),
        lagged(w[1], rates[1], left),
        lagged(w[2], rates[2], remainder(duration, p.yaw_rate_lag)),
    )
    f1 = lagged(f, thrust, remainder(duration, p.motor_lag))
    mean = (0.5 * (w[0] + w1[0]), 0.5 * (w[1] + w1[1]), 0.5 * (w[2] + w1[2]))
    middle = turned(q, mean, 0.5 * duration)
    a = acceleration(p, middle, velocity, 0.5 * (f + f1))
    moved = along(along(position, duration, velocity), 0.5 * duration * duration, a)
    return moved, along(velocity, duration, a), turned(middle, mean, 0.5 * duration), w1, f1


@kernel
def predict(p: Parameters, motion: Motion, start: float, end: float, history: Vector, count: int) -> Motion:
    """``motion`` at ``start`` carried on to ``end`` by the newest of ``count`` commands in ``history``.

    ``history`` (HISTORY, ENTRY) is a ring in order of stamps. The thrust in ``motion`` is replaced by the
    one that the commands explain; without any command rates and thrust stay as they are.
    """
    position, velocity, q, w, f = motion
    first = max(count - HISTORY, 0)
    k = count - 1
    while k > first and history[k & MASK, 0] > start:
        k -= 1
    if k >= 0:
        i = k & MASK
        f = lagged(history[i, 5], history[i, 4], remainder(max(start - history[i, 0], 0.0), p.motor_lag))
    result = (position, velocity, q, w, f)
    rates, thrust = w, f
    now = start
    while now < end:
        while k < count - 1 and history[(k + 1) & MASK, 0] <= now:
            k += 1
        until = min(end, now + STEP)
        if k >= 0:
            i = k & MASK
            rates, thrust = (history[i, 1], history[i, 2], history[i, 3]), history[i, 4]
            if k < count - 1:
                until = min(until, history[(k + 1) & MASK, 0])
        result = _advance(p, result, rates, thrust, until - now)
        now = until
    return result
