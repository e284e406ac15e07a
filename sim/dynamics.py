"""The vehicle's motion: rigid body, rotors, air, ground and battery, advanced by one compiled function.

Rigid body with quaternion attitude, integrated by the classical Runge-Kutta method; rotor speeds follow their
setpoints with a first-order lag (solved exactly) and give thrust and reaction torque in proportion to their
square; rotor drag is linear in the body's velocity through the air (Faessler, Franchi, Scaramuzza, "Differential
flatness of quadrotor dynamics subject to rotor drag", RA-L 2018) and body drag quadratic. The origin of the body
lies between its four feet, straight below its rotors, so that it rests on the ground with z just below 0.

Between two steps everything stands in the packed state; within a step the rigid body is a tuple, which the compiler
keeps in registers.
"""

import math

from flightapp.frames import GRAVITY, Vector
from flightapp.jit import inlined, lean_kernel
from sim import layout as at
from sim.rate_loop import PITCH_SIGNS, ROLL_SIGNS, YAW_SIGNS, Quadruple, rate_loop
from sim.wind import Triple, update_gust

Body = tuple[float, ...]
"""13 numbers: position, q_wb, velocity (world), angular velocity (body); its slope has specific force behind."""

FRICTION = 0.7
"""Coulomb friction of the feet."""
CREEP = 0.02
"""m/s, below which friction is viscous."""
STOPPED = 1e-3
"""rad/s, below which a rotor stands still: numbers that shrink for ever get slow."""


@inlined
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


@inlined
def _foot(x: Body, P: Vector, i: int) -> tuple[Triple, Triple]:
    """Force and torque (body) of the ground on foot ``i``, a spring-damper with Coulomb friction."""
    q0, q1, q2, q3 = x[3], x[4], x[5], x[6]
    ax, ay = -PITCH_SIGNS[i] * P[at.P_ROTOR_X], ROLL_SIGNS[i] * P[at.P_ROTOR_Y]
    depth = -(x[2] + _turn(q0, q1, q2, q3, (ax, ay, 0.0))[2])
    if depth <= 0.0:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    spin = _turn(q0, q1, q2, q3, (-x[12] * ay, x[12] * ax, x[10] * ay - x[11] * ax))
    vx, vy, vz = x[7] + spin[0], x[8] + spin[1], x[9] + spin[2]
    normal = max(0.0, P[at.P_STIFFNESS] * depth - P[at.P_CONTACT_DAMPING] * vz)
    grip = FRICTION * normal / max(math.sqrt(vx * vx + vy * vy), CREEP)
    fx, fy, fz = _turn(q0, -q1, -q2, -q3, (-grip * vx, -grip * vy, normal))
    return (fx, fy, fz), (ay * fz, -ax * fz, ax * fy - ay * fx)


@inlined
def _ground(x: Body, P: Vector) -> tuple[Triple, Triple]:
    """Force and torque (body) of the ground on the four feet."""
    fx = fy = fz = tx = ty = tz = 0.0
    for i in range(4):
        force, torque = _foot(x, P, i)
        fx, fy, fz = fx + force[0], fy + force[1], fz + force[2]
        tx, ty, tz = tx + torque[0], ty + torque[1], tz + torque[2]
    return (fx, fy, fz), (tx, ty, tz)


