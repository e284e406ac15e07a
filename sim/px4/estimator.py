"""EKF2 on external vision, as a model: the truth, seen from the tracker's drifting frame, with a slow error.

No filter runs: what EKF2 would believe is the true motion, moved by the low-passed offset of the external vision from
the truth (so that the vehicle flies in the tracker's frame), plus an Ornstein-Uhlenbeck error of the measured size.
Gating, resets and time-outs follow src/modules/ekf2/EKF/aid_sources/external_vision (ev_control.cpp,
ev_pos_control.cpp, ev_vel_control.cpp) of PX4 v1.16; position and heading are gated together here, each axis by itself
there. While a velocity is rejected, positions alone say how fast their offset moves.
"""

import math
from dataclasses import dataclass

import numpy as np

from flightapp.frames import Vector, quat_conjugate, quat_from_yaw, quat_multiply, quat_rotate, quat_yaw
from sim.plant import Plant
from sim.px4.parameters import Parameters

ERROR = np.array((0.03, 0.03, 0.03, 0.07, 0.07, 0.07))
"""m and m/s: standard deviation of the estimate's error (1–5 cm and 2–13 cm/s measured)."""
_ERROR_RATE = 1.0 / np.array((2.0, 2.0, 2.0, 0.5, 0.5, 0.5))
"""1/s, inverse of its correlation time."""
SMOOTHING = 0.25
"""s, time constant with which the external vision's offset is taken over."""
DRIFT = 0.1
"""m/s², standard deviation of the horizontal acceleration error that is integrated while nothing aids."""
BAROMETER, BAROMETER_TIME = 0.15, 3.0
"""m/s, standard deviation of the vertical velocity's error while only the barometer gives the height, and s, its
correlation time: a filter with EKF2's default noises (EKF2_BARO_NOISE 3.5 m at 20 Hz, EKF2_ACC_NOISE 0.35 m/s² at
100 Hz) settles within about 5 s, so that 0.02 m/s² of the accelerometer or 0.3 m of the air's pressure make as much."""
INTERVAL = 0.2
"""s, EV_MAX_INTERVAL: fusion starts with two samples within it, and stops after twice as long without one."""
REJECTED = 1.0
"""s, no_aid_timeout_max: rejected for so long, a measurement is reset to."""
VELOCITY_RESETS = 5
"""Times that a velocity is reset to while the other vision goes on being fused (_nb_ev_vel_reset_available)."""
OLDEST = 1.0
"""s, samples older than that are dropped."""
SIGMA = 0.03
"""m and rad, the filter's own standard deviation while it is aided."""
VELOCITY_SIGMA = 0.05
"""m/s, the filter's own standard deviation of the velocity while it is aided."""
ATTITUDE_NOISE = 0.02
"""rad, EKF2_EVA_NOISE."""
_HORIZONTAL, _VERTICAL, _VELOCITY, _YAW = 1, 2, 4, 8
"""Bits of EKF2_EV_CTRL."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """What EKF2 believes; body FLU, in a local frame whose z is up: that of the external vision."""

    stamp: float
    position: Vector
    """(3,) m."""
    orientation: Vector
    """(4,) body to local."""
    velocity: Vector
    """(3,) m/s, along the local axes."""
    angular_velocity: Vector
    """(3,) rad/s, body."""
    position_valid: bool
    """Horizontal position and velocity."""
    altitude_valid: bool
    """Height and vertical velocity."""
    resets: int
    """How often the position was reset; wraps at 256, as on the link."""


class Ekf2:
    """The estimator of one vehicle; ``seed`` gives its errors. Times are the plant's."""

    def __init__(self, plant: Plant, parameters: Parameters, seed: int) -> None:
        self._plant = plant
        self._parameters = parameters
        self._rng = np.random.default_rng([seed, 0xA9])
        self._error = ERROR * self._rng.standard_normal(6)
        self._drift = DRIFT * self._rng.standard_normal(3) * (1.0, 1.0, 0.5)
        self._time = plant.time
        self.restart()

    def restart(self) -> None:
        """Know nothing, as after a boot."""
        self._offset, self._velocity_offset, self._yaw = np.zeros(3), np.zeros(3), 0.0
        self._sampled = self._fused = self._aided = self._velocity_fused = -math.inf
        self._seen_offset, self._velocity_resets = np.zeros(3), VELOCITY_RESETS
        self._counter: int | None = None
        self.fusing = False
        """Whether external vision is being fused."""
        self.resets = 0
        self.move, self.turn = np.zeros(3), 0.0
        """By how much resets moved the position, m, and turned the heading, rad, since `take_move`."""

    def vision(
        self,
        now: float,
        stamp: float,
        position: Vector,
        orientation: Vector,
        velocity: Vector | None,
        reset_counter: int,
    ) -> None:
        """One pose (body FLU in the tracker's frame, z up) of ``stamp``, which EKF2_EV_DELAY corrects."""
        self.update(now)
        sampled = stamp - 1e-3 * float(self._parameters["EKF2_EV_DELAY"])
        finite = math.isfinite(float(position.sum() + orientation.sum()))
        if not finite or not self._sampled < sampled or now - sampled > OLDEST:
            return
        interval, self._sampled = sampled - self._sampled, sampled
        control = int(self._parameters["EKF2_EV_CTRL"])
        # Without a heading, positions in a north-aligned frame can't be used.
        if not (control & _HORIZONTAL and control & _YAW):
            return
        try:
            offset, velocity_offset, yaw = self._measured(sampled, position, orientation, velocity, control)
        except ValueError:  # before the simulation began
            return
        jumped = self._counter is not None and reset_counter != self._counter
        self._counter = reset_counter
        if not self.fusing:
            if interval < INTERVAL:
                self._reset(now, offset, velocity_offset, yaw)
        elif jumped:
            self._reset(now, offset, velocity_offset, yaw)
        elif self._fits(offset, yaw):
            self._fuse(now, offset, self._moving(now, velocity_offset, (offset - self._seen_offset) / interval), yaw)
        elif now - self._fused > REJECTED:
            self._reset(now, offset, velocity_offset, yaw)
        self._seen_offset = offset

    def _measured(
        self, sampled: float, position: Vector, orientation: Vector, velocity: Vector | None, control: int
    ) -> tuple[Vector, Vector, float]:
        """Offset of the vision's position, velocity and heading from the truth at the same moment."""
        row = self._plant.state_at(min(sampled, self._plant.time))
        yaw = float(quat_yaw(quat_multiply(orientation, quat_conjugate(row[4:8]))))
        offset = position - row[1:4]
        if not control & _VERTICAL:
            offset[2] = self._offset[2]
        if velocity is None or not control & _VELOCITY or not math.isfinite(float(velocity.sum())):
            return offset, np.zeros(3), yaw
        return offset, velocity - quat_rotate(quat_from_yaw(yaw), row[8:11]), yaw

    def _fits(self, offset: Vector, yaw: float) -> bool:
        """Whether the innovation passes the gate."""
        gate, noise = float(self._parameters["EKF2_EVP_GATE"]), float(self._parameters["EKF2_EVP_NOISE"])
        most = gate * math.hypot(noise, SIGMA)
        turned = abs(math.remainder(yaw - self._yaw, math.tau))
        return float(np.abs(offset - self._offset).max()) <= most and turned <= gate * math.hypot(ATTITUDE_NOISE, SIGMA)

    def _fuse(self, now: float, offset: Vector, moving: Vector, yaw: float) -> None:
        keep = math.exp(-min(now - self._fused, INTERVAL) / SMOOTHING)
        self._offset = keep * self._offset + (1.0 - keep) * offset
        self._velocity_offset = keep * self._velocity_offset + (1.0 - keep) * moving
        self._yaw += (1.0 - keep) * math.remainder(yaw - self._yaw, math.tau)
        self._fused = now

    def _moving(self, now: float, told: Vector, shown: Vector) -> Vector:
        """How fast the offset moves, (3,) m/s: as the velocities have ``told``, or as the positions have ``shown``."""
        gate, noise = float(self._parameters["EKF2_EVV_GATE"]), float(self._parameters["EKF2_EVV_NOISE"])
        if float(np.abs(told - self._velocity_offset).max()) <= gate * math.hypot(noise, VELOCITY_SIGMA):
            self._velocity_fused = now
            return told
        if now - self._velocity_fused > REJECTED and self._velocity_resets > 0:
            self._velocity_resets -= 1
            self._velocity_fused = now
            self._velocity_offset = told
        return shown

    def _reset(self, now: float, offset: Vector, velocity_offset: Vector, yaw: float) -> None:
        self.move += offset - self._offset
        self.turn += math.remainder(yaw - self._yaw, math.tau)
        self._offset, self._velocity_offset, self._yaw = offset, velocity_offset, yaw
        self._fused, self._velocity_fused, self.fusing = now, now, True
        self.resets = (self.resets + 1) % 256

    def take_move(self) -> tuple[Vector, float]:
        """By how much resets have moved the position (3,) m and turned the heading, rad, since the last call."""
        taken = self.move, self.turn
        self.move, self.turn = np.zeros(3), 0.0
        return taken

    def update(self, now: float) -> None:
        """Go on to ``now``: the error wanders, fusion stops without samples, and without aid the estimate drifts."""
        dt = now - self._time
        if dt <= 0.0:
            return
        self._time = now
        keep = np.exp(-dt * _ERROR_RATE)
        self._error = keep * self._error + ERROR * np.sqrt(1.0 - keep * keep) * self._rng.standard_normal(6)
        if self.fusing and now - self._sampled > 2.0 * INTERVAL:
            self.fusing = False
        self._offset = self._offset + dt * self._velocity_offset
        if self.fusing:
            self._aided = now
        elif self._aided > -math.inf:
            self._go_blind(dt)

    def _go_blind(self, dt: float) -> None:
        """Integrate for ``dt`` s what is felt; the barometer bounds the vertical velocity's error."""
        vertical = float(self._velocity_offset[2])
        self._velocity_offset = self._velocity_offset + dt * self._drift
        if self._barometer:
            keep = math.exp(-dt / BAROMETER_TIME)
            spread = BAROMETER * math.sqrt(1.0 - keep * keep)
            self._velocity_offset[2] = keep * vertical + spread * self._rng.standard_normal()

    @property
    def position_valid(self) -> bool:
        """Whether there is a horizontal position, as of the last `update`: it outlives its aid by EKF2_NOAID_TOUT."""
        return self._time - self._aided < 1e-6 * float(self._parameters["EKF2_NOAID_TOUT"])

    @property
    def altitude_valid(self) -> bool:
        """Whether there is a height: by vision, or by the barometer."""
        by_vision = bool(int(self._parameters["EKF2_EV_CTRL"]) & _VERTICAL) and self.position_valid
        return by_vision or self._barometer

    @property
    def _barometer(self) -> bool:
        return self._parameters["EKF2_BARO_CTRL"] == 1

    def estimate(self, now: float) -> Estimate:
        """The belief at ``now``; asking at other times draws other errors."""
        self.update(now)
        plant, turn = self._plant, quat_from_yaw(self._yaw)
        return Estimate(
            now,
            plant.position + self._offset + self._error[:3],
            quat_multiply(turn, plant.orientation),
            quat_rotate(turn, plant.velocity) + self._velocity_offset + self._error[3:],
            plant.angular_velocity,
            self.position_valid,
            self.altitude_valid,
            self.resets,
        )
