"""The vehicle's motion: rigid body, rotors, air, ground and battery, advanced by one compiled function.

Rigid body with quaternion attitude, integrated by the classical Runge-Kutta method; rotor speeds follow their
setpoints with a first-order lag (solved exactly) and give thrust and reaction torque in proportion to their
square; rotor drag is linear in the body's velocity through the air (Faessler, Franchi, Scaramuzza, "Differential
flatness of quadrotor dynamics subject to rotor drag", RA-L 2018) and body drag quadratic. The origin of the body
lies between its four feet, straight below its rotors, so that it rests on the ground with z just below 0.
"""

import math

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import kernel
from sim import layout as at
from sim.rate_loop import PITCH_SIGNS, ROLL_SIGNS, YAW_SIGNS, rate_loop
from sim.wind import update_gust

Triple = tuple[float, float, float]
Quadruple = tuple[float, float, float, float]

FRICTION = 0.7
"""Coulomb friction of the feet."""
CREEP = 0.02
"""m/s, below which friction is viscous."""
STOPPED = 1e-3
"""rad/s, below which a rotor stands still: numbers that shrink for ever get slow."""


@kernel
def _turn(q0: float, q1: float, q2: float, q3: float, v: Triple) -> Triple:
    """``v`` turned by the unit quaternion; without an array, which this path cannot afford."""
    tx = 2.0 * (q2 * v[2] - q3 * v[1])
    ty = 2.0 * (q3 * v[0] - q1 * v[2])
    tz = 2.0 * (q1 * v[1] - q2 * v[0])
    return (
        v[0] + q0 * tx + q2 * tz - q3 * ty,
        v[1] + q0 * ty + q3 * tx - q1 * tz,
        v[2] + q0 * tz + q1 * ty - q2 * tx,
    )


@kernel
def _foot(S: Vector, x: int, P: Vector, i: int) -> tuple[Triple, Triple]:
    """Force and torque (body) of the ground on foot ``i``, a spring-damper with Coulomb friction."""
    q0, q1, q2, q3 = S[x + 3], S[x + 4], S[x + 5], S[x + 6]
    ax, ay = -PITCH_SIGNS[i] * P[at.P_ROTOR_X], ROLL_SIGNS[i] * P[at.P_ROTOR_Y]
    depth = -(S[x + 2] + _turn(q0, q1, q2, q3, (ax, ay, 0.0))[2])
    if depth <= 0.0:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    spin = _turn(q0, q1, q2, q3, (-S[x + 12] * ay, S[x + 12] * ax, S[x + 10] * ay - S[x + 11] * ax))
    vx, vy, vz = S[x + 7] + spin[0], S[x + 8] + spin[1], S[x + 9] + spin[2]
    normal = max(0.0, P[at.P_STIFFNESS] * depth - P[at.P_CONTACT_DAMPING] * vz)
    grip = FRICTION * normal / max(math.sqrt(vx * vx + vy * vy), CREEP)
    fx, fy, fz = _turn(q0, -q1, -q2, -q3, (-grip * vx, -grip * vy, normal))
    return (fx, fy, fz), (ay * fz, -ax * fz, ax * fy - ay * fx)


@kernel
def _ground(S: Vector, x: int, P: Vector) -> tuple[Triple, Triple]:
    """Force and torque (body) of the ground on the four feet."""
    fx = fy = fz = tx = ty = tz = 0.0
    for i in range(4):
        force, torque = _foot(S, x, P, i)
        fx, fy, fz = fx + force[0], fy + force[1], fz + force[2]
        tx, ty, tz = tx + torque[0], ty + torque[1], tz + torque[2]
    return (fx, fy, fz), (tx, ty, tz)


