"""Corrections of the joint filter: by the tracker's poses, and by sightings of gates.

Each is one linear update with a χ² test (Y. Bar-Shalom, X. Li and T. Kirubarajan, "Estimation with Applications to
Tracking and Navigation", 2001): only a few columns of the measurement's derivative are not zero, and these are
given by their indices.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.estimation.process import (
    ATTITUDE,
    DRIFT,
    GATE,
    GATING,
    KIND,
    MANOEUVRE,
    ODOM,
    POSITION,
    POSITION_NOISE,
    RATES,
    SCALE,
    SLIP,
    SPEED,
    STAMP,
    TILT,
    VELOCITY,
    VELOCITY_NOISE,
    YAW,
    attitude,
    predict,
    scaled_velocity,
)
from flightapp.frames import Vector, quat_from_yaw, quat_multiply, quat_rotate, quat_to_matrix, wrap_angle
from flightapp.jit import assign, kernel
from flightapp.linear import factor, whiten

LEAN = 0.05
"""rad, how far gates may stand from upright."""
IGNORED = 1e8
"""Variance of a yaw that is not to be used."""


@kernel
def innovate(P: Vector, H: Vector, columns: NDArray[np.int64], R: Vector, W: Vector, S: Vector) -> bool:
    """``W`` (N, m) ← P Hᵀ and ``S`` (m, m) ← Cholesky factor of H P Hᵀ + R; False where that is not positive.

    ``H`` (m, k) holds the derivative by the state's ``columns`` (k,) alone.
    """
    m, k = H.shape
    for row in range(P.shape[0]):
        for i in range(m):
            total = 0.0
            for c in range(k):
                total += P[row, columns[c]] * H[i, c]
            W[row, i] = total
    for i in range(m):
        for j in range(i + 1):
            total = R[i, j]
            for c in range(k):
                total += H[i, c] * W[columns[c], j]
            S[i, j] = total
    return factor(S)


@kernel
def correct(x: Vector, P: Vector, nu: Vector, H: Vector, columns: NDArray[np.int64], R: Vector, gate: float) -> float:
    """Update ``x`` and ``P`` with the innovation ``nu`` (m,); its χ², inf where S is not positive.

    Nothing changes where the χ² is above ``gate``. With S = L Lᵀ and W = L⁻¹ H P the state moves by Wᵀ L⁻¹ ν and
    P loses Wᵀ W, so it stays symmetric.
    """
    n, m = x.size, nu.size
    W, S = np.empty((n, m)), np.empty((m, m))
    if not innovate(P, H, columns, R, W, S):
        return math.inf
    whiten(S, nu)
    chi2 = 0.0
    for i in range(m):
        chi2 += nu[i] * nu[i]
    if not chi2 <= gate:
        return chi2
    for i in range(n):
        whiten(S, W[i])
        for k in range(m):
            x[i] += W[i, k] * nu[k]
    for i in range(n):
        for j in range(i + 1):
            total = P[i, j]
            for k in range(m):
                total -= W[i, k] * W[j, k]
            P[i, j] = total
            P[j, i] = total
    x[YAW] = wrap_angle(x[YAW])
    return chi2


@kernel
def use_pose(x: Vector, P: Vector, row: Vector, s: Vector) -> float:
    """Correct with the tracker's position and velocity in ``row`` (20,); the greater of the two χ²."""
    nu, H, R = np.empty(3), np.zeros((3, 8)), np.zeros((3, 3))
    columns = np.empty(7, np.int64)
    r = quat_rotate(quat_from_yaw(x[YAW]), row[ODOM : ODOM + 3])
    for i in range(3):
        nu[i] = r[i] - x[POSITION + i] + x[DRIFT + i]
        columns[i], columns[3 + i] = POSITION + i, DRIFT + i
        H[i, i], H[i, 3 + i] = 1.0, -1.0
        R[i, i] = s[POSITION_NOISE] ** 2
    columns[6] = YAW
    H[0, 6], H[1, 6] = r[1], -r[0]
    chi2 = correct(x, P, nu, H[:, :7], columns, R, s[GATING])
    r, scaled = quat_rotate(quat_from_yaw(x[YAW]), row[SPEED : SPEED + 3]), scaled_velocity(x)
    wide = np.empty(8, np.int64)
    for i in range(3):
        share = 1.0 - x[SCALE] if i < 2 else 1.0
        nu[i] = r[i] - share * x[VELOCITY + i] + x[SLIP + i]
        wide[i], wide[3 + i] = VELOCITY + i, SLIP + i
        H[i, i], H[i, 3 + i], H[i, 7] = share, -1.0, -scaled[i]
        R[i, i] = s[VELOCITY_NOISE] ** 2
    wide[6], wide[7] = YAW, SCALE
    H[0, 6], H[1, 6] = r[1], -r[0]
    # The estimated speed and its own error make a product here, which would push the scale one way: the scale's
    # uncertainty is considered, but it learns from positions alone (S. Schmidt's consider filter, 1966).
    scale, variance = x[SCALE], P[SCALE, SCALE]
    chi2 = max(chi2, correct(x, P, nu, H, wide, R, s[GATING]))
    x[SCALE], P[SCALE, SCALE] = scale, variance
    return chi2


