"""What a contouring horizon costs: being off the line, lagging behind its progress, and not making progress.

The line is a path that is flown along at a rate of its own (D. Lam, C. Manzie and M. Good, "Model predictive contouring
control", 2010; A. Liniger, A. Domahidi and M. Morari, "Optimization-based autonomous racing of 1:43 scale RC cars",
2015; A. Romero, S. Sun, P. Foehn and D. Scaramuzza, "Model predictive contouring control for time-optimal quadrotor
flight", 2022). Errors are to the point that the progress has come to, and count by `mpc_cost`'s weights for bandwidths
that grow near gates; what of an error is along the line, the lag, counts more, so that the progress stays where the
vehicle is.
"""

from flightapp.control.mpc_cost import add_attitude_cost, attitude_cost, position_gains
from flightapp.control.parameters import Parameters
from flightapp.control.riccati import WIDE
from flightapp.frames import Vector
from flightapp.jit import fused

REFERENCE = 22
"""Numbers of a reference: the first 14 as `mpc_cost` has them, with the velocity at the line's own rate; acceleration
and time there, share of the bandwidths, and the line's direction."""
LAG = 3.0
"""Weight of an error along the line, beyond that of any other."""
TILT = 0.0
"""Share of the cost of a tilt other than the line needs: it needs another one as soon as the rate changes, so that this
would hold the rate as it is. Turning alone costs."""


@fused
def _target(x: Vector, r: Vector, axis: int) -> tuple[float, float, float, float]:
    """Position, velocity by the line's time, velocity at the rate, and its derivative by the line's time."""
    after = x[0] - r[17]
    v, a = r[3 + axis], r[14 + axis]
    slope = v + after * a
    return r[axis] + after * (v + 0.5 * after * a), slope, x[1] * slope, x[1] * a


@fused
def _stiff_gains(p: Parameters, r: Vector, axis: int) -> tuple[float, float]:
    kp, kd = position_gains(p, axis)
    return kp * r[18] * r[18], kd * r[18]


@fused
def _lag(x: Vector, r: Vector) -> tuple[float, float]:
    """Error along the line, and its derivative by the line's time."""
    lag = slope = 0.0
    for axis in range(3):
        place, by_time, _, _ = _target(x, r, axis)
        lag += r[19 + axis] * (x[2 + axis] - place)
        slope -= r[19 + axis] * by_time
    return lag, slope


@fused
def state_cost(p: Parameters, x: Vector, r: Vector, duration: float, last: bool) -> float:
    """Cost of being at ``x`` (16,) near ``r`` (REFERENCE,) for ``duration`` s, and at the end if ``last``."""
    total = end = 0.0
    for axis in range(3):
        kp, kd = _stiff_gains(p, r, axis)
        place, _, speed, _ = _target(x, r, axis)
        e, d = x[2 + axis] - place, x[5 + axis] - speed
        total += kp * kp * e * e + (kd * kd - 2.0 * kp) * d * d
        end += kp * kd * e * e + 2.0 * kp * e * d + kd * d * d
    lag, _ = _lag(x, r)
    total += LAG * p.kp_xy * p.kp_xy * lag * lag
    if last:
        total += end / duration
    return float(0.5 * duration * total + attitude_cost(p, x[2:], r, duration, last, TILT))


@fused
def add_state_cost(p: Parameters, x: Vector, r: Vector, duration: float, last: bool, value: Vector) -> None:
    """Add the second derivative of `state_cost` to the first 15 columns of ``value`` (15 WIDE,), the first to the next.

    The second derivative is Gauss and Newton's; what attitudes the line needs is taken for the same all around.
    """
    end = 1.0 if last else 0.0
    for axis in range(3):
        kp, kd = _stiff_gains(p, r, axis)
        place, by_time, speed, bend = _target(x, r, axis)
        e, d = x[2 + axis] - place, x[5 + axis] - speed
        pp = duration * kp * kp + end * kp * kd
        vv = duration * (kd * kd - 2.0 * kp) + end * kd
        pv = end * kp
        i, k = 2 + axis, 5 + axis
        by_e, by_d = pp * e + pv * d, pv * e + vv * d
        value[15] -= by_time * by_e + bend * by_d
        value[WIDE + 15] -= by_time * by_d
        value[i * WIDE + 15] += by_e
        value[k * WIDE + 15] += by_d
        value[i * WIDE + i] += pp
        value[k * WIDE + k] += vv
        _add_pair(value, i, k, pv)
        _add_pair(value, 0, i, -(by_time * pp + bend * pv))
        _add_pair(value, 0, k, -(by_time * pv + bend * vv))
        _add_pair(value, 1, i, -by_time * pv)
        _add_pair(value, 1, k, -by_time * vv)
        value[0] += by_time * by_time * pp + 2.0 * by_time * bend * pv + bend * bend * vv
        _add_pair(value, 0, 1, by_time * by_time * pv + by_time * bend * vv)
        value[WIDE + 1] += by_time * by_time * vv
    _add_lag(p, x, r, duration, value)
    add_attitude_cost(p, x[2:], r, duration, last, TILT, value[2 * WIDE + 2 :])


@fused
def _add_pair(value: Vector, i: int, k: int, weight: float) -> None:
    value[i * WIDE + k] += weight
    value[k * WIDE + i] += weight


@fused
def _add_lag(p: Parameters, x: Vector, r: Vector, duration: float, value: Vector) -> None:
    lag, slope = _lag(x, r)
    weight = LAG * duration * p.kp_xy * p.kp_xy
    value[0] += weight * slope * slope
    value[15] += weight * slope * lag
    for i in range(3):
        t = weight * r[19 + i]
        value[(2 + i) * WIDE + 15] += t * lag
        _add_pair(value, 0, 2 + i, t * slope)
        for k in range(3):
            value[(2 + i) * WIDE + 2 + k] += t * r[19 + k]
