"""What the joint filter's state says, in the shape of messages."""

import numpy as np
from numpy.typing import NDArray

from flightapp.estimation.process import ATTITUDE, POSITION, RATES, TILT, VELOCITY, YAW, attitude
from flightapp.frames import Vector, quat_to_matrix
from flightapp.jit import assign, kernel

STATE = 13 + 81
"""Position (3), orientation (4), velocity (3), angular velocity (3), covariance (9, 9)."""
ATTITUDE_NOISE = 0.002
"""rad, of the tracker's attitude from one sample to the next, besides its slow tilt and heading errors."""


@kernel
def describe(x: Vector, P: Vector, row: Vector, out: Vector) -> None:
    """The vehicle's state at the step ``row`` (22,) into ``out`` (94,), with the rotation vector in body axes."""
    q_wb = attitude(x, row[ATTITUDE : ATTITUDE + 4])
    R = quat_to_matrix(q_wb)
    # What position, velocity and attitude's error are of the state.
    T = np.zeros((9, 9))
    columns = np.empty(9, np.int64)
    for i in range(3):
        out[i], out[7 + i], out[10 + i] = x[POSITION + i], x[VELOCITY + i], row[RATES + i]
        T[i, i], T[3 + i, 3 + i] = 1.0, 1.0
        columns[i], columns[3 + i] = POSITION + i, VELOCITY + i
        for j in range(3):
            T[6 + i, 6 + j] = R[j, i]
    assign(out[3:7], q_wb)
    columns[6], columns[7], columns[8] = TILT, TILT + 1, YAW
    _congruence(T, P, columns, out[13:].reshape(9, 9))
    for i in range(6, 9):
        out[13 + 10 * i] += ATTITUDE_NOISE**2


@kernel
def _congruence(T: Vector, P: Vector, columns: NDArray[np.int64], out: Vector) -> None:
    """T C Tᵀ into ``out`` (m, m), where C (k, k) is what ``P`` says of the ``columns``."""
    m, k = T.shape
    TC = np.zeros((m, k))
    for i in range(m):
        for c in range(k):
            if T[i, c] != 0.0:
                for d in range(k):
                    TC[i, d] += T[i, c] * P[columns[c], columns[d]]
    for i in range(m):
        for j in range(m):
            out[i, j] = 0.0
            for d in range(k):
                out[i, j] += TC[i, d] * T[j, d]


@kernel
def gates_from_vehicle(P: Vector, core: int, out: Vector) -> None:
    """Covariance of each gate's position and yaw relative to the vehicle's into ``out`` (n, 4, 4)."""
    T = np.zeros((4, 8))
    columns = np.empty(8, np.int64)
    for i in range(3):
        T[i, i], T[i, 4 + i] = 1.0, -1.0
        columns[4 + i] = POSITION + i
    T[3, 3], T[3, 7] = 1.0, -1.0
    columns[7] = YAW
    for g in range(out.shape[0]):
        for i in range(4):
            columns[i] = core + 4 * g + i
        _congruence(T, P, columns, out[g])
