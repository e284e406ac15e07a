"""How a tracker is turned in the body, and where it sits, against the autopilot's inertial sensors.

Turning is the same everywhere on a body, so the tracker's angular velocities are the gyroscope's in other axes: the
rotation between them by G. Wahba's problem (1965), solved by W. Kabsch's method (1976), with the gyroscope's bias taken
out as the difference of the means. A point away from the inertial sensors feels ω̇ × s + ω × (ω × s) more than they do:
its place s and the accelerometer's bias by linear least squares. Standard deviations are delete-one jackknives over
blocks of the recording (Efron 1982), which take in whatever makes the blocks differ.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flightapp.frames import GRAVITY, Vector
from flightapp.inputs import BadInputError
from flightapp.sensors.delay import STEP, Mask, find_delay, resampled

Rows = NDArray[np.intp]

BLOCKS = 10
TURNING_MIN = 0.15
"""rad/s, standard deviation of the turning about the axis about which there was second most of it, that is needed."""
ROTATION_MAX = math.radians(0.5)
"""Greatest standard deviation of the rotation that is to be relied on;"""
PLACE_MAX = 0.015
"""m, of the place."""
UP = np.array((0.0, 0.0, GRAVITY))


@dataclass(frozen=True, slots=True)
class Tracked:
    """What a tracker measured, n rows by ascending stamps."""

    stamp: Vector
    """(n,) s."""
    orientation: Vector
    """(n, 4), scalar first."""
    velocity: Vector
    """(n, 3) m/s, in its frame, whose z is up."""
    angular_velocity: Vector
    """(n, 3) rad/s, in its own axes."""


@dataclass(frozen=True, slots=True)
class Felt:
    """What inertial sensors measured, m rows by ascending stamps."""

    stamp: Vector
    """(m,) s."""
    angular_velocity: Vector
    """(m, 3) rad/s."""
    specific_force: Vector | None
    """(m, 3) m/s²; None where there is only a gyroscope."""


@dataclass(frozen=True, slots=True)
class TrackerFound:
    """What was found; the body's axes are the inertial sensors'."""

    R_bt: Vector
    """(3, 3) the tracker's axes to the body's."""
    rotation_deviation: Vector
    """(3,) rad, about the body's axes."""
    place: Vector | None
    """(3,) m, of the tracker from the inertial sensors, body; None where nothing tells it."""
    place_deviation: Vector | None
    late: float
    """s by which the tracker's stamps are later."""
    late_deviation: float
    shortfalls: tuple[str, ...]
    """Why the rotation is not to be relied on; empty where it is."""
    place_shortfall: str
    """Why the place is not; empty where it is."""


def find_tracker(tracked: Tracked, felt: Felt) -> TrackerFound:
    """The tracker's mount; raises `BadInputError` where nothing can be told."""
    speeds = (np.linalg.norm(values, axis=1) for values in (tracked.angular_velocity, felt.angular_velocity))
    found = find_delay(tracked.stamp, next(speeds), felt.stamp, next(speeds))
    stamps = tracked.stamp - found.delay
    grid = np.arange(max(stamps[0], felt.stamp[0]), min(stamps[-1], felt.stamp[-1]), STEP)
    ours, ours_known = _smooth(stamps, tracked.angular_velocity, grid)
    theirs, theirs_known = _smooth(felt.stamp, felt.angular_velocity, grid)
    known = ours_known & theirs_known
    if np.count_nonzero(known) < 1000:
        raise BadInputError(f"only {np.count_nonzero(known) * STEP:.1f} s of motion are in both")
    blocks = np.array_split(np.flatnonzero(known), BLOCKS)
    every = np.concatenate(blocks)
    R = _rotation(theirs[every], ours[every])
    parts = [_without(blocks, i) for i in range(BLOCKS)]
    off = [(_rotation(theirs[part], ours[part]) * R.inv()).as_rotvec() for part in parts]
    deviation = _jackknife(np.array(off))
    turned = ours[every] - ours[every].mean(axis=0)
    second = float(np.linalg.svd(turned, compute_uv=False)[1]) / math.sqrt(len(every))
    place, place_deviation, why = None, None, "there is no accelerometer in the recording"
    if felt.specific_force is not None:
        place, place_deviation, why = _place(tracked, felt, felt.specific_force, stamps, grid, R, blocks)
    return TrackerFound(
        R.as_matrix(),
        deviation,
        place,
        place_deviation,
        found.delay,
        found.error,
        _shortfalls(second, deviation),
        why,
    )


