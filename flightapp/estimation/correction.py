"""Corrections of the joint filter, and by the tracker's poses in particular.

Each is one linear update with a χ² test (Y. Bar-Shalom, X. Li and T. Kirubarajan, "Estimation with Applications to
Tracking and Navigation", 2001): only a few columns of the measurement's derivative are not zero, and these are
given by their indices.

Nothing that is measured tells how all of it together is turned about the vertical. As the estimate moves, so does the
error that such a turn makes, and the covariance must follow (`_follow`), or else the filter takes the difference for
knowledge of the heading (T. Zhang et al., "Convergence and consistency analysis for a 3-D invariant-EKF SLAM", 2017).
For the same reason the derivatives by the heading are taken of what the state expects, not of what was measured.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.estimation.process import (
    CLIMB,
    CORE,
    DRIFT,
    GATE,
    GATING,
    KIND,
    MANOEUVRE,
    ODOM,
    POSITION,
    POSITION_NOISE,
    SCALE,
    SILENT,
    SLIP,
    SPEED,
    STAMP,
    VELOCITY,
    VELOCITY_NOISE,
    YAW,
    climb_share,
    predict,
    pushed,
)
from flightapp.frames import (
    Vector,
    quat_from_yaw,
    quat_rotate,
    wrap_angle,
)
from flightapp.jit import assign, kernel
from flightapp.linear import factor, whiten

SILENCE = 0.02
"""s without a pose from which the filter coasts on the inertial sensors."""


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
    chi2, moved = 0.0, np.zeros(n)
    for i in range(m):
        chi2 += nu[i] * nu[i]
    if not chi2 <= gate:
        return chi2
    for i in range(n):
        whiten(S, W[i])
        for k in range(m):
            moved[i] += W[i, k] * nu[k]
    for i in range(n):
        for j in range(i + 1):
            total = P[i, j]
            for k in range(m):
                total -= W[i, k] * W[j, k]
            P[i, j] = total
            P[j, i] = total
    _move(x, P, moved)
    return chi2


@kernel
def _move(x: Vector, P: Vector, moved: Vector) -> None:
    """Move ``x`` by ``moved`` (N,), and ``P`` along."""
    for i in range(x.size):
        x[i] += moved[i]
    x[YAW] = wrap_angle(x[YAW])
    _follow(P, moved)
    _follow(P.T, moved)


@kernel
def _follow(P: Vector, moved: Vector) -> None:
    """``P`` ← M P in place; given its transpose, P ← P Mᵀ.

    An error of the heading by ψ goes with errors ψ ẑ × a of each vector a, as when everything is turned. With a moved
    by Δa, M adds ψ ẑ × Δa to what was known of it.
    """
    for j in range(P.shape[1]):
        yaw = P[YAW, j]
        for a in (POSITION, VELOCITY, DRIFT, SLIP):
            P[a, j] -= moved[a + 1] * yaw
            P[a + 1, j] += moved[a] * yaw
        for a in range(CORE, moved.size, GATE):
            P[a, j] -= moved[a + 1] * yaw
            P[a + 1, j] += moved[a] * yaw


@kernel
def correct_despite(
    x: Vector,
    P: Vector,
    nu: Vector,
    H: Vector,
    columns: NDArray[np.int64],
    given: int,
    slope: Vector,
    R: Vector,
    gate: float,
) -> float:
    """As `correct`, as if the state ``given`` were known: it learns nothing, and the others no more than it allows.

    ``slope`` (m,) is the measurement's derivative by it, which is not in ``H``. With the others' errors being g times
    that of the state given, and what is independent of it, the gain is that for the latter part; the former becomes
    g - K (H g + slope) (S. Schmidt, "Application of state-space methods to navigation problems", 1966). The χ² is that
    of the whole innovation, to which the error of the state given contributes: by Sherman and Morrison's formula.
    """
    n, m = x.size, nu.size
    W, S, variance = np.empty((n, m)), np.empty((m, m)), P[given, given]
    g, spread = P[given] / variance, np.zeros(m)
    for i in range(m):
        for c in range(columns.size):
            spread[i] += H[i, c] * g[columns[c]]
    off = spread + slope
    for i in range(m):
        for j in range(m):
            S[i, j] = R[i, j] - variance * spread[i] * spread[j]
    if not innovate(P, H, columns, S.copy(), W, S):
        return math.inf
    whiten(S, nu)
    whiten(S, off)
    chi2: float = 0.0
    along, size = 0.0, 0.0
    for i in range(m):
        chi2 += nu[i] * nu[i]
        along += off[i] * nu[i]
        size += off[i] * off[i]
    chi2 -= variance * along * along / (1.0 + variance * size)
    if not chi2 <= gate:
        return chi2
    after, moved = g.copy(), np.zeros(n)
    for i in range(n):
        for k in range(m):
            W[i, k] -= variance * g[i] * spread[k]
        whiten(S, W[i])
        for k in range(m):
            moved[i] += W[i, k] * nu[k]
            after[i] -= W[i, k] * off[k]
    _lower(P, W, g, after, variance)
    _move(x, P, moved)
    return chi2


@kernel
def _lower(P: Vector, W: Vector, g: Vector, after: Vector, variance: float) -> None:
    """``P`` loses W Wᵀ, and its part g gᵀ times ``variance`` becomes that of ``after``."""
    for i in range(P.shape[0]):
        for j in range(i + 1):
            total = P[i, j] + variance * (after[i] * after[j] - g[i] * g[j])
            for k in range(W.shape[1]):
                total -= W[i, k] * W[j, k]
            P[i, j] = total
            P[j, i] = total


@kernel
def use_pose(x: Vector, P: Vector, row: Vector, s: Vector) -> float:
    """Correct with the tracker's position and velocity in ``row`` (22,); the greater of the two χ²."""
    nu, H, R = np.empty(3), np.zeros((3, 8)), np.zeros((3, 3))
    columns = np.empty(7, np.int64)
    r = quat_rotate(quat_from_yaw(x[YAW]), row[ODOM : ODOM + 3])
    for i in range(3):
        nu[i] = r[i] - x[POSITION + i] + x[DRIFT + i]
        columns[i], columns[3 + i] = POSITION + i, DRIFT + i
        H[i, i], H[i, 3 + i] = 1.0, -1.0
        R[i, i] = s[POSITION_NOISE] ** 2
    columns[6] = YAW
    H[0, 6], H[1, 6] = x[POSITION + 1] - x[DRIFT + 1], x[DRIFT] - x[POSITION]
    slope = np.zeros(3)
    chi2 = correct_despite(x, P, nu, H[:, :7], columns, SCALE, slope, R, s[GATING])
    r = quat_rotate(quat_from_yaw(x[YAW]), row[SPEED : SPEED + 3])
    wide = np.array((VELOCITY, VELOCITY + 1, VELOCITY + 2, SLIP, SLIP + 1, CLIMB, YAW))
    for i in range(3):
        share = climb_share(row, s) if i == 2 else 1.0
        slope[i] = -r[i]
        r[i] *= 1.0 + x[SCALE]
        nu[i] = r[i] + share * x[wide[3 + i]] - x[VELOCITY + i]
        H[i, i], H[i, 3 + i] = 1.0, -share
        R[i, i] = s[VELOCITY_NOISE] ** 2
    H[0, 6], H[1, 6] = x[VELOCITY + 1] - x[SLIP + 1], x[SLIP] - x[VELOCITY]
    return max(chi2, correct_despite(x, P, nu, H[:, :7], wide, SCALE, slope, R, s[GATING]))


@kernel
def step(x: Vector, P: Vector, before: Vector, row: Vector, s: Vector) -> float:
    """Predict to ``row`` (22,) and, where it is a pose, correct with it; its χ².

    A pose that contradicts the filter makes it less sure of its velocity: a force felt wrongly must not lock it out.
    After a silence the pose refutes what was felt in it, which then counts as nothing.
    """
    predict(x, P, before, row, s)
    if row[KIND] <= 0.0:
        return 0.0
    chi2 = use_pose(x, P, row, s)
    if row[SILENT] > SILENCE and not chi2 <= s[GATING]:
        pushed(P, s[MANOEUVRE] ** 2, row[SILENT])
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
    """Step through the ring ``rows`` (m, 22), numbers ``begin`` to before ``end``, from the step ``before``.

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
