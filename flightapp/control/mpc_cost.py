"""What a horizon costs: being off the reference, and the effort of getting back to it.

The weights are those for which a linear-quadratic regulator of the position, without lags and limits, has the
bandwidths and the damping of the configuration: with an acceleration of weight 1, gains ω² and 2ζω are optimal for
weights ω⁴ of the position and (2ζω)² - 2ω² of the velocity (R. E. Kalman, "When is a linear control system optimal?",
1964), and what remains after the horizon costs what that regulator would pay. A tilt and a body rate count as
the acceleration that they make at the reference's thrust.
"""

import math

from flightapp.control.parameters import Parameters
from flightapp.control.riccati import WIDE
from flightapp.control.vectors import Triple, axes, dot
from flightapp.frames import GRAVITY, Vector
from flightapp.jit import fused

REFERENCE = 14
"""Numbers of a reference: position, velocity, thrust axis, heading axis (world), thrust (m/s²), heading's weight."""
WEAKEST = 0.5 * GRAVITY
"""m/s², a tilt counts as at no weaker thrust than this."""
HEADING = 0.1 * GRAVITY**2
"""m²/s⁴, weight of the heading: little beside the tilt's, so that it never bends the path."""
TILT_LIMIT = 2e4 * GRAVITY**2
"""m²/s⁴, weight of tilt beyond its limit."""


@fused
def lean(r: Vector) -> float:
    """m/s², the acceleration that a tilt of 1 rad makes."""
    return float(max(r[12], WEAKEST))


@fused
def input_weights(p: Parameters, r: Vector) -> tuple[float, float, float]:
    """Weights of roll and pitch rate, yaw rate, and thrust, off the reference ``r``."""
    turn = lean(r) / p.attitude_gain
    return turn * turn, HEADING / (p.yaw_gain * p.yaw_gain), 1.0


@fused
def input_cost(p: Parameters, r: Vector, wanted: Vector, u: Vector) -> float:
    """Cost per second of an input ``u`` other than ``wanted`` (4,), on the way to the reference ``r``."""
    turn, yaw, lift = input_weights(p, r)
    a, b, c, d = u[0] - wanted[0], u[1] - wanted[1], u[2] - wanted[2], u[3] - wanted[3]
    return float(0.5 * (turn * (a * a + b * b) + yaw * c * c + lift * d * d))


@fused
def _tilt_cosine(p: Parameters) -> float:
    return p.tilt_cotangent / math.sqrt(1.0 + p.tilt_cotangent * p.tilt_cotangent)


@fused
def position_gains(p: Parameters, axis: int) -> tuple[float, float]:
    """Gains of position and velocity along a world ``axis``, 1/s² and 1/s."""
    return (p.kp_z, p.kd_z) if axis == 2 else (p.kp_xy, p.kd_xy)


@fused
def _errors(x: Vector, r: Vector, axis: int) -> tuple[float, float]:
    return x[axis] - r[axis], x[3 + axis] - r[3 + axis]


@fused
def attitude_cost(p: Parameters, x: Vector, r: Vector, duration: float, last: bool, effort: float) -> float:
    """What of `state_cost` is that of heading and a share ``effort`` of that of the tilt."""
    bx, _, bz = axes((x[6], x[7], x[8], x[9]))
    turn = lean(r)
    tilt = 2.0 * effort * turn * turn * (1.0 - dot(bz, (r[6], r[7], r[8])))
    heading = 2.0 * HEADING * r[13] * (1.0 - dot(bx, (r[9], r[10], r[11])))
    beyond = max(_tilt_cosine(p) - bz[2], 0.0)
    total = tilt + heading + TILT_LIMIT * beyond * beyond
    if last:
        total += (tilt / p.attitude_gain + heading / p.yaw_gain) / duration
    return float(0.5 * duration * total)


@fused
def state_cost(p: Parameters, x: Vector, r: Vector, duration: float, last: bool) -> float:
    """Cost of being at ``x`` (14,) rather than at ``r`` (REFERENCE,) for ``duration`` s, and at the end if ``last``."""
    total = end = 0.0
    for axis in range(3):
        kp, kd = position_gains(p, axis)
        e, d = _errors(x, r, axis)
        total += kp * kp * e * e + (kd * kd - 2.0 * kp) * d * d
        end += kp * kd * e * e + 2.0 * kp * e * d + kd * d * d
    if last:
        total += end / duration
    return float(0.5 * duration * total + attitude_cost(p, x, r, duration, last, 1.0))


@fused
def _seen(body: tuple[Triple, Triple, Triple], r: Vector, first: int) -> Triple:
    """The reference's axis that begins at ``first``, in the body's axes."""
    axis = (r[first], r[first + 1], r[first + 2])
    return dot(body[0], axis), dot(body[1], axis), dot(body[2], axis)


@fused
def add_state_cost(p: Parameters, x: Vector, r: Vector, duration: float, last: bool, value: Vector) -> None:
    """Add the second derivative of `state_cost` to the first 13 columns of ``value`` (13 WIDE,), the first to the next.

    The second derivative is Gauss and Newton's: of residuals that are squared, the first derivatives alone.
    """
    end = 1.0 if last else 0.0
    for axis in range(3):
        kp, kd = position_gains(p, axis)
        e, d = _errors(x, r, axis)
        pp = duration * kp * kp + end * kp * kd
        vv = duration * (kd * kd - 2.0 * kp) + end * kd
        i, k = axis, 3 + axis
        value[i * WIDE + i] += pp
        value[k * WIDE + k] += vv
        value[i * WIDE + k] += end * kp
        value[k * WIDE + i] += end * kp
        value[i * WIDE + 13] += pp * e + end * kp * d
        value[k * WIDE + 13] += vv * d + end * kp * e
    add_attitude_cost(p, x, r, duration, last, 1.0, value)


@fused
def add_attitude_cost(
    p: Parameters, x: Vector, r: Vector, duration: float, last: bool, effort: float, value: Vector
) -> None:
    """What of `add_state_cost` is that of heading and a share ``effort`` of that of the tilt."""
    end = 1.0 if last else 0.0
    body = axes((x[6], x[7], x[8], x[9]))
    z, h = _seen(body, r, 6), _seen(body, r, 9)
    turn = lean(r)
    tilt = effort * turn * turn * (duration + end / p.attitude_gain)
    heading = HEADING * r[13] * (duration + end / p.yaw_gain)
    value[6 * WIDE + 6] += tilt
    value[7 * WIDE + 7] += tilt + heading
    value[8 * WIDE + 8] += heading
    value[6 * WIDE + 13] += tilt * z[1]
    value[7 * WIDE + 13] += heading * h[2] - tilt * z[0]
    value[8 * WIDE + 13] -= heading * h[1]
    beyond = _tilt_cosine(p) - body[2][2]
    if beyond > 0.0:
        a, b = body[1][2], -body[0][2]
        limit = duration * TILT_LIMIT
        value[6 * WIDE + 6] += limit * a * a
        value[6 * WIDE + 7] += limit * a * b
        value[7 * WIDE + 6] += limit * a * b
        value[7 * WIDE + 7] += limit * b * b
        value[6 * WIDE + 13] += limit * beyond * a
        value[7 * WIDE + 13] += limit * beyond * b
