"""Thrust map, motor lag and drag, from how the velocity changed.

The specific force is F(t) R z - R D Rᵀ v, with the collective thrust F behind delay and motor lag and linear drag D
along the body's axes (M. Faessler, A. Franchi and D. Scaramuzza, "Differential flatness of quadrotor dynamics subject
to rotor drag", 2018). Integrated over short windows it is compared with what the velocity gained: that needs neither
the accelerometer, whose bias would look like a wrong hover thrust, nor a derivative. Of the throttle u the thrust is
(V / V₀)ᵖ (a u + b u²), where V is the battery's voltage, smoothed; p is near 2 where the motors slow down with it, 0
where the autopilot makes up for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from flightapp.frames import GRAVITY, Vector, quat_to_matrix
from flightapp.identification.fitting import Fit, Indices, Start, explained, robust_fit
from flightapp.identification.lags import lagged
from flightapp.identification.series import Stretch

WINDOW = 0.1
"""s."""
BLOCK = 5.0
"""s over which errors are correlated: gusts, and the tracker's slow errors of tilt."""

A, B, DELAY, LAG, EXPONENT, DRAG = 0, 1, 2, 3, 4, 5
"""Places of the parameters; the drag has three."""
SIZE = 8
STEPS = np.array((1.0, 1.0, 0.01, 0.01, 0.5, 0.1, 0.1, 0.1))
# Rotors take longer than 10 ms; without a lag the thrust would jump with each command.
LOWER = np.array((1.0, -500.0, 0.0, 0.01, -1.0, -1.0, -1.0, -1.0))
UPPER = np.array((500.0, 500.0, 0.2, 0.5, 4.0, 10.0, 10.0, 10.0))


@dataclass(frozen=True, slots=True)
class ForceFit:
    """What was found; what was not free is as it was given."""

    values: Vector
    """(8,): a, b (m/s²), delay and lag of the thrust (s), exponent, drag (1/s)."""
    covariance: Vector
    """(8, 8), zero where not free."""
    explained: Vector
    """(3,) share of the variance of the velocity's changes along the world's axes, with gravity's taken out."""


@dataclass(frozen=True, slots=True)
class _Windows:
    """One stretch, cut into windows; k of them."""

    part: Stretch
    ends: Indices
    """(k + 1,) indices of the states at the windows' ends."""
    durations: Vector
    """(k, 1) s."""
    gained: Vector
    """(k, 3) m/s², world: mean specific force."""
    up: Vector
    """(m, 3) body z."""
    dragged: Vector
    """(3, k, 3) m/s, mean over a window of each body axis times the velocity along it."""
    battery: Vector
    """(m,) voltage over the reference; 1 where it is not known."""

    @classmethod
    def of(cls, part: Stretch, voltage: float) -> "_Windows":
        stride = max(round(WINDOW / float(np.median(np.diff(part.stamp)))), 1)
        ends = np.arange(0, part.stamp.size, stride)
        R = np.array([quat_to_matrix(q) for q in part.orientation])
        body = np.einsum("nji,nj->ni", R, part.velocity)
        durations = np.diff(part.stamp[ends])[:, None]
        gained = np.diff(part.velocity[ends], axis=0) / durations + np.array((0.0, 0.0, GRAVITY))
        dragged = [_means(part.stamp, R[:, :, k] * body[:, k : k + 1], ends) for k in range(3)]
        battery = part.voltage / voltage if np.isfinite(voltage) else np.ones(part.stamp.size)
        return cls(part, ends, durations, gained, R[:, :, 2].copy(), np.array(dragged), battery)

    def error(self, x: Vector) -> Vector:
        """(k, 3) m/s², model less measurement, without what is constant along the ground: wind."""
        u = self.part.throttle
        thrust = lagged(self.part.sent, x[A] * u + x[B] * u * u, float(x[DELAY]), float(x[LAG]), self.part.stamp)
        lift = _means(self.part.stamp, self.up * (thrust * self.battery ** x[EXPONENT])[:, None], self.ends)
        error: Vector = lift - np.tensordot(x[DRAG:], self.dragged, axes=1) - self.gained
        error[:, :2] -= np.median(error[:, :2], axis=0)
        return error


def fit_force(parts: Sequence[Stretch], given: Vector, free: Sequence[int], voltage: float) -> ForceFit:
    """Fit the parameters ``free`` (indices), beginning at and else keeping to ``given`` (8,).

    ``voltage`` is V₀, NaN where the battery is not known.
    """
    windows = [_Windows.of(part, voltage) for part in parts]
    gained = np.concatenate([w.gained for w in windows])
    kinds = np.tile(np.arange(3), gained.shape[0])
    times = [1_000_000 * i + (w.part.stamp[w.ends[1:]] // BLOCK).astype(int) for i, w in enumerate(windows)]
    blocks = np.repeat(np.concatenate(times), 3)
    index = np.array(free)

    def residuals(x: Vector) -> Vector:
        full = given.copy()
        full[index] = x
        return np.concatenate([w.error(full) for w in windows]).ravel()

    fit = robust_fit(residuals, Start(given[index], STEPS[index], LOWER[index], UPPER[index]), kinds, blocks)
    return _result(fit, given, index, gained)


def _result(fit: Fit, given: Vector, index: Indices, gained: Vector) -> ForceFit:
    values, covariance = given.copy(), np.zeros((SIZE, SIZE))
    values[index] = fit.values
    covariance[np.ix_(index, index)] = fit.covariance
    errors = fit.residuals.reshape(-1, 3)
    return ForceFit(values, covariance, np.array([explained(gained[:, k], errors[:, k]) for k in range(3)]))


def _means(stamps: Vector, values: Vector, ends: Indices) -> Vector:
    """(k, 3) mean of ``values`` (m, 3) over each window."""
    total = cumulative_trapezoid(values, stamps, axis=0, initial=0.0)[ends]
    means: Vector = np.diff(total, axis=0) / np.diff(stamps[ends])[:, None]
    return means
