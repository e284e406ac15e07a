"""What a sighting of a gate tells the joint filter: about the vehicle, the camera's calibration and the gate."""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.estimation.correction import correct, innovate
from flightapp.estimation.process import ATTITUDE, GATE, MOUNT, POSITION, RANGE, RATES, TILT, VELOCITY, YAW, attitude
from flightapp.frames import Vector, quat_from_rotvec, quat_multiply, quat_rotate, quat_to_matrix, wrap_angle
from flightapp.jit import assign, kernel
from flightapp.linear import factor, whiten

LEAN = 0.05
"""rad, how far gates may stand from upright."""
IGNORED = 1e8
"""Variance of a yaw that is not to be used."""
FAR_OFF = 0.1
"""Share of the distance by which a gate is seen elsewhere than it is expected that is too far for derivatives there."""
SEEN, FROM = 14, 10
"""Numbers of the state on which a sighting depends; those before the gate: position, attitude, mount, range."""


@kernel
def sighted(x: Vector, row: Vector, sighting: Vector, errors: Vector, z: Vector, R: Vector) -> float:
    """A sighting from the step ``row`` as ``z`` (4,), the way to the gate in world axes and its yaw; the lean's χ².

    ``sighting`` (43,) is position, orientation and covariance, ``R`` (4, 4) becomes the covariance. ``errors`` (3,):
    synchronisation (s), and what the lens does to position (m) and yaw (rad).
    """
    q_wb = attitude(x, row[ATTITUDE : ATTITUDE + 4])
    R_wb = quat_to_matrix(q_wb)
    q_ws = quat_multiply(q_wb, quat_from_rotvec(x[MOUNT : MOUNT + 3]))
    r = (1.0 - x[RANGE]) * quat_rotate(q_ws, sighting[0:3])
    R_wg = quat_to_matrix(quat_multiply(q_ws, sighting[3:7]))
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
    for i in range(4):
        for j in range(4):
            R[i, j] += errors[0] ** 2 * motion[i] * motion[j]
        R[i, i] += errors[1 + i // 3] ** 2
    lean: float = R_wg[2, 1] ** 2 / (C[3, 3] + LEAN**2) + R_wg[2, 0] ** 2 / (C[4, 4] + LEAN**2)
    return lean


@kernel
def more_upright(x: Vector, row: Vector, sightings: Vector, errors: Vector, z: Vector) -> int:
    """Which of the explanations ``sightings`` (1 or 2, 43) has the more upright gate, and its ``z`` as of `sighted`."""
    seen, R = np.empty(4), np.empty((4, 4))
    best, least = 0, math.inf
    for k in range(sightings.shape[0]):
        lean = sighted(x, row, sightings[k], errors, seen, R)
        if k == 0 or lean < least:
            best, least = k, lean
            assign(z, seen)
    return best


@kernel
def _derivative(x: Vector, row: Vector, at: int, z: Vector, H: Vector, columns: NDArray[np.int64]) -> None:
    """Of a sighting ``z`` (4,) of the gate ``at``: ``H`` (4, 14) by position, attitude, mount, range and the gate.

    It is taken where the gate is expected, or else a sighting's own noise would seem to tell of what none of them shows
    (G. Huang, A. Mourikis and S. Roumeliotis, "Observability-based rules for designing consistent EKF SLAM estimators",
    2010). But for a gate that is far off, what the camera's tilt and calibration do is what they do to the gate seen.
    """
    H[:] = 0.0
    way = x[at : at + 3] - x[POSITION : POSITION + 3]
    H[0, 5], H[1, 5] = way[1], -way[0]
    off2 = (z[0] - way[0]) ** 2 + (z[1] - way[1]) ** 2 + (z[2] - way[2]) ** 2
    if off2 > FAR_OFF**2 * (z[0] ** 2 + z[1] ** 2 + z[2] ** 2):
        assign(way, z[0:3])
    R_wb = quat_to_matrix(attitude(x, row[ATTITUDE : ATTITUDE + 4]))
    for i in range(3):
        columns[i], columns[6 + i], columns[FROM + i] = POSITION + i, MOUNT + i, at + i
        H[i, i], H[i, FROM + i] = -1.0, 1.0
        H[0, 6 + i] = way[1] * R_wb[2, i] - way[2] * R_wb[1, i]
        H[1, 6 + i] = way[2] * R_wb[0, i] - way[0] * R_wb[2, i]
        H[2, 6 + i] = way[0] * R_wb[1, i] - way[1] * R_wb[0, i]
        H[3, 6 + i] = -R_wb[2, i]
        H[i, 9] = way[i]
    columns[3], columns[4], columns[5], columns[9], columns[FROM + 3] = TILT, TILT + 1, YAW, RANGE, at + 3
    H[0, 4], H[1, 3] = -way[2], way[2]
    H[2, 3], H[2, 4] = -way[1], way[0]
    H[3, 5], H[3, FROM + 3] = -1.0, 1.0


@kernel
def _innovation(x: Vector, at: int, z: Vector) -> Vector:
    nu = np.empty(4)
    for i in range(3):
        nu[i] = z[i] - x[at + i] + x[POSITION + i]
    nu[3] = wrap_angle(z[3] - x[at + 3])
    return nu


@kernel
def misfit(x: Vector, P: Vector, at: int, row: Vector, z: Vector, R: Vector) -> float:
    """χ² of a sighting ``z`` (4,) from the step ``row`` of the gate ``at``; infinite where R is no covariance."""
    H, columns = np.empty((4, SEEN)), np.empty(SEEN, np.int64)
    W, S = np.empty((x.size, 4)), np.empty((4, 4))
    _derivative(x, row, at, z, H, columns)
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
    limits: Vector,
    z: Vector,
) -> int:
    """Use one sighting, from the step ``row``, of the gate ``at``: 1 used, 0 refused as an outlier, -1 no covariance.

    ``sightings`` (1 or 2, 43) are the pose and its alternative. The one that fits the map and an upright gate better is
    used; where their χ² differ by less than ``limits[1]``, only its position is. ``limits`` (2,): χ² of an outlier,
    χ² of ambiguity. ``z`` (4,) becomes the way to the gate in world axes, and its yaw.
    """
    R, other_z, other_R = np.empty((4, 4)), np.empty(4), np.empty((4, 4))
    lean = sighted(x, row, sightings[0], errors, z, R)
    fit = misfit(x, P, at, row, z, R)
    unsure = False
    if sightings.shape[0] > 1:
        other_lean = sighted(x, row, sightings[1], errors, other_z, other_R)
        other_fit = misfit(x, P, at, row, other_z, other_R)
        unsure = abs(other_fit + other_lean - fit - lean) < limits[1]
        if other_fit + other_lean < fit + lean:
            assign(z, other_z)
            assign(R.reshape(16), other_R.reshape(16))
            fit = other_fit
    if unsure:
        R[3, :] = 0.0
        R[:, 3] = 0.0
        R[3, 3] = IGNORED
        fit = misfit(x, P, at, row, z, R)
    if fit == math.inf:
        return -1
    H, columns = np.empty((4, SEEN)), np.empty(SEEN, np.int64)
    _derivative(x, row, at, z, H, columns)
    if not correct(x, P, _innovation(x, at, z), H, columns, R, limits[0]) <= limits[0]:
        return 0
    x[at + 3] = wrap_angle(x[at + 3])
    return 1


