"""The process model of the joint filter over vehicle, tracker errors and gates.

The tracker reports its pose in a frame of its own (odom) that drifts: p_w = R_z(ψ) p_o + t. With the velocity v_o that
it reports, its scale error κ and its velocity error e the vehicle moves by

    v = (1 + κ) R_z(ψ) v_o + e,    so    ṫ = κ R_z(ψ) v_o + e + walk.

The drift follows from what is measured, not from v, whose error would make a product with that of κ. What is wrong
with its height grows with the speed and keeps its sign while the vehicle flies on: e_z = γ |v|³ exp(-s / L) after s
metres, where γ hardly changes, and e_x and e_y come and go. Accelerometer and attitude drive v, so that an error of
the tracker's velocity shows as the disagreement of the two. The attitude is the tracker's, turned by ψ and a slow tilt
error τ: q_wb = exp(τ) ⊗ yaw(ψ) ⊗ q_ob. The state (N,) is laid out as below, then position and yaw of each gate; errors
are additive but for the attitude, whose error is (τ, ψ) as a rotation vector in world axes. What the camera shows is
turned by a constant error μ of its mount, in body axes, and further away by a constant share ρ of the distance, that of
its focal length: no number of sightings averages these out. What the tracker gets wrong and by how much follows from
its published evaluation (paper's table 9) and is configuration.
"""

import math

import numpy as np

from flightapp.frames import (
    GRAVITY,
    Vector,
    quat_from_rotvec,
    quat_from_yaw,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
)
from flightapp.jit import kernel

POSITION, VELOCITY, DRIFT, YAW, SCALE, SLIP, CLIMB, BIAS, TILT = 0, 3, 6, 9, 10, 11, 13, 14, 17
MOUNT, RANGE, CORE = 19, 22, 23
"""Where in the state: p, v, t (each 3), ψ, κ, e_x, e_y, γ, the accelerometer's bias (3), τ (2), μ (3), ρ; the gates."""
GATE = 4
"""Numbers of a gate: position (3), yaw."""

# One step of the tracker or of coasting: what was measured at its stamp.
STAMP, KIND, ODOM, ATTITUDE, SPEED, RATES, FORCE, FELT, FLOWN, PACE, SILENT, ROW = (
    0,
    1,
    2,
    5,
    9,
    12,
    15,
    18,
    19,
    20,
    21,
    22,
)
"""Columns: stamp, 1 for a pose or 0 for coasting, p_o (3), q_ob (4), v_o (3), ω (3), specific force (3), share felt,
metres flown since the start, smoothed speed, s since the last pose."""

# Settings of the process and of the tracker as a sensor, one row of numbers.
(
    ACCELEROMETER,
    MANOEUVRE,
    BIAS_WALK,
    WALK,
    WALK_AT_REST,
    YAW_WALK,
    YAW_AT_REST,
    SLIP_ACROSS,
    SLIP_TIME,
    CLIMB_SIZE,
    CLIMB_TIME,
    CLIMB_FADES,
    TILT_SIZE,
    TILT_TIME,
    POSITION_NOISE,
    VELOCITY_NOISE,
    GATING,
    GATE_WALK,
    SETTINGS,
) = range(19)

MEASURED = 4.2
"""m/s, the fastest of the published evaluation (table 11): beyond it the vertical error is a share of the speed."""


@kernel
def climb_share(row: Vector, s: Vector) -> float:
    """m/s of vertical velocity error per unit of γ at the step ``row``: it fades as gravity and scale show.

    The speed is the tracker's, smoothed: the noise of its last sample must not be in the innovation, too.
    """
    speed = row[PACE]
    share: float = speed * min(speed, MEASURED) ** 2 * math.exp(-row[FLOWN] / s[CLIMB_FADES])
    return share


@kernel
def attitude(x: Vector, q_ob: Vector) -> Vector:
    """q_wb (4,) from the tracker's ``q_ob`` (4,)."""
    lean = quat_from_rotvec(np.array((x[TILT], x[TILT + 1], 0.0)))
    return quat_multiply(lean, quat_multiply(quat_from_yaw(x[YAW]), q_ob))


@kernel
def pushed(P: Vector, density: float, dt: float) -> None:
    """Add what an unknown acceleration of that spectral ``density`` (m²/s³) does to ``P`` in ``dt`` seconds.

    It moves the position, too: after a gap that is most of what is not known of it.
    """
    for i in range(3):
        P[VELOCITY + i, VELOCITY + i] += density * dt
        P[POSITION + i, POSITION + i] += density * dt**3 / 3.0
        P[POSITION + i, VELOCITY + i] += 0.5 * density * dt**2
        P[VELOCITY + i, POSITION + i] += 0.5 * density * dt**2


