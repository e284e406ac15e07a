"""PX4's body-rate loop and control allocation, as a model in FLU axes.

PID on filtered rates, D on the filtered derivative of the measured rates, anti-windup from the allocation's
saturation, and an integral that fades with large errors: PX4 user guide, "Multicopter controller diagrams" and
"MC filter tuning"; firmware modules mc_rate_control and control_allocation (sequential desaturation with
MC_AIRMODE = 0: roll and pitch may lower the collective thrust but never raise it, yaw comes last).

Rotors in PX4's order: front right, rear left (both counter-clockwise), front left, rear right.
"""

import math

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
from sim import layout as at

Quadruple = tuple[float, float, float, float]

ROLL_SIGNS = (-1.0, 1.0, 1.0, -1.0)
PITCH_SIGNS = (-1.0, 1.0, -1.0, 1.0)
YAW_SIGNS = (-1.0, -1.0, 1.0, 1.0)
"""Signs of each rotor's torque about body x, y and z (FLU) for positive thrust."""
FADE_INVERSE = 1.0 / math.radians(400.0)
"""s/rad, inverse of the error at which the integral stops growing."""
YAW_MARGIN = 0.15
"""Share of the range by which yaw may overdrive the motors before thrust is lowered for it."""


@inlined
def _desaturating_gain(S: Vector, column: Quadruple, top: float) -> float:
    """Multiple of ``column`` to add to the signals that balances what is below 0 and above ``top``."""
    low = high = 0.0
    for i in range(4):
        if abs(column[i]) < 0.2:
            continue
        u = S[at.SIGNALS + i]
        k = (min(max(u, 0.0), top) - u) / column[i]
        low = min(low, k)
        high = max(high, k)
    return low + high


@inlined
def _add(S: Vector, gain: float, column: Quadruple) -> None:
    """Add ``gain`` times ``column`` to the signals."""
    for i in range(4):
        S[at.SIGNALS + i] += gain * column[i]


@inlined
def _desaturate(S: Vector, column: Quadruple, top: float, reduce_only: bool) -> None:
    """Move the signals along ``column`` towards [0, ``top``], in a full and a half step."""
    gain = _desaturating_gain(S, column, top)
    if reduce_only and gain > 0.0:
        return
    _add(S, gain, column)
    gain = _desaturating_gain(S, column, top)
    if not (reduce_only and gain > 0.0):
        _add(S, 0.5 * gain, column)


@lean_kernel
def allocate(S: Vector, P: Vector) -> None:
    """Thrusts 0..1 of the four rotors into ``S[SIGNALS]`` for the torque ``S[TORQUE]`` and collective ``S[THRUST]``."""
    a, b, c = P[at.P_MIX_ROLL] * S[at.TORQUE], P[at.P_MIX_PITCH] * S[at.TORQUE + 1], S[at.TORQUE + 2]
    reach, thrust, k = abs(a) + abs(b) + abs(c), S[at.THRUST], at.SIGNALS
    if thrust >= reach and thrust + reach <= 1.0:
        S[k], S[k + 1], S[k + 2], S[k + 3] = (
            thrust - a - b - c,
            thrust + a + b - c,
            thrust + a - b + c,
            thrust - a + b + c,
        )
        return
    S[k], S[k + 1], S[k + 2], S[k + 3] = thrust - a - b, thrust + a + b, thrust + a - b, thrust - a + b
    _allocate_saturated(S, c, P[at.P_MIX_ROLL], P[at.P_MIX_PITCH])


@inlined
def _allocate_saturated(S: Vector, yaw: float, mix_roll: float, mix_pitch: float) -> None:
    """Fit the signals, which have all but the yaw torque, into 0..1 and add as much of ``yaw`` as there is room for."""
    lift = (1.0, 1.0, 1.0, 1.0)
    roll = (mix_roll * ROLL_SIGNS[0], mix_roll * ROLL_SIGNS[1], mix_roll * ROLL_SIGNS[2], mix_roll * ROLL_SIGNS[3])
    a, b, c, d = PITCH_SIGNS
    _desaturate(S, lift, 1.0, True)
    _desaturate(S, roll, 1.0, False)
    _desaturate(S, (mix_pitch * a, mix_pitch * b, mix_pitch * c, mix_pitch * d), 1.0, False)
    _add(S, yaw, YAW_SIGNS)
    _desaturate(S, YAW_SIGNS, 1.0 + YAW_MARGIN, False)
    _desaturate(S, lift, 1.0, True)
    for i in range(at.SIGNALS, at.SIGNALS + 4):
        S[i] = min(max(S[i], 0.0), 1.0)


