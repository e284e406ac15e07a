"""How much later than the motion a tracker's stamps are, from the motion itself.

Angular speed is the same in whatever axes and wherever on the body it is measured, so that of the tracker's poses is
that of a gyroscope but for the delay: the lag at which the two correlate best (generalised cross-correlation without
prefilter; Knapp and Carter 1976), refined between lags by a parabola, fitted around the peak. The standard error is the
delete-one jackknife over blocks of the recording (Efron 1982), which takes in whatever makes the blocks differ.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.inputs import BadInputError

Mask = NDArray[np.bool_]

LAG_MAX = 0.3
"""s, the greatest delay that is looked for."""
STEP = 0.0025
"""s, of the common grid."""
GAP = 0.1
"""s between samples that are not bridged."""
SMOOTHING = 0.05
"""s, width of the window with which both are smoothed alike: it moves nothing, and a vehicle turns no quicker."""
AROUND = 8
"""Lags on either side of the peak to which the parabola is fitted."""
BLOCKS = 10
SHORTEST = 5.0
"""s of motion that both must have in common."""
MOTION_MIN = 0.15
"""rad/s, standard deviation of the angular speed below which there is nothing to compare."""
PEAK_MIN = 0.5
"""Correlation below which the two do not measure the same motion."""
RIVAL, APART = 0.97, 0.08
"""Share of the peak's correlation that another peak, so many s away, must not reach."""
ERROR_MAX = 0.01
"""s, a standard error above this is no result."""
_REACH = round(LAG_MAX / STEP)


@dataclass(frozen=True, slots=True)
class Delay:
    """What was found."""

    delay: float
    """s by which the first's stamps are later than the second's."""
    error: float
    """s, standard error."""
    correlation: float
    """At the peak."""
    duration: float
    """s of motion that were compared."""


def find_delay(stamp: Vector, speed: Vector, reference_stamp: Vector, reference: Vector) -> Delay:
    """The delay of angular ``speed`` (n,) rad/s at ``stamp`` (n,) s against ``reference`` (m,) at its stamps (m,).

    Stamps ascend. Raises `BadInputError` where the two do not tell it: too short, too still, not alike or periodic.
    """
    begin, end = max(stamp[0], reference_stamp[0]), min(stamp[-1], reference_stamp[-1])
    if not end - begin - 2.0 * LAG_MAX >= SHORTEST:
        raise BadInputError(f"the recordings have {max(end - begin, 0.0):.1f} s in common; {SHORTEST:g} s are needed")
    grid = np.arange(begin, end, STEP)
    a, a_known = resampled(stamp, speed, grid)
    b, b_known = resampled(reference_stamp, reference, grid)
    for values, known, what in ((a, a_known, "poses"), (b, b_known, "reference")):
        _check_motion(values[known], what)
    sums = _sums(a, a_known, b, b_known)
    whole = sums.sum(axis=0)
    peak, correlation = _peak(_correlations(whole))
    without = np.array([_peak(_correlations(whole - block))[0] for block in sums])
    error = float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((without - without.mean()) ** 2)))
    if error > ERROR_MAX:
        raise BadInputError(f"parts of the recording tell different delays (standard error {1e3 * error:.1f} ms)")
    return Delay(peak, error, correlation, float(whole[_REACH, 0]) * STEP)


def resampled(stamp: Vector, values: Vector, grid: Vector) -> tuple[Vector, Mask]:
    """``values`` smoothed on ``grid``, and where they are known: not in gaps, nor beside what is not finite."""
    good = np.isfinite(values)
    stamp, values = stamp[good], values[good]
    if len(stamp) < 2:
        return np.zeros_like(grid), np.zeros(len(grid), bool)
    after = np.clip(np.searchsorted(stamp, grid), 1, len(stamp) - 1)
    known = (stamp[after] - stamp[after - 1] <= GAP) & (grid >= stamp[0]) & (grid <= stamp[-1])
    half = round(0.5 * SMOOTHING / STEP)
    window = np.hanning(2 * half + 3)[1:-1]
    return np.convolve(np.interp(grid, stamp, values), window / window.sum(), "same"), known


def _check_motion(values: Vector, what: str) -> None:
    spread = float(np.std(values)) if len(values) else 0.0
    if not spread >= MOTION_MIN:
        raise BadInputError(
            f"too little motion in the {what}: the angular speed varies by {spread:.3f} rad/s, and {MOTION_MIN:g} are"
            " needed; turn the vehicle to and fro, quickly and irregularly, about all axes"
        )


def _sums(a: Vector, a_known: Mask, b: Vector, b_known: Mask) -> Vector:
    """Of each block and lag, n, Σa, Σb, Σa², Σb² and Σab of the samples that both know: (blocks, lags, 6).

    At lag k, a is k steps later than b.
    """
    n = len(a)
    inner = np.arange(_REACH, n - _REACH)
    a_mean, b_mean = a[a_known].mean(), b[b_known].mean()
    b, b_weight = (b - b_mean)[inner], b_known[inner]
    edges = np.linspace(0, len(inner), BLOCKS + 1).astype(int)[:-1]
    sums = np.empty((BLOCKS, 2 * _REACH + 1, 6))
    for k in range(-_REACH, _REACH + 1):
        weight = (a_known[inner + k] & b_weight).astype(float)
        x, y = (a[inner + k] - a_mean) * weight, b * weight
        terms = np.stack((weight, x, y, x * x, y * y, x * y))
        sums[:, k + _REACH] = np.add.reduceat(terms, edges, axis=1).T
    return sums


def _correlations(sums: Vector) -> Vector:
    """Pearson's correlation at each lag, from the sums (lags, 6)."""
    n, x, y, xx, yy, xy = np.moveaxis(sums, -1, 0)
    n = np.maximum(n, 1.0)
    spread = np.sqrt(np.maximum((xx - x * x / n) * (yy - y * y / n), 1e-12))
    correlations: Vector = (xy - x * y / n) / spread
    return correlations


def _peak(correlations: Vector) -> tuple[float, float]:
    """Lag (s) and height of the highest correlation, between the samples; raises `BadInputError` for none."""
    k = int(np.argmax(correlations))
    height = float(correlations[k])
    if height < PEAK_MIN:
        raise BadInputError(f"the two do not show the same motion: they correlate by {height:.2f} at most")
    if not 0 < k < len(correlations) - 1:
        raise BadInputError(f"the delay is beyond {LAG_MAX:g} s, or the two do not show the same motion")
    lags = (np.arange(len(correlations)) - _REACH) * STEP
    middle = correlations[1:-1]
    local = (middle >= correlations[:-2]) & (middle >= correlations[2:]) & (np.abs(lags[1:-1] - lags[k]) > APART)
    if local.any() and middle[local].max() > RIVAL * height:
        rival = float(lags[1:-1][local][middle[local].argmax()])
        raise BadInputError(
            f"the motion repeats itself: {1e3 * lags[k]:.0f} ms and {1e3 * rival:.0f} ms fit equally well;"
            " move irregularly"
        )
    return _summit(correlations, k), height


def _summit(correlations: Vector, k: int) -> float:
    """Lag (s) of the summit of the parabola that fits best around the lag ``k``."""
    reach = min(AROUND, k, len(correlations) - 1 - k)
    steps = np.arange(-reach, reach + 1)
    curve, slope, _ = np.polyfit(steps, correlations[k - reach : k + reach + 1], 2)
    shift = -0.5 * slope / min(curve, -1e-12)
    return float(k - _REACH + np.clip(shift, -reach, reach)) * STEP