@kernel
def _add_noise(x: Vector, P: Vector, speed: float, dt: float, row: Vector, s: Vector) -> None:
    """Process noise over ``dt`` seconds up to ``row`` into ``P``; e, γ and τ are first-order Gauss-Markov processes."""
    pushed(P, row[FELT] * s[ACCELEROMETER] ** 2 + (1.0 - row[FELT]) * s[MANOEUVRE] ** 2, dt)
    for i in range(3):
        P[BIAS + i, BIAS + i] += s[BIAS_WALK] ** 2 * dt
        P[DRIFT + i, DRIFT + i] += (s[WALK] ** 2 * speed + s[WALK_AT_REST] ** 2) * dt
    gone = 1.0 - math.exp(-2.0 * dt / s[SLIP_TIME])
    across = s[SLIP_ACROSS] * speed
    P[SLIP, SLIP] += gone * across * across
    P[SLIP + 1, SLIP + 1] += gone * across * across
    P[CLIMB, CLIMB] += (1.0 - math.exp(-2.0 * dt / s[CLIMB_TIME])) * s[CLIMB_SIZE] ** 2
    for g in range(CORE, x.size, GATE):
        for i in range(3):
            P[g + i, g + i] += s[GATE_WALK] ** 2 * dt
    gone = 1.0 - math.exp(-2.0 * dt / s[TILT_TIME])
    for i in range(2):
        P[TILT + i, TILT + i] += gone * s[TILT_SIZE] ** 2
    # The heading drifts about the vehicle, not about the tracker's origin, so it moves the translation too.
    turn = (s[YAW_WALK] ** 2 * speed + s[YAW_AT_REST] ** 2) * dt
    arm_x, arm_y = x[POSITION] - x[DRIFT], x[POSITION + 1] - x[DRIFT + 1]
    lever = (arm_y, -arm_x)
    for i in range(2):
        for j in range(2):
            P[DRIFT + i, DRIFT + j] += turn * lever[i] * lever[j]
        P[DRIFT + i, YAW] += turn * lever[i]
        P[YAW, DRIFT + i] += turn * lever[i]
    P[YAW, YAW] += turn


@kernel
def _transport(
    P: Vector, told: Vector, scale: float, climb: float, turned: Vector, R: Vector, dt: float, keep: Vector
) -> None:
    """``P`` ← F P in place; given the transpose of P, P ← P Fᵀ.

    ``told`` (3,) is the tracker's velocity in world axes, ``scale`` κ and ``climb`` `climb_share`; ``turned`` (3, 3)
    and -``R`` (3, 3) are the derivatives of the acceleration by the attitude's error and the accelerometer's bias,
    ``keep`` (3,) what is left of e, γ and tilt.
    """
    across = (-scale * told[1], scale * told[0], 0.0)
    for j in range(P.shape[1]):
        for i in range(3):
            error = P[SLIP + i, j] if i < 2 else climb * P[CLIMB, j]
            P[DRIFT + i, j] += dt * (told[i] * P[SCALE, j] + across[i] * P[YAW, j] + error)
            P[POSITION + i, j] += dt * P[VELOCITY + i, j]
        for i in range(3):
            gained = turned[i, 0] * P[TILT, j] + turned[i, 1] * P[TILT + 1, j] + turned[i, 2] * P[YAW, j]
            for k in range(3):
                gained -= R[i, k] * P[BIAS + k, j]
            P[VELOCITY + i, j] += dt * gained
        for i in range(2):
            P[SLIP + i, j] *= keep[0]
            P[TILT + i, j] *= keep[2]
        P[CLIMB, j] *= keep[1]


@kernel
def predict(x: Vector, P: Vector, before: Vector, row: Vector, s: Vector) -> None:
    """Move state and covariance from the step ``before`` (22,) to the stamp and attitude of ``row`` (22,).

    For the share of the time in which the specific force was not felt, the velocity walks with `MANOEUVRE`.
    """
    dt = row[STAMP] - before[STAMP]
    felt = row[FELT] > 0.0
    R, turned, pull = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    if felt:
        R_before = quat_to_matrix(attitude(x, before[ATTITUDE : ATTITUDE + 4]))
        R_now = quat_to_matrix(attitude(x, row[ATTITUDE : ATTITUDE + 4]))
        for i in range(3):
            for j in range(3):
                R[i, j] = 0.5 * (R_before[i, j] + R_now[i, j])
                pull[i] += R[i, j] * (row[FORCE + j] - x[BIAS + j])
        turned[0, 1], turned[0, 2], turned[1, 2] = pull[2], -pull[1], pull[0]
        turned[1, 0], turned[2, 0], turned[2, 1] = -pull[2], pull[1], -pull[0]
        pull[2] -= GRAVITY
    keep = np.array((math.exp(-dt / s[SLIP_TIME]), math.exp(-dt / s[CLIMB_TIME]), math.exp(-dt / s[TILT_TIME])))
    v = x[VELOCITY : VELOCITY + 3].copy()
    told = quat_rotate(quat_from_yaw(x[YAW]), 0.5 * (before[SPEED : SPEED + 3] + row[SPEED : SPEED + 3]))
    climb = climb_share(row, s)
    _transport(P, told, x[SCALE], climb, turned, R, dt, keep)
    _transport(P.T, told, x[SCALE], climb, turned, R, dt, keep)
    for i in range(3):
        x[DRIFT + i] += dt * (x[SCALE] * told[i] + (x[SLIP + i] if i < 2 else climb * x[CLIMB]))
        x[POSITION + i] += dt * (v[i] + 0.5 * dt * pull[i])
        x[VELOCITY + i] += dt * pull[i]
    for i in range(2):
        x[SLIP + i] *= keep[0]
        x[TILT + i] *= keep[2]
    x[CLIMB] *= keep[1]
    _add_noise(x, P, math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2), dt, row, s)