@kernel
def derivative(S: Vector, x: int, dx: int, wrench: Quadruple, wind: Triple, P: Vector) -> None:
    """Rates of the rigid body's state at ``S[x : x + 13]`` into ``S[dx : dx + 16]``, specific force last.

    ``wrench`` is the rotors' thrust along body z in N and their torque in N m; ``wind`` in m/s, world.
    """
    q0, q1, q2, q3, p, q, r = S[x + 3], S[x + 4], S[x + 5], S[x + 6], S[x + 10], S[x + 11], S[x + 12]
    r00, r01, r02 = 1.0 - 2.0 * (q2 * q2 + q3 * q3), 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2)
    r10, r11, r12 = 2.0 * (q1 * q2 + q0 * q3), 1.0 - 2.0 * (q1 * q1 + q3 * q3), 2.0 * (q2 * q3 - q0 * q1)
    r20, r21, r22 = 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    vx, vy, vz = S[x + 7] - wind[0], S[x + 8] - wind[1], S[x + 9] - wind[2]
    ax, ay, az = r00 * vx + r10 * vy + r20 * vz, r01 * vx + r11 * vy + r21 * vz, r02 * vx + r12 * vy + r22 * vz
    drag = P[at.P_QUADRATIC_DRAG] * math.sqrt(ax * ax + ay * ay + az * az)
    fx, fy = -(P[at.P_LINEAR_DRAG] + drag) * ax, -(P[at.P_LINEAR_DRAG + 1] + drag) * ay
    fz = wrench[0] - (P[at.P_LINEAR_DRAG + 2] + drag) * az
    c = P[at.P_DAMPING]
    tx, ty, tz = wrench[1] - c * p, wrench[2] - c * q, wrench[3] - c * r
    if S[x + 2] < P[at.P_ROTOR_X] + P[at.P_ROTOR_Y]:
        push, twist = _ground(S, x, P)
        fx, fy, fz = fx + push[0], fy + push[1], fz + push[2]
        tx, ty, tz = tx + twist[0], ty + twist[1], tz + twist[2]
    m = P[at.P_MASS_INVERSE]
    fx, fy, fz = m * fx, m * fy, m * fz
    Ix, Iy, Iz = P[at.P_INERTIA], P[at.P_INERTIA + 1], P[at.P_INERTIA + 2]
    S[dx], S[dx + 1], S[dx + 2] = S[x + 7], S[x + 8], S[x + 9]
    S[dx + 3] = -0.5 * (q1 * p + q2 * q + q3 * r)
    S[dx + 4] = 0.5 * (q0 * p + q2 * r - q3 * q)
    S[dx + 5] = 0.5 * (q0 * q - q1 * r + q3 * p)
    S[dx + 6] = 0.5 * (q0 * r + q1 * q - q2 * p)
    S[dx + 7] = r00 * fx + r01 * fy + r02 * fz
    S[dx + 8] = r10 * fx + r11 * fy + r12 * fz
    S[dx + 9] = r20 * fx + r21 * fy + r22 * fz - GRAVITY
    S[dx + 10] = (tx - (Iz - Iy) * q * r) * P[at.P_INERTIA_INVERSE]
    S[dx + 11] = (ty - (Ix - Iz) * r * p) * P[at.P_INERTIA_INVERSE + 1]
    S[dx + 12] = (tz - (Iy - Ix) * p * q) * P[at.P_INERTIA_INVERSE + 2]
    S[dx + 13], S[dx + 14], S[dx + 15] = fx, fy, fz


@kernel
def rotor_wrench(S: Vector, P: Vector) -> Quadruple:
    """Thrust in N and torque in N m (FLU) of the four rotors at their speeds in ``S``."""
    k = P[at.P_THRUST_COEFFICIENT]
    a, b = k * S[at.ROTORS] * S[at.ROTORS], k * S[at.ROTORS + 1] * S[at.ROTORS + 1]
    c, d = k * S[at.ROTORS + 2] * S[at.ROTORS + 2], k * S[at.ROTORS + 3] * S[at.ROTORS + 3]
    roll = ROLL_SIGNS[0] * a + ROLL_SIGNS[1] * b + ROLL_SIGNS[2] * c + ROLL_SIGNS[3] * d
    pitch = PITCH_SIGNS[0] * a + PITCH_SIGNS[1] * b + PITCH_SIGNS[2] * c + PITCH_SIGNS[3] * d
    yaw = YAW_SIGNS[0] * a + YAW_SIGNS[1] * b + YAW_SIGNS[2] * c + YAW_SIGNS[3] * d
    return a + b + c + d, P[at.P_ROTOR_Y] * roll, P[at.P_ROTOR_X] * pitch, P[at.P_TORQUE_RATIO] * yaw


@kernel
def _turn_rotors(S: Vector, P: Vector) -> None:
    """Move the rotors' speeds on by half a step towards what their signals ask for."""
    full = P[at.P_SPEED_MAX] * S[at.VOLTAGE] / P[at.P_RATED_VOLTAGE]
    f = P[at.P_MOTOR_CURVE]
    for i in range(4):
        u = S[at.SIGNALS + i]
        target = full * math.sqrt(u * (f * u + 1.0 - f))
        speed = S[at.ROTORS + i]
        decay = P[at.P_DECAY_UP] if target > speed else P[at.P_DECAY_DOWN]
        moved = target + (speed - target) * decay
        S[at.ROTORS + i] = moved if moved > STOPPED else 0.0


@kernel
def _drain_battery(S: Vector, P: Vector) -> None:
    """Take the charge of one period of the rate loop and set the voltage under load."""
    power = 0.0
    for i in range(4):
        power += (
            P[at.P_TORQUE_RATIO] * P[at.P_THRUST_COEFFICIENT] * S[at.ROTORS + i] * S[at.ROTORS + i] * S[at.ROTORS + i]
        )
    current = (power / P[at.P_EFFICIENCY] + P[at.P_AVIONICS]) / max(S[at.VOLTAGE], 1.0)
    S[at.CHARGE] = max(S[at.CHARGE] - current * P[at.P_LOOP_PERIOD] / P[at.P_CAPACITY], 0.0)
    place = 10.0 * S[at.CHARGE]
    i = min(int(place), 9)
    low, high = P[at.P_OPEN_CIRCUIT + i], P[at.P_OPEN_CIRCUIT + i + 1]
    S[at.VOLTAGE] = max(low + (place - i) * (high - low) - current * P[at.P_RESISTANCE], 0.0)


