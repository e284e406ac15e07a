"""Vehicle state from the poses of a tracker such as the T265, put into the world by its drift."""

import math
from enum import IntEnum

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector, quat_from_yaw, quat_multiply, quat_rotate, quat_rotate_inverse, wrap_angle
from flightapp.jit import assign, kernel
from flightapp.messages import Drift, PoseSample, VehicleState

NORM_TOLERANCE = 1e-3
"""How far a quaternion's length may be off 1 (it is then normalised)."""

RELOCALISED_AFTER = 10
"""Consistent samples after a jump that make it a relocalisation (50 ms at 200 Hz)."""


class Refusal(IntEnum):
    """Why a pose or a drift was refused."""

    NONE = 0
    NOT_FINITE = 1
    NOT_UNIT = 2
    STALE = 3
    """Not newer than the newest sample."""
    LOST = 4
    """The tracker itself reports that it has failed (confidence 0)."""
    JUMP = 5
    """Further from the last sample than the speed explains."""
    BAD_DRIFT = 6


# Everything is kept in one array, since each argument of a kernel costs a quarter of a microsecond:
# the sample (stamp, position, orientation, velocity, angular velocity, confidence); the memory (stamp,
# position and velocity of the newest sample; the same of the newest jump; how many jumps agreed; the drift
# in use; the drift to go to; whether there was a sample); the drift's covariance; the settings (position,
# velocity and attitude noise, greatest jump, time constant of the blending).
_SAMPLE = 15
_MEMORY = 24
_STAMP, _JUMP, _JUMPS, _DRIFT, _GOAL, _STARTED = 0, 7, 14, 15, 19, 23
_COVARIANCE = _SAMPLE + _MEMORY
_SETTINGS = _COVARIANCE + 16
_WORK = _SETTINGS + 5
# State: position, orientation, velocity, angular velocity, covariance.
_STATE = 13 + 81


@kernel
def _explained(memory: Vector, at: int, sample: Vector, max_jump: float) -> bool:
    """Whether the speed explains the way from the sample remembered ``at`` to this one."""
    dt = sample[0] - memory[at]
    way2 = before2 = now2 = 0.0
    for i in range(3):
        way2 += (sample[1 + i] - memory[at + 1 + i]) ** 2
        before2 += memory[at + 4 + i] ** 2
        now2 += sample[8 + i] ** 2
    reach = max_jump + math.sqrt(max(before2, now2)) * dt
    return bool(way2 <= reach * reach)


@kernel
def _remember(memory: Vector, at: int, sample: Vector) -> None:
    memory[at] = sample[0]
    for i in range(3):
        memory[at + 1 + i] = sample[1 + i]
        memory[at + 4 + i] = sample[8 + i]


@kernel
def _check(sample: Vector, memory: Vector, max_jump: float) -> int:
    """Refusal code of ``sample`` (15,); normalises its quaternion."""
    for i in range(_SAMPLE):
        if not math.isfinite(sample[i]):
            return 1
    norm = math.sqrt(sample[4] ** 2 + sample[5] ** 2 + sample[6] ** 2 + sample[7] ** 2)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        return 2
    for i in range(4, 8):
        sample[i] /= norm
    started = memory[_STARTED] > 0.0
    if started and sample[0] <= memory[_STAMP]:
        return 3
    if sample[14] <= 0.0:
        return 4
    if started and not _explained(memory, _STAMP, sample, max_jump):
        consistent = memory[_JUMPS] > 0.0 and sample[0] > memory[_JUMP] and _explained(memory, _JUMP, sample, max_jump)
        memory[_JUMPS] = memory[_JUMPS] + 1.0 if consistent else 1.0
        _remember(memory, _JUMP, sample)
        if memory[_JUMPS] < RELOCALISED_AFTER:
            return 5
    memory[_JUMPS] = 0.0
    return 0


@kernel
def _blend(memory: Vector, dt: float, time_constant: float) -> None:
    """Move the drift in use towards the newest one, first order."""
    share = 1.0 - math.exp(-dt / time_constant)
    for i in range(3):
        memory[_DRIFT + i] += share * (memory[_GOAL + i] - memory[_DRIFT + i])
    memory[_DRIFT + 3] += share * wrap_angle(memory[_GOAL + 3] - memory[_DRIFT + 3])