@kernel
def step(x: Vector, P: Vector, before: Vector, row: Vector, s: Vector) -> float:
    """Predict to ``row`` (20,) and, where it is a pose, correct with it; its χ².

    A pose that contradicts the filter makes it less sure of its velocity: a force felt wrongly must not lock it out.
    """
    predict(x, P, before, row, s)
    if row[KIND] <= 0.0:
        return 0.0
    chi2 = use_pose(x, P, row, s)
    if not chi2 <= s[GATING]:
        for i in range(3):
            P[VELOCITY + i, VELOCITY + i] += s[MANOEUVRE] ** 2 * (row[STAMP] - before[STAMP])
    return chi2


@kernel
def replay(
    x: Vector,
    P: Vector,
    before: Vector,
    rows: Vector,
    begin: int,
    end: int,
    every: int,
    xs: Vector,
    Ps: Vector,
    s: Vector,
) -> None:
    """Step through the ring ``rows`` (m, 20), numbers ``begin`` to before ``end``, from the step ``before``.

    Each state whose number is a multiple of ``every`` is kept in the rings ``xs`` (k, N) and ``Ps`` (k, N, N).
    """
    for number in range(begin, end):
        row = rows[number % rows.shape[0]]
        step(x, P, before, row, s)
        before = row
        if number % every == 0:
            slot = number // every % xs.shape[0]
            assign(xs[slot], x)
            assign(Ps[slot].reshape(P.size), P.reshape(P.size))


@kernel
def sighted(x: Vector, row: Vector, sighting: Vector, errors: Vector, inflation: float, z: Vector, R: Vector) -> float:
    """A sighting from the step ``row`` as ``z`` (4,), the way to the gate in world axes and its yaw; the lean's χ².

    ``sighting`` (43,) is position, orientation and covariance, ``R`` (4, 4) becomes the covariance. ``errors`` (5,):
    attitude (rad), range (share), synchronisation (s), and the least error of position (m) and yaw (rad). These hardly
    change from one frame to the next: ``inflation`` is how many frames count as one.
    """
    q_wb = attitude(x, row[ATTITUDE : ATTITUDE + 4])
    R_wb = quat_to_matrix(q_wb)
    r = quat_rotate(q_wb, sighting[0:3])
    R_wg = quat_to_matrix(quat_multiply(q_wb, sighting[3:7]))
    assign(z[0:3], r)
    z[3] = math.atan2(R_wg[1, 0], R_wg[0, 0])
    C = sighting[7:43].reshape(6, 6)
    G = np.zeros((4, 6))
    for i in range(3):
        assign(G[i, 0:3], R_wb[i])
    assign(G[3, 3:6], R_wg[2])
    for i in range(4):
        for j in range(4):
            R[i, j] = 0.0
            for k in range(6):
                for m in range(6):
                    R[i, j] += 0.5 * G[i, k] * (C[k, m] + C[m, k]) * G[j, m]
    w, v = quat_rotate(q_wb, row[RATES : RATES + 3]), x[VELOCITY : VELOCITY + 3]
    motion = np.array(
        (v[0] + w[1] * r[2] - w[2] * r[1], v[1] + w[2] * r[0] - w[0] * r[2], v[2] + w[0] * r[1] - w[1] * r[0], w[2])
    )
    a2, range2, sync2 = inflation * errors[0] ** 2, inflation * errors[1] ** 2, inflation * errors[2] ** 2
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
    lean: float = R_wg[2, 1] ** 2 / (C[3, 3] + slack) + R_wg[2, 0] ** 2 / (C[4, 4] + slack)
    return lean


@kernel
def _derivative(at: int, z: Vector, H: Vector, columns: NDArray[np.int64]) -> None:
    """Of a sighting ``z`` (4,) of the gate ``at``: ``H`` (4, 10) by position, attitude error and the gate."""
    H[:] = 0.0
    for i in range(3):
        columns[i], columns[6 + i] = POSITION + i, at + i
        H[i, i], H[i, 6 + i] = -1.0, 1.0
    columns[3], columns[4], columns[5], columns[9] = TILT, TILT + 1, YAW, at + 3
    H[0, 4], H[0, 5] = -z[2], z[1]
    H[1, 3], H[1, 5] = z[2], -z[0]
    H[2, 3], H[2, 4] = -z[1], z[0]
    H[3, 5], H[3, 9] = -1.0, 1.0