@inlined
def _slope(x: Body, wrench: Quadruple, wind: Triple, P: Vector) -> Body:
    """Rates of the body ``x``, and its specific force.

    ``wrench`` is the rotors' thrust along body z in N and their torque in N m; ``wind`` in m/s, world.
    """
    _, _, z, q0, q1, q2, q3, u, v, w, p, q, r = x
    r00, r01, r02 = 1.0 - 2.0 * (q2 * q2 + q3 * q3), 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2)
    r10, r11, r12 = 2.0 * (q1 * q2 + q0 * q3), 1.0 - 2.0 * (q1 * q1 + q3 * q3), 2.0 * (q2 * q3 - q0 * q1)
    r20, r21, r22 = 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    vx, vy, vz = u - wind[0], v - wind[1], w - wind[2]
    ax, ay, az = r00 * vx + r10 * vy + r20 * vz, r01 * vx + r11 * vy + r21 * vz, r02 * vx + r12 * vy + r22 * vz
    drag = P[at.P_QUADRATIC_DRAG] * math.sqrt(ax * ax + ay * ay + az * az)
    fx, fy = -(P[at.P_LINEAR_DRAG] + drag) * ax, -(P[at.P_LINEAR_DRAG + 1] + drag) * ay
    fz = wrench[0] - (P[at.P_LINEAR_DRAG + 2] + drag) * az
    c = P[at.P_DAMPING]
    tx, ty, tz = wrench[1] - c * p, wrench[2] - c * q, wrench[3] - c * r
    if z < P[at.P_ROTOR_X] + P[at.P_ROTOR_Y]:
        push, twist = _ground(x, P)
        fx, fy, fz = fx + push[0], fy + push[1], fz + push[2]
        tx, ty, tz = tx + twist[0], ty + twist[1], tz + twist[2]
    m = P[at.P_MASS_INVERSE]
    fx, fy, fz = m * fx, m * fy, m * fz
    Ix, Iy, Iz = P[at.P_INERTIA], P[at.P_INERTIA + 1], P[at.P_INERTIA + 2]
    q0_rate, q1_rate = -0.5 * (q1 * p + q2 * q + q3 * r), 0.5 * (q0 * p + q2 * r - q3 * q)
    q2_rate, q3_rate = 0.5 * (q0 * q - q1 * r + q3 * p), 0.5 * (q0 * r + q1 * q - q2 * p)
    u_rate, v_rate = r00 * fx + r01 * fy + r02 * fz, r10 * fx + r11 * fy + r12 * fz
    w_rate = r20 * fx + r21 * fy + r22 * fz - GRAVITY
    p_rate = (tx - (Iz - Iy) * q * r) * P[at.P_INERTIA_INVERSE]
    q_rate = (ty - (Ix - Iz) * r * p) * P[at.P_INERTIA_INVERSE + 1]
    r_rate = (tz - (Iy - Ix) * p * q) * P[at.P_INERTIA_INVERSE + 2]
    rates = (u, v, w, q0_rate, q1_rate, q2_rate, q3_rate, u_rate, v_rate, w_rate, p_rate, q_rate, r_rate)
    return (*rates, fx, fy, fz)


@inlined
def _moved(x: Body, k: Body, h: float) -> Body:
    """``x`` after ``h`` s at the slope ``k``."""
    position = (x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2])
    quaternion = (x[3] + h * k[3], x[4] + h * k[4], x[5] + h * k[5], x[6] + h * k[6])
    velocity = (x[7] + h * k[7], x[8] + h * k[8], x[9] + h * k[9])
    return (*position, *quaternion, *velocity, x[10] + h * k[10], x[11] + h * k[11], x[12] + h * k[12])


@inlined
def _wrench(speeds: Quadruple, P: Vector) -> Quadruple:
    """Thrust in N and torque in N m (FLU) of the four rotors at their ``speeds`` in rad/s."""
    k = P[at.P_THRUST_COEFFICIENT]
    a, b = k * speeds[0] * speeds[0], k * speeds[1] * speeds[1]
    c, d = k * speeds[2] * speeds[2], k * speeds[3] * speeds[3]
    roll = ROLL_SIGNS[0] * a + ROLL_SIGNS[1] * b + ROLL_SIGNS[2] * c + ROLL_SIGNS[3] * d
    pitch = PITCH_SIGNS[0] * a + PITCH_SIGNS[1] * b + PITCH_SIGNS[2] * c + PITCH_SIGNS[3] * d
    yaw = YAW_SIGNS[0] * a + YAW_SIGNS[1] * b + YAW_SIGNS[2] * c + YAW_SIGNS[3] * d
    return a + b + c + d, P[at.P_ROTOR_Y] * roll, P[at.P_ROTOR_X] * pitch, P[at.P_TORQUE_RATIO] * yaw


@inlined
def _target(S: Vector, P: Vector, i: int) -> float:
    """rad/s that the signal of rotor ``i`` asks for."""
    u, f = S[at.SIGNALS + i], P[at.P_MOTOR_CURVE]
    return float(P[at.P_SPEED_MAX] * S[at.VOLTAGE] / P[at.P_RATED_VOLTAGE] * math.sqrt(u * (f * u + 1.0 - f)))


@inlined
def _spun(speed: float, target: float, P: Vector) -> float:
    """A rotor's ``speed`` after half a step towards its ``target``, rad/s."""
    decay = P[at.P_DECAY_UP] if target > speed else P[at.P_DECAY_DOWN]
    moved = target + (speed - target) * decay
    return float(moved if moved > STOPPED else 0.0)


@inlined
def _turn_rotors(speeds: Quadruple, targets: Quadruple, P: Vector) -> Quadruple:
    """The rotors' ``speeds`` after half a step."""
    return (
        _spun(speeds[0], targets[0], P),
        _spun(speeds[1], targets[1], P),
        _spun(speeds[2], targets[2], P),
        _spun(speeds[3], targets[3], P),
    )


@inlined
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


@inlined
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


