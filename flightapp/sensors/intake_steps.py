"""What `PoseIntake` does with one sample, compiled: its checks, the mount, the jumps and the alignment."""

import math

from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel

UNIT = 1e-3
"""By how much the length of a quaternion may differ from 1."""
AHEAD = 0.005
"""s, a stamp further in the future than this is not believed."""
FROZEN_AFTER = 0.05
"""s of samples that are the same."""
STANDING = 1.0
"""m/s, faster than this nothing stops between two samples."""
AGREEING, AGREED_FOR = 3, 0.044
"""Samples, and s, that must agree after a jump (10 samples of a tracker at 200 Hz)."""
FAR, FAST, SPINNING, PUSHED = 1e5, 150.0, 150.0, 2000.0
"""m, m/s, rad/s and m/s² beyond which nothing is a drone's; on each axis."""
STEADY = 0.05
"""s between samples, within which the angular velocity's change tells the angular acceleration."""

# Everything is kept in one array, since each argument of a kernel costs a quarter of a microsecond. A motion is
# 14 numbers: stamp, position, orientation, velocity, angular velocity. The sample: its motion, acceleration,
# confidence, the time now, whether its source says that its frame is another. The memory: the newest stamp; position,
# orientation and velocity of the newest sample; since when they are the same, and whether standing still; the motion
# taken last; that of the newest jump, when the jumps began to agree, and how many did; whether any was taken. The
# alignment: cosine and sine of the yaw, and translation, from the tracker's frame to odom. The settings: delay,
# greatest age, jump and turn; the mount; whether to align, and the start's position and yaw.
ACCELERATION, CONFIDENCE, NOW, ANOTHER = 14, 17, 18, 19
NEWEST, SAME, SINCE, RESTING, LAST, JUMP, JUMPED, JUMPS, STARTED = 20, 21, 31, 32, 33, 47, 61, 62, 63
COS, SIN, SHIFT = 64, 65, 66
DELAY, AGE, REACH, TURN, ARM, MOUNT, ALIGN, START, YAW = 69, 70, 71, 72, 73, 76, 80, 81, 84
WORK = 85
RELOCALISED = -1


@inlined
def _sane(w: Vector) -> int:
    """Fault code of the sample in ``w`` by itself; normalises its quaternion."""
    for i in range(CONFIDENCE + 1):
        if not math.isfinite(w[i]):
            return 1
    for i in range(3):
        if abs(w[1 + i]) > FAR or abs(w[8 + i]) > FAST or abs(w[11 + i]) > SPINNING:
            return 2
        if abs(w[ACCELERATION + i]) > PUSHED:
            return 2
    norm = math.sqrt(w[4] * w[4] + w[5] * w[5] + w[6] * w[6] + w[7] * w[7])
    if not abs(norm - 1.0) <= UNIT:
        return 3
    for i in range(4, 8):
        w[i] /= norm
    return 0


@inlined
def _timely(w: Vector) -> int:
    """Fault code of the sample's stamp, which becomes that of its capture."""
    w[0] -= w[DELAY]
    if w[0] > w[NOW] + AHEAD:
        return 4
    if w[0] < w[NOW] - w[AGE]:
        return 5
    if w[0] == w[NEWEST]:
        return 6
    if w[0] < w[NEWEST]:
        return 7
    w[NEWEST] = w[0]
    return 0


@inlined
def _frozen(w: Vector) -> bool:
    """Whether the sample has been the same for too long."""
    same = True
    for i in range(10):
        same = same and w[1 + i] == w[SAME + i]
    if not same:
        before = w[SAME + 7] ** 2 + w[SAME + 8] ** 2 + w[SAME + 9] ** 2
        still = w[8] == 0.0 and w[9] == 0.0 and w[10] == 0.0
        w[RESTING] = 1.0 if still and before < STANDING * STANDING else 0.0
        w[SINCE] = w[0]
        for i in range(10):
            w[SAME + i] = w[1 + i]
    return bool(w[RESTING] == 0.0 and w[0] - w[SINCE] > FROZEN_AFTER)


@inlined
def _rotate(w: float, x: float, y: float, z: float, v: Vector, out: Vector) -> None:
    """``v`` (3,) turned by the quaternion into ``out`` (3,), which may be ``v``."""
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    a, b, c = v[0], v[1], v[2]
    out[0] = a + w * tx + y * tz - z * ty
    out[1] = b + w * ty + z * tx - x * tz
    out[2] = c + w * tz + x * ty - y * tx