def _smooth(stamp: Vector, values: Vector, grid: Vector) -> tuple[Vector, Mask]:
    """``values`` (n, k), smoothed on ``grid``, and where they are known."""
    columns = [resampled(stamp, column, grid) for column in values.T]
    known: Mask = np.logical_and.reduce([known for _, known in columns])
    return np.stack([smooth for smooth, _ in columns], axis=1), known


def _rotation(theirs: Vector, ours: Vector) -> Rotation:
    """From the tracker's axes to the body's, of angular velocities (n, 3) in both."""
    return Rotation.align_vectors(theirs - theirs.mean(axis=0), ours - ours.mean(axis=0))[0]


def _without(blocks: list[Rows], i: int) -> Rows:
    return np.concatenate(blocks[:i] + blocks[i + 1 :])


def _jackknife(values: Vector) -> Vector:
    """(k,) standard deviations, from results (blocks, k) of which each leaves one block out."""
    deviation: Vector = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((values - values.mean(axis=0)) ** 2, axis=0))
    return deviation


def _place(
    tracked: Tracked, felt: Felt, force: Vector, stamps: Vector, grid: Vector, R: Rotation, blocks: list[Rows]
) -> tuple[Vector, Vector, str]:
    """Place of the tracker, its standard deviations, and why it is not to be relied on."""
    velocity, _ = _smooth(stamps, tracked.velocity, grid)
    q = tracked.orientation.copy()
    q[1:] *= np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))[:, None]
    turned, _ = _smooth(stamps, q, grid)
    attitude = Rotation.from_quat(turned, scalar_first=True)
    there = R.apply(attitude.inv().apply(np.gradient(velocity, STEP, axis=0) + UP))
    here, _ = _smooth(felt.stamp, force, grid)
    w, _ = _smooth(felt.stamp, felt.angular_velocity, grid)
    squares, _ = _smooth(felt.stamp, _outer(felt.angular_velocity), grid)
    lever = _cross(np.gradient(w, STEP, axis=0)) + squares.reshape(-1, 3, 3)
    # ω × (ω × s) is (ω ωᵀ − |ω|² I) s; the last three columns are the accelerometer's bias
    rows = np.concatenate((lever, np.broadcast_to(np.eye(3), lever.shape)), axis=2)
    difference = there - here

    def solve(part: Rows) -> Vector:
        solution: Vector = np.linalg.lstsq(rows[part].reshape(-1, 6), difference[part].ravel(), rcond=None)[0][:3]
        return solution

    place = solve(np.concatenate(blocks))
    deviation = _jackknife(np.array([solve(_without(blocks, i)) for i in range(BLOCKS)]))
    if deviation.max() < PLACE_MAX:
        return place, deviation, ""
    return place, deviation, f"it is known to {1e3 * deviation.max():.0f} mm only: turn more quickly, about all axes"


def _outer(w: Vector) -> Vector:
    """(n, 9): ω ωᵀ − |ω|² I of each row."""
    product = w[:, :, None] * w[:, None, :] - np.sum(w * w, axis=1)[:, None, None] * np.eye(3)
    outer: Vector = product.reshape(-1, 9)
    return outer


def _cross(v: Vector) -> Vector:
    """(n, 3, 3): the matrices with which v × is multiplied."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    matrices: Vector = np.stack((zero, -z, y, z, zero, -x, -y, x, zero), axis=1).reshape(-1, 3, 3)
    return matrices


def _shortfalls(second: float, deviation: Vector) -> tuple[str, ...]:
    wanted = []
    if second < TURNING_MIN:
        wanted.append(
            f"the turning about a second axis was {second:.2f} rad/s (standard deviation), and {TURNING_MIN:g} are"
            " needed: turn the vehicle quickly and irregularly about all axes"
        )
    if not deviation.max() < ROTATION_MAX:
        wanted.append(
            f"the rotation is known to {math.degrees(deviation.max()):.2f}° only (at most"
            f" {math.degrees(ROTATION_MAX):.1f}°)"
        )
    return tuple(wanted)
