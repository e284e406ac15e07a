"""The kernels of the joint filter over the tracker's drift and the gates.

State x (4 + 4n,): drift translation (3) and yaw, then position (3) and yaw of each of n gates, all in the
world. A sighting, put into the tracker's frame with the tracker's pose, measures

    h(x) = [R_z(-ψ) (g - t),  γ - ψ]

of drift (t, ψ) and gate (g, γ), so that only the drift's yaw is nonlinear. The update is the iterated
extended Kalman filter (B. Bell and F. Cathey, "The iterated Kalman filter update as a Gauss-Newton
method", 1993); the joint covariance is that of R. Smith, M. Self and P. Cheeseman, "Estimating uncertain
spatial relationships in robotics" (1990).
"""

import math

import numpy as np

from flightapp.frames import Vector, quat_multiply, quat_rotate, quat_to_matrix, wrap_angle
from flightapp.jit import assign, kernel
from flightapp.linear import factor, whiten

ITERATIONS = 3
LEAN = 0.05
"""rad, how far gates may stand from upright."""
IGNORED = 1e8
"""Variance of a yaw that is not to be used."""


@kernel
def predict(x: Vector, P: Vector, arm: Vector, dt: float, rates: Vector, jump: float) -> None:
    """Let the drift walk for ``dt`` seconds while the tracker is at ``arm`` (3,) in its own frame.

    ``rates`` (4,) are the walks in m/√s and rad/√s. The heading drifts about the vehicle, not about the
    tracker's origin, so it moves the translation too. ``jump`` m is added to the translation's deviation.
    """
    c, s = math.cos(x[3]), math.sin(x[3])
    lever_x = s * arm[0] + c * arm[1]
    lever_y = -(c * arm[0] - s * arm[1])
    turn = rates[3] ** 2 * dt
    for i in range(3):
        P[i, i] += rates[i] ** 2 * dt + jump * jump
    P[0, 0] += turn * lever_x * lever_x
    P[1, 1] += turn * lever_y * lever_y
    P[0, 1] += turn * lever_x * lever_y
    P[1, 0] = P[0, 1]
    P[0, 3] += turn * lever_x
    P[3, 0] = P[0, 3]
    P[1, 3] += turn * lever_y
    P[3, 1] = P[1, 3]
    P[3, 3] += turn


@kernel
def measure(pose: Vector, sighting: Vector, errors: Vector, inflation: float, z: Vector, R: Vector) -> float:
    """A sighting as a measurement ``z`` (4,), ``R`` (4, 4) in the tracker's frame; returns the lean's χ².

    ``pose`` (13,): position, orientation, velocity, angular velocity. ``sighting`` (43,): position,
    orientation, covariance. ``errors`` (5,): attitude (rad), range (share), synchronisation (s), and the
    least error of position (m) and yaw (rad). These errors hardly change from one frame to the next:
    ``inflation`` is how many frames count as one.
    """
    R_ob = quat_to_matrix(pose[3:7])
    r = quat_rotate(pose[3:7], sighting[0:3])
    R_og = quat_to_matrix(quat_multiply(pose[3:7], sighting[3:7]))
    for i in range(3):
        z[i] = pose[i] + r[i]
    z[3] = math.atan2(R_og[1, 0], R_og[0, 0])
    C = sighting[7:43].reshape(6, 6)
    G = np.zeros((4, 6))
    for i in range(3):
        assign(G[i, 0:3], R_ob[i])
    assign(G[3, 3:6], R_og[2])
    for i in range(4):
        for j in range(4):
            R[i, j] = 0.0
            for k in range(6):
                for m in range(6):
                    R[i, j] += 0.5 * G[i, k] * (C[k, m] + C[m, k]) * G[j, m]
    w = quat_rotate(pose[3:7], pose[10:13])
    a2, range2, sync2 = inflation * errors[0] ** 2, inflation * errors[1] ** 2, inflation * errors[2] ** 2
    motion = np.array(
        (
            pose[7] + w[1] * r[2] - w[2] * r[1],
            pose[8] + w[2] * r[0] - w[0] * r[2],
            pose[9] + w[0] * r[1] - w[1] * r[0],
            w[2],
        )
    )
    across = np.array((-r[1], r[0], 0.0))
    distance2 = r[0] ** 2 + r[1] ** 2 + r[2] ** 2
    for i in range(4):
        for j in range(4):
            R[i, j] += sync2 * motion[i] * motion[j]
    for i in range(3):
        for j in range(3):
            R[i, j] += (range2 - a2) * r[i] * r[j]
        R[i, i] += a2 * distance2 + inflation * errors[3] ** 2
        R[i, 3] += a2 * across[i]
        R[3, i] += a2 * across[i]
    R[3, 3] += a2 + inflation * errors[4] ** 2
    slack = errors[0] ** 2 + LEAN**2
    lean: float = R_og[2, 1] ** 2 / (C[3, 3] + slack) + R_og[2, 0] ** 2 / (C[4, 4] + slack)
    return lean


@kernel
def _linearise(x: Vector, at: int, h: Vector, H: Vector) -> None:
    """Predicted measurement ``h`` (4,) and its derivative ``H`` (4, 8) by drift and the gate ``at``."""
    c, s = math.cos(x[3]), math.sin(x[3])
    dx, dy = x[at] - x[0], x[at + 1] - x[1]
    h[0] = c * dx + s * dy
    h[1] = -s * dx + c * dy
    h[2] = x[at + 2] - x[2]
    h[3] = x[at + 3] - x[3]
    H[:] = 0.0
    H[0, 4], H[0, 5], H[1, 4], H[1, 5] = c, s, -s, c
    H[2, 6], H[3, 7] = 1.0, 1.0
    for i in range(4):
        for j in range(3):
            H[i, j] = -H[i, 4 + j]
    H[0, 3], H[1, 3], H[3, 3] = h[1], -h[0], -1.0