@inlined
def _shortfall(wanted: float, got: float) -> float:
    """Sign of the torque that could not be allocated, 0 where all was."""
    lacking = wanted - got
    if abs(lacking) < 1e-6:
        return 0.0
    return math.copysign(1.0, lacking)


@inlined
def _filter_gyro(S: Vector, P: Vector, axis: int) -> float:
    """The low-passed rate about ``axis``; also updates the filtered angular acceleration."""
    k, d = at.P_GYRO_FILTER, at.GYRO_DELAY + 2 * axis
    fresh = S[at.OMEGA + axis] - P[k + 3] * S[d] - P[k + 4] * S[d + 1]
    rate = P[k] * fresh + P[k + 1] * S[d] + P[k + 2] * S[d + 1]
    S[d + 1] = S[d]
    S[d] = fresh
    raw = (rate - S[at.GYRO + axis]) * P[at.P_LOOP_RATE]
    S[at.ACCELERATION + axis] += P[at.P_ACCELERATION_ALPHA] * (raw - S[at.ACCELERATION + axis])
    S[at.GYRO + axis] = rate
    return float(rate)


@inlined
def _torque(S: Vector, P: Vector, axis: int) -> float:
    """PID about ``axis``; the integral rests on the ground, as PX4's does while landed."""
    error = S[at.RATES + axis] - _filter_gyro(S, P, axis)
    integral = S[at.INTEGRAL + axis]
    torque = P[at.P_GAIN_P + axis] * error + integral - P[at.P_GAIN_D + axis] * S[at.ACCELERATION + axis]
    if S[at.CONTACT] == 0.0 and S[at.SATURATED + axis] * error <= 0.0:
        fading = max(0.0, 1.0 - (error * FADE_INVERSE) ** 2)
        integral += fading * P[at.P_GAIN_I + axis] * error * P[at.P_LOOP_PERIOD]
        limit = P[at.P_INTEGRAL_LIMIT + axis]
        S[at.INTEGRAL + axis] = min(max(integral, -limit), limit)
    return float(torque)


@inlined
def _note_saturation(S: Vector, P: Vector) -> None:
    """Note for each axis the sign of the torque in ``S[TORQUE]`` that ``S[SIGNALS]`` leave undone."""
    a, b, c, d = S[at.SIGNALS], S[at.SIGNALS + 1], S[at.SIGNALS + 2], S[at.SIGNALS + 3]
    S[at.SATURATED] = _shortfall(4.0 * P[at.P_MIX_ROLL] * S[at.TORQUE], b + c - a - d)
    S[at.SATURATED + 1] = _shortfall(4.0 * P[at.P_MIX_PITCH] * S[at.TORQUE + 1], b + d - a - c)
    S[at.SATURATED + 2] = _shortfall(4.0 * S[at.TORQUE + 2], c + d - a - b)


@inlined
def _rest(S: Vector) -> None:
    """Motors off: no signals, and nothing remembered of the flight."""
    for i in range(4):
        S[at.SIGNALS + i] = 0.0
    for i in range(3):
        S[at.INTEGRAL + i] = 0.0
    S[at.TORQUE + 2] = 0.0


@inlined
def rate_loop(S: Vector, P: Vector) -> None:
    """One run of the loop: from the rates and the setpoint in ``S`` to motor signals 0..1 (see `layout`)."""
    S[at.TORQUE] = _torque(S, P, 0)
    S[at.TORQUE + 1] = _torque(S, P, 1)
    S[at.TORQUE + 2] += P[at.P_YAW_ALPHA] * (_torque(S, P, 2) - S[at.TORQUE + 2])
    if S[at.MOTORS_ON] == 0.0:
        _rest(S)
        return
    allocate(S, P)
    _note_saturation(S, P)
    f = P[at.P_THRUST_CURVE]
    if f > 0.0:
        offset, scale = f - 1.0, 0.5 / f
        for i in range(at.SIGNALS, at.SIGNALS + 4):
            S[i] = scale * (offset + math.sqrt(offset * offset + 4.0 * f * S[i]))