@kernel
def _compose(sample: Vector, drift: Vector, drift_covariance: Vector, noise: Vector, out: Vector) -> None:
    """World state into ``out`` (94,) from ``sample`` (15,) and ``drift`` (4,) with its covariance (4, 4).

    The covariance is the tracker's own noise plus G C Gᵀ, where G (9, 4) is the derivative of position,
    velocity and attitude (rotation vector in body axes) with respect to the drift.
    """
    q_wo = quat_from_yaw(drift[3])
    arm = quat_rotate(q_wo, sample[1:4])
    q_wb = quat_multiply(q_wo, sample[4:8])
    velocity = quat_rotate(q_wo, sample[8:11])
    up = quat_rotate_inverse(q_wb, np.array((0.0, 0.0, 1.0)))
    for i in range(3):
        out[i] = arm[i] + drift[i]
        out[7 + i] = velocity[i]
        out[10 + i] = sample[11 + i]
    assign(out[3:7], q_wb)
    G = np.zeros((9, 4))
    for i in range(3):
        G[i, i] = 1.0
        G[6 + i, 3] = up[i]
    G[0, 3], G[1, 3] = -arm[1], arm[0]
    G[3, 3], G[4, 3] = -velocity[1], velocity[0]
    GC = np.zeros((9, 4))
    for i in range(9):
        for k in range(4):
            for m in range(4):
                GC[i, m] += G[i, k] * drift_covariance[k, m]
    for i in range(9):
        for j in range(i, 9):
            total = noise[i // 3] ** 2 if i == j else 0.0
            for m in range(4):
                total += GC[i, m] * G[j, m]
            out[13 + 9 * i + j] = total
            out[13 + 9 * j + i] = total


@kernel
def _advance(work: Vector, out: Vector) -> int:
    """One step of the estimator: the refusal code, and the state in ``out`` (94,) where that is 0."""
    sample = work[:_SAMPLE]
    memory = work[_SAMPLE:_COVARIANCE]
    noise = work[_SETTINGS : _SETTINGS + 3]
    max_jump, blend = work[_SETTINGS + 3], work[_SETTINGS + 4]
    code = _check(sample, memory, max_jump)
    if code != 0:
        return code
    if memory[_STARTED] > 0.0:
        _blend(memory, sample[0] - memory[_STAMP], blend)
    else:
        assign(memory[_DRIFT : _DRIFT + 4], memory[_GOAL : _GOAL + 4])
        memory[_STARTED] = 1.0
    _remember(memory, _STAMP, sample)
    covariance = work[_COVARIANCE:_SETTINGS].reshape(4, 4)
    _compose(sample, memory[_DRIFT : _DRIFT + 4], covariance, noise, out)
    return 0


class TrackerEstimator:
    """The tracker's poses in the world: p_w = R_z(yaw) p_o + translation, with the newest `Drift`.

    A new drift is blended in with the time constant ``estimation.drift_blend``, so that corrections of
    the map don't step the state under the controller. A sample that the speed doesn't explain is refused
    until `RELOCALISED_AFTER` of them agree: then the tracker has relocalised, and is followed.
    """

    def __init__(self, config: Config) -> None:
        e = config.estimation
        work = self._work = np.zeros(_WORK)
        work[_SETTINGS:] = (e.position_noise, e.velocity_noise, e.attitude_noise, e.max_jump, e.drift_blend)
        self._motion = work[1:14]
        self._goal = work[_SAMPLE + _GOAL : _SAMPLE + _GOAL + 4]
        self._drift_covariance = work[_COVARIANCE:_SETTINGS].reshape(4, 4)
        self.counts: dict[Refusal, int] = {reason: 0 for reason in Refusal if reason is not Refusal.NONE}
        """How many samples (and drifts) were refused, by reason."""
        self.last_refusal = Refusal.NONE
        """Why the newest sample was refused; NONE where it was accepted."""

    def on_pose(self, sample: PoseSample) -> VehicleState | None:
        """The state at ``sample``'s stamp; None where the sample is refused, which `counts` tells of."""
        work, out = self._work, np.empty(_STATE)
        work[0], work[14] = sample.stamp, sample.confidence
        np.concatenate(
            (sample.position, sample.orientation, sample.velocity, sample.angular_velocity), out=self._motion
        )
        code = _advance(work, out)
        if code:
            self.last_refusal = Refusal(code)
            self.counts[self.last_refusal] += 1
            return None
        self.last_refusal = Refusal.NONE
        return VehicleState(sample.stamp, out[0:3], out[3:7], out[7:10], out[10:13], out[13:].reshape(9, 9))

    def on_drift(self, drift: Drift) -> None:
        """Take over ``drift``; one that is not finite is refused and counted."""
        row = np.array((*drift.translation, drift.yaw))
        if not (np.isfinite(row).all() and np.isfinite(drift.covariance).all()):
            self.counts[Refusal.BAD_DRIFT] += 1
            return
        self._goal[:] = row
        self._drift_covariance[:] = drift.covariance