@kernel
def _gain_terms(P: Vector, at: int, H: Vector, R: Vector, PHt: Vector, S: Vector) -> None:
    """P Hᵀ (N, 4) and S = H P Hᵀ + R (4, 4), from the eight columns of H that are not zero."""
    for row in range(P.shape[0]):
        for i in range(4):
            total = 0.0
            for k in range(4):
                total += P[row, k] * H[i, k] + P[row, at + k] * H[i, 4 + k]
            PHt[row, i] = total
    for i in range(4):
        for j in range(4):
            total = R[i, j]
            for k in range(4):
                total += 0.5 * (H[i, k] * PHt[k, j] + H[i, 4 + k] * PHt[at + k, j])
                total += 0.5 * (H[j, k] * PHt[k, i] + H[j, 4 + k] * PHt[at + k, i])
            S[i, j] = total


@kernel
def distance(x: Vector, P: Vector, at: int, z: Vector, R: Vector) -> float:
    """Squared Mahalanobis distance of the measurement ``z`` from the state; infinite where R is no covariance."""
    h, H = np.empty(4), np.empty((4, 8))
    PHt, S = np.empty((x.size, 4)), np.empty((4, 4))
    _linearise(x, at, h, H)
    _gain_terms(P, at, H, R, PHt, S)
    if not (factor(R.copy()) and factor(S)):
        return math.inf
    nu = z - h
    nu[3] = wrap_angle(nu[3])
    whiten(S, nu)
    total: float = nu[0] ** 2 + nu[1] ** 2 + nu[2] ** 2 + nu[3] ** 2
    return total


@kernel
def correct(x: Vector, P: Vector, at: int, z: Vector, R: Vector, floors: Vector) -> bool:
    """Iterated update of ``x`` and ``P`` with the measurement of the gate ``at``; False where S is not positive.

    With S = L Lᵀ and W = L⁻¹ H P (4, N), the state moves by Wᵀ L⁻¹ ν and P loses Wᵀ W, so it stays
    symmetric. The gate's deviations are kept above ``floors`` (2,), m and rad.
    """
    n = x.size
    h, H = np.empty(4), np.empty((4, 8))
    W, S = np.empty((n, 4)), np.empty((4, 4))
    prior = x.copy()
    for _ in range(ITERATIONS):
        _linearise(x, at, h, H)
        _gain_terms(P, at, H, R, W, S)
        if not factor(S):
            assign(x, prior)
            return False
        nu = z - h
        nu[3] = wrap_angle(nu[3])
        for k in range(4):
            for i in range(4):
                nu[i] -= H[i, k] * (prior[k] - x[k]) + H[i, 4 + k] * (prior[at + k] - x[at + k])
        whiten(S, nu)
        for i in range(n):
            whiten(S, W[i])
            x[i] = prior[i] + W[i, 0] * nu[0] + W[i, 1] * nu[1] + W[i, 2] * nu[2] + W[i, 3] * nu[3]
    for i in range(n):
        for j in range(i, n):
            P[i, j] -= W[i, 0] * W[j, 0] + W[i, 1] * W[j, 1] + W[i, 2] * W[j, 2] + W[i, 3] * W[j, 3]
            P[j, i] = P[i, j]
    for k in range(3, n, 4):
        x[k] = wrap_angle(x[k])
    for k in range(4):
        P[at + k, at + k] = max(P[at + k, at + k], floors[k // 3] ** 2)
    return True


@kernel
def sight(
    x: Vector,
    P: Vector,
    at: int,
    pose: Vector,
    sightings: Vector,
    errors: Vector,
    inflation: float,
    gate: float,
    ambiguity: float,
    floors: Vector,
    z: Vector,
) -> int:
    """Use one sighting of the gate ``at``: 1 used, 0 refused as an outlier, -1 its covariance is none.

    ``sightings`` (1 or 2, 43) are the pose and its alternative. The one that fits the map and an upright
    gate better is used; where their χ² differ by less than ``ambiguity``, only its position is. ``z`` (4,)
    becomes the measurement in the tracker's frame.
    """
    R, other_z, other_R = np.empty((4, 4)), np.empty(4), np.empty((4, 4))
    lean = measure(pose, sightings[0], errors, inflation, z, R)
    fit = distance(x, P, at, z, R)
    unsure = False
    if sightings.shape[0] > 1:
        other_lean = measure(pose, sightings[1], errors, inflation, other_z, other_R)
        other_fit = distance(x, P, at, other_z, other_R)
        unsure = abs(other_fit + other_lean - fit - lean) < ambiguity
        if other_fit + other_lean < fit + lean:
            assign(z, other_z)
            assign(R.reshape(16), other_R.reshape(16))
            fit = other_fit
    if unsure:
        R[3, :] = 0.0
        R[:, 3] = 0.0
        R[3, 3] = IGNORED
        fit = distance(x, P, at, z, R)
    if fit == math.inf:
        return -1
    if not fit < gate:
        return 0
    return 1 if correct(x, P, at, z, R, floors) else -1