@inlined
def _cross(a: Vector, b: Vector, out: Vector) -> None:
    """a × b (3,) into ``out``, another array."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inlined
def _unmount(w: Vector, spare: Vector) -> None:
    """The tracker's motion becomes the body's; ``spare`` (9,) is overwritten.

    With the arm r and the mount q_bt: q_ob = q_ot q_bt⁻¹, ω = q_bt ω_t, p = p_t − R r, v = v_t − R (ω × r) and
    a = a_t − R (ω' × r + ω × (ω × r)), where ω' is what the angular velocity has changed by since the last sample.
    """
    m, q, r = w[MOUNT : MOUNT + 4], w[4:8], w[ARM : ARM + 3]
    a, b, c, d = q[0], q[1], q[2], q[3]
    q[0] = a * m[0] + b * m[1] + c * m[2] + d * m[3]
    q[1] = -a * m[1] + b * m[0] - c * m[3] + d * m[2]
    q[2] = -a * m[2] + b * m[3] + c * m[0] - d * m[1]
    q[3] = -a * m[3] - b * m[2] + c * m[1] + d * m[0]
    omega = w[11:14]
    _rotate(m[0], m[1], m[2], m[3], omega, omega)
    dt = w[0] - w[LAST]
    steady = w[STARTED] > 0.0 and dt < STEADY
    swing, inner, turned = spare[0:3], spare[3:6], spare[6:9]
    _cross(omega, r, swing)
    _cross(omega, swing, inner)
    for i in range(3):
        turned[i] = (omega[i] - w[LAST + 11 + i]) / dt if steady else 0.0
    # The arm's own turning goes into the inner acceleration before both are turned into odom.
    inner[0] += turned[1] * r[2] - turned[2] * r[1]
    inner[1] += turned[2] * r[0] - turned[0] * r[2]
    inner[2] += turned[0] * r[1] - turned[1] * r[0]
    _rotate(q[0], q[1], q[2], q[3], swing, swing)
    _rotate(q[0], q[1], q[2], q[3], inner, inner)
    _rotate(q[0], q[1], q[2], q[3], r, turned)
    for i in range(3):
        w[1 + i] -= turned[i]
        w[8 + i] -= swing[i]
        w[ACCELERATION + i] -= inner[i]


@inlined
def _explained(w: Vector, at: int) -> bool:
    """Whether the speeds explain the way and the turn from the motion ``at`` to the sample."""
    dt = w[0] - w[at]
    way = before = now = spin = spins = dot = 0.0
    for i in range(3):
        way += (w[1 + i] - w[at + 1 + i]) ** 2
        before += w[at + 8 + i] ** 2
        now += w[8 + i] ** 2
        spin += w[at + 11 + i] ** 2
        spins += w[11 + i] ** 2
    for i in range(4, 8):
        dot += w[i] * w[at + i]
    turn = 2.0 * math.acos(min(abs(dot), 1.0))
    reach = w[REACH] + math.sqrt(max(before, now)) * dt
    return bool(way <= reach * reach and turn <= w[TURN] + math.sqrt(max(spin, spins)) * dt)


@inlined
def _jumped(w: Vector) -> int:
    """Fault code of where the sample is: 0, that of a jump, or `RELOCALISED`."""
    if w[STARTED] == 0.0:
        return 0
    if w[ANOTHER] > 0.0:
        return RELOCALISED
    if _explained(w, LAST):
        return 0
    if w[JUMPS] == 0.0 or not _explained(w, JUMP):
        w[JUMPS], w[JUMPED] = 0.0, w[0]
    w[JUMPS] += 1.0
    for i in range(14):
        w[JUMP + i] = w[i]
    return RELOCALISED if w[JUMPS] >= AGREEING and w[0] - w[JUMPED] >= AGREED_FOR else 10


@inlined
def _align(w: Vector) -> None:
    """Let the odom frame lie so that the body is now at the start."""
    a, b, c, d = w[4], w[5], w[6], w[7]
    yaw = w[YAW] - math.atan2(2.0 * (a * d + b * c), 1.0 - 2.0 * (c * c + d * d))
    w[COS], w[SIN] = math.cos(yaw), math.sin(yaw)
    w[SHIFT] = w[START] - (w[COS] * w[1] - w[SIN] * w[2])
    w[SHIFT + 1] = w[START + 1] - (w[SIN] * w[1] + w[COS] * w[2])
    w[SHIFT + 2] = w[START + 2] - w[3]


@inlined
def _tell(w: Vector, out: Vector) -> None:
    """Position, orientation, velocity, angular velocity and acceleration in odom into ``out`` (16,)."""
    c, s = w[COS], w[SIN]
    half = 0.5 * math.atan2(s, c)
    ch, sh = math.cos(half), math.sin(half)
    out[0], out[1], out[2] = c * w[1] - s * w[2] + w[SHIFT], s * w[1] + c * w[2] + w[SHIFT + 1], w[3] + w[SHIFT + 2]
    out[3], out[4] = ch * w[4] - sh * w[7], ch * w[5] - sh * w[6]
    out[5], out[6] = ch * w[6] + sh * w[5], ch * w[7] + sh * w[4]
    out[7], out[8], out[9] = c * w[8] - s * w[9], s * w[8] + c * w[9], w[10]
    out[10], out[11], out[12] = w[11], w[12], w[13]
    x, y = w[ACCELERATION], w[ACCELERATION + 1]
    out[13], out[14], out[15] = c * x - s * y, s * x + c * y, w[ACCELERATION + 2]


@lean_kernel
def take_sample(w: Vector, out: Vector) -> int:
    """One sample: 0 or `RELOCALISED`, and the body's pose in ``out`` (16,), or the code of its fault."""
    code = _sane(w)
    if code == 0:
        code = _timely(w)
    if code != 0:
        return code
    frozen = _frozen(w)
    if w[CONFIDENCE] <= 0.0:
        return 8
    if frozen:
        return 9
    _unmount(w, out)
    code = _jumped(w)
    if code > 0:
        return code
    if w[STARTED] == 0.0 and w[ALIGN] > 0.0:
        _align(w)
    w[STARTED], w[JUMPS] = 1.0, 0.0
    for i in range(14):
        w[LAST + i] = w[i]
    _tell(w, out)
    return code