@inlined
def _integrate(S: Vector, P: Vector, wind: Triple) -> None:
    """One Runge-Kutta step of the rigid body; the rotors turn on by half a step twice meanwhile."""
    h = P[at.P_STEP]
    x = (S[0], S[1], S[2], S[3], S[4], S[5], S[6], S[7], S[8], S[9], S[10], S[11], S[12])
    start = (S[at.ROTORS], S[at.ROTORS + 1], S[at.ROTORS + 2], S[at.ROTORS + 3])
    targets = (_target(S, P, 0), _target(S, P, 1), _target(S, P, 2), _target(S, P, 3))
    middle = _turn_rotors(start, targets, P)
    end = _turn_rotors(middle, targets, P)
    wrench = _wrench(middle, P)
    k1 = _slope(x, _wrench(start, P), wind, P)
    k2 = _slope(_moved(x, k1, 0.5 * h), wrench, wind, P)
    k3 = _slope(_moved(x, k2, 0.5 * h), wrench, wind, P)
    k4 = _slope(_moved(x, k3, h), _wrench(end, P), wind, P)
    for i in range(13):
        S[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
    scale = 1.0 / math.sqrt(S[3] * S[3] + S[4] * S[4] + S[5] * S[5] + S[6] * S[6])
    for i in range(3, 7):
        S[i] *= scale
    S[at.FORCE], S[at.FORCE + 1], S[at.FORCE + 2] = k4[13], k4[14], k4[15]
    S[at.ROTORS], S[at.ROTORS + 1], S[at.ROTORS + 2], S[at.ROTORS + 3] = end


@inlined
def _blow(memory: Vector, S: Vector, P: Vector) -> Triple:
    """The wind (world) over the next step, after its gust has moved on."""
    gust = (S[at.GUST], S[at.GUST + 1], S[at.GUST + 2])
    if P[at.P_GUST] > 0.0:
        vx = S[at.VELOCITY] - P[at.P_WIND] - gust[0]
        vy = S[at.VELOCITY + 1] - P[at.P_WIND + 1] - gust[1]
        vz = S[at.VELOCITY + 2] - P[at.P_WIND + 2] - gust[2]
        airspeed = math.sqrt(vx * vx + vy * vy + vz * vz)
        n = at.NOISE + 3 * int(S[at.NOISE_ROW])
        noise = (memory[n], memory[n + 1], memory[n + 2])
        gust = update_gust(gust, P[at.P_GUST], airspeed, S[2], noise, P[at.P_STEP])
        S[at.GUST], S[at.GUST + 1], S[at.GUST + 2] = gust
        S[at.NOISE_ROW] += 1.0
    return P[at.P_WIND] + gust[0], P[at.P_WIND + 1] + gust[1], P[at.P_WIND + 2] + gust[2]


@lean_kernel
def advance(memory: Vector, row: int, steps: int) -> None:
    """Make ``steps`` steps of vehicle and rate loop, in place.

    ``memory`` is packed as `layout` says. Its noise is standard normal and is read from the state's `NOISE_ROW` on
    where there are gusts; its history takes the state after each step from ``row`` on.
    """
    S, P = memory[: at.STATE_SIZE], memory[at.CONSTANTS : at.NOISE]
    h = P[at.P_STEP]
    place = at.HISTORY + row * at.TRACE
    for _ in range(steps):
        _take_commands(S, P[at.P_START] + S[at.STEPS] * h + 1e-9)
        S[at.PHASE] += h
        if S[at.PHASE] >= P[at.P_LOOP_PERIOD] - 1e-9:
            S[at.PHASE] -= P[at.P_LOOP_PERIOD]
            rate_loop(S, P)
            _drain_battery(S, P)
        _integrate(S, P, _blow(memory, S, P))
        S[at.CONTACT] = 1.0 if S[2] <= 0.0 else 0.0
        S[at.STEPS] += 1.0
        memory[place] = P[at.P_START] + S[at.STEPS] * h
        for k in range(at.ROTORS):
            memory[place + 1 + k] = S[k]
        place += at.TRACE


@lean_kernel
def interpolate(memory: Vector, place: float, newest: int, row: Vector) -> None:
    """Fill ``row`` (17,) with the trace at the fractional row ``place`` of the history, whose last is ``newest``."""
    i = min(int(place), newest)
    a = at.HISTORY + i * at.TRACE
    b = a + at.TRACE if i < newest else a
    for k in range(at.TRACE):
        row[k] = memory[a + k] + (place - i) * (memory[b + k] - memory[a + k])
    scale = 1.0 / math.sqrt(row[4] * row[4] + row[5] * row[5] + row[6] * row[6] + row[7] * row[7])
    for k in range(4, 8):
        row[k] *= scale