@kernel
def _innovation(x: Vector, at: int, z: Vector) -> Vector:
    nu = np.empty(4)
    for i in range(3):
        nu[i] = z[i] - x[at + i] + x[POSITION + i]
    nu[3] = wrap_angle(z[3] - x[at + 3])
    return nu


@kernel
def misfit(x: Vector, P: Vector, at: int, z: Vector, R: Vector) -> float:
    """χ² of a sighting ``z`` (4,) of the gate ``at``; infinite where R is no covariance."""
    H, columns = np.empty((4, 10)), np.empty(10, np.int64)
    W, S = np.empty((x.size, 4)), np.empty((4, 4))
    _derivative(at, z, H, columns)
    if not (factor(R.copy()) and innovate(P, H, columns, R, W, S)):
        return math.inf
    nu = _innovation(x, at, z)
    whiten(S, nu)
    total: float = nu[0] ** 2 + nu[1] ** 2 + nu[2] ** 2 + nu[3] ** 2
    return total


@kernel
def use_sighting(
    x: Vector,
    P: Vector,
    at: int,
    row: Vector,
    sightings: Vector,
    errors: Vector,
    inflation: float,
    limits: Vector,
    z: Vector,
) -> int:
    """Use one sighting, from the step ``row``, of the gate ``at``: 1 used, 0 refused as an outlier, -1 no covariance.

    ``sightings`` (1 or 2, 43) are the pose and its alternative. The one that fits the map and an upright gate better is
    used; where their χ² differ by less than ``limits[1]``, only its position is. ``limits`` (4,): χ² of an outlier,
    χ² of ambiguity, and the deviations of a gate (m and rad) that are never undercut. ``z`` (4,) becomes the way to the
    gate in world axes, and its yaw.
    """
    R, other_z, other_R = np.empty((4, 4)), np.empty(4), np.empty((4, 4))
    lean = sighted(x, row, sightings[0], errors, inflation, z, R)
    fit = misfit(x, P, at, z, R)
    unsure = False
    if sightings.shape[0] > 1:
        other_lean = sighted(x, row, sightings[1], errors, inflation, other_z, other_R)
        other_fit = misfit(x, P, at, other_z, other_R)
        unsure = abs(other_fit + other_lean - fit - lean) < limits[1]
        if other_fit + other_lean < fit + lean:
            assign(z, other_z)
            assign(R.reshape(16), other_R.reshape(16))
            fit = other_fit
    if unsure:
        R[3, :] = 0.0
        R[:, 3] = 0.0
        R[3, 3] = IGNORED
        fit = misfit(x, P, at, z, R)
    if fit == math.inf:
        return -1
    H, columns = np.empty((4, 10)), np.empty(10, np.int64)
    _derivative(at, z, H, columns)
    if not correct(x, P, _innovation(x, at, z), H, columns, R, limits[0]) <= limits[0]:
        return 0
    x[at + 3] = wrap_angle(x[at + 3])
    for k in range(GATE):
        P[at + k, at + k] = max(P[at + k, at + k], limits[2 + k // 3] ** 2)
    return 1


@kernel
def place(x: Vector, P: Vector, at: int, row: Vector, sighting: Vector, errors: Vector, inflation: float) -> None:
    """Put the gate ``at`` where one ``sighting`` (43,) from the step ``row`` shows it, forgetting what was known of it.

    The gate is as uncertain as vehicle and sighting together, and correlated with both.
    """
    z, R = np.empty(4), np.empty((4, 4))
    H, columns = np.empty((4, 10)), np.empty(10, np.int64)
    sighted(x, row, sighting, errors, inflation, z, R)
    _derivative(at, z, H, columns)
    for k in range(GATE):
        P[at + k, :] = 0.0
        P[:, at + k] = 0.0
    # The gate is where the innovation is nothing: g = -H_rest x, with the derivative by all but the gate.
    for j in range(x.size):
        for k in range(GATE):
            total = 0.0
            for c in range(6):
                total -= H[k, c] * P[columns[c], j]
            P[at + k, j] = total
    for k in range(GATE):
        for j in range(x.size):
            if not at <= j < at + GATE:
                P[j, at + k] = P[at + k, j]
    for k in range(GATE):
        for m in range(GATE):
            total = R[k, m]
            for c in range(6):
                total -= P[at + k, columns[c]] * H[m, c]
            P[at + k, at + m] = total
    for i in range(3):
        x[at + i] = x[POSITION + i] + z[i]
    x[at + 3] = z[3]