@kernel
def _take_commands(S: Vector, time: float) -> None:
    """Put the pending commands into force whose time has come."""
    while S[at.QUEUE_HEAD] < S[at.QUEUE_TAIL]:
        row = at.QUEUE + (int(S[at.QUEUE_HEAD]) % at.QUEUE_ROWS) * at.QUEUE_COLUMNS
        if S[row] > time:
            return
        for i in range(4):
            S[at.RATES + i] = S[row + 1 + i]
        S[at.MOTORS_ON] = 1.0
        S[at.QUEUE_HEAD] += 1.0


@kernel
def _integrate(S: Vector, P: Vector, wind: Triple) -> None:
    """One Runge-Kutta step of the rigid body; the rotors turn on by half a step twice meanwhile.

    The slopes and the states between stand in ``S`` itself: views of small arrays would cost more than the sums.
    """
    h = P[at.P_STEP]
    x, k1, k2, k3, k4 = at.TRIAL, at.SLOPES, at.SLOPES + 16, at.SLOPES + 32, at.SLOPES + 48
    derivative(S, 0, k1, rotor_wrench(S, P), wind, P)
    _turn_rotors(S, P)
    wrench = rotor_wrench(S, P)
    for i in range(13):
        S[x + i] = S[i] + 0.5 * h * S[k1 + i]
    derivative(S, x, k2, wrench, wind, P)
    for i in range(13):
        S[x + i] = S[i] + 0.5 * h * S[k2 + i]
    derivative(S, x, k3, wrench, wind, P)
    _turn_rotors(S, P)
    for i in range(13):
        S[x + i] = S[i] + h * S[k3 + i]
    derivative(S, x, k4, rotor_wrench(S, P), wind, P)
    for i in range(13):
        S[i] += h / 6.0 * (S[k1 + i] + 2.0 * (S[k2 + i] + S[k3 + i]) + S[k4 + i])
    scale = 1.0 / math.sqrt(S[3] * S[3] + S[4] * S[4] + S[5] * S[5] + S[6] * S[6])
    for i in range(3, 7):
        S[i] *= scale
    for i in range(at.FORCE, at.ROTORS):
        S[i] = S[k4 + i]


@kernel
def _blow(S: Vector, P: Vector, noise: Vector) -> Triple:
    """The wind (world) over the next step, after its gust has moved on."""
    if P[at.P_GUST] > 0.0:
        vx = S[at.VELOCITY] - P[at.P_WIND] - S[at.GUST]
        vy = S[at.VELOCITY + 1] - P[at.P_WIND + 1] - S[at.GUST + 1]
        vz = S[at.VELOCITY + 2] - P[at.P_WIND + 2] - S[at.GUST + 2]
        airspeed = math.sqrt(vx * vx + vy * vy + vz * vz)
        gust = S[at.GUST : at.GUST + 3]
        update_gust(gust, P[at.P_GUST], airspeed, S[2], noise[int(S[at.NOISE_ROW])], P[at.P_STEP])
        S[at.NOISE_ROW] += 1.0
    return P[at.P_WIND] + S[at.GUST], P[at.P_WIND + 1] + S[at.GUST + 1], P[at.P_WIND + 2] + S[at.GUST + 2]


@kernel
def advance(S: Vector, P: Vector, noise: Vector, trace: Vector, row: int, steps: int) -> None:
    """Make ``steps`` steps of vehicle and rate loop, in place.

    ``S`` and ``P`` are packed as `layout` says. ``noise`` (m, 3) is standard normal and is read from row
    ``S[NOISE_ROW]`` on where there are gusts; ``trace`` (k, 17) takes the state after each step from ``row`` on.
    """
    h = P[at.P_STEP]
    for i in range(steps):
        _take_commands(S, P[at.P_START] + S[at.STEPS] * h + 1e-9)
        S[at.PHASE] += h
        if S[at.PHASE] >= P[at.P_LOOP_PERIOD] - 1e-9:
            S[at.PHASE] -= P[at.P_LOOP_PERIOD]
            rate_loop(S, P)
            _drain_battery(S, P)
        _integrate(S, P, _blow(S, P, noise))
        S[at.CONTACT] = 1.0 if S[2] <= 0.0 else 0.0
        S[at.STEPS] += 1.0
        trace[row + i, 0] = P[at.P_START] + S[at.STEPS] * h
        for k in range(at.ROTORS):
            trace[row + i, 1 + k] = S[k]