@kernel
def place(x: Vector, P: Vector, at: int, row: Vector, sighting: Vector, errors: Vector) -> None:
    """Put the gate ``at`` where one ``sighting`` (43,) from the step ``row`` shows it, forgetting what was known of it.

    The gate is as uncertain as vehicle and sighting together, and correlated with both.
    """
    z, R = np.empty(4), np.empty((4, 4))
    H, columns = np.empty((4, SEEN)), np.empty(SEEN, np.int64)
    sighted(x, row, sighting, errors, z, R)
    for i in range(3):
        x[at + i] = x[POSITION + i] + z[i]
    x[at + 3] = z[3]
    _derivative(x, row, at, z, H, columns)
    for k in range(GATE):
        P[at + k, :] = 0.0
        P[:, at + k] = 0.0
    # The gate is where the innovation is nothing: g = -H_rest x, with the derivative by all but the gate.
    for j in range(x.size):
        for k in range(GATE):
            total = 0.0
            for c in range(FROM):
                total -= H[k, c] * P[columns[c], j]
            P[at + k, j] = total
    for k in range(GATE):
        for j in range(x.size):
            if not at <= j < at + GATE:
                P[j, at + k] = P[at + k, j]
    for k in range(GATE):
        for m in range(GATE):
            total = R[k, m]
            for c in range(FROM):
                total -= P[at + k, columns[c]] * H[m, c]
            P[at + k, at + m] = total
