"""A model of the Intel RealSense T265 tracking camera, and an ideal tracker.

The model integrates the true motion with the errors that visual-inertial odometry has, and is calibrated
on table 9 of "Framework and Evaluation Methodology for Autonomous Drone Racing" (position RMSE of a T265
against motion capture, one-gate flights at v_max 1 to 4 m/s). That table reads as three effects:

* Along the flight the error is the same 0.10-0.12 m at every speed: a share of the distance, that is a
  scale error. The T265 is known to report too short a way (librealsense issues 3970 and 4174).
* Across, it is small (0.02-0.05 m): heading drift and a random walk with the distance.
* In height it grows from 0.10 to 0.34 m with the speed: a vertical velocity error. It is modelled as
  proportional to the cube of the speed (a square grows too slowly for the table) and as fading with the
  distance flown, as gravity direction, accelerometer bias and scale become observable once the camera has
  been moved about (which Intel's advice of librealsense issue 5239 asks for). Hence the error of a long
  flight stays bounded. Beyond the fastest measured speed nothing is known, and the factor stays constant.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector, quat_from_rotvec, quat_from_yaw, quat_multiply, quat_normalize
from flightapp.messages import GroundTruth, PoseSample

HIGH_CONFIDENCE = 3


class Tracker(Protocol):
    """A simulated source of body poses."""

    @property
    def rate(self) -> float:
        """Samples per second."""
        ...

    def sample(self, truth: GroundTruth) -> tuple[PoseSample, float] | None:
        """What is measured of ``truth``, and the stamp of its arrival; None where the sample is lost."""
        ...


@dataclass(frozen=True, slots=True)
class T265Errors:
    """Error budget of a T265; standard deviations unless said otherwise.

    Rate, latency and gyro follow the data sheets of the T265 and its BMI055; the systematic part is
    calibrated on table 9 (see the module's text). What has no source is an assumption, marked so.
    """

    rate: float = 200.0
    """Hz (T265 data sheet)."""
    scale_mean: float = -0.028
    """Share of the distance that is reported too much (table 9, x)."""
    scale: float = 0.005
    """Spread of it from flight to flight (assumption)."""
    climb: float = 0.0225
    """s²/m², mean vertical velocity error per cubed speed (table 9, z); reported too low."""
    climb_spread: float = 0.15
    """Share of `climb` by which flights differ (assumption)."""
    climb_speed: float = 4.2
    """m/s, fastest speed of table 11."""
    excitation: float = 4.0
    """m flown until `climb` has faded to 1/e."""
    yaw_walk: float = 0.006
    """rad/√m, heading drift (table 9, y)."""
    position_walk: float = 0.01
    """m/√m on each axis (table 9, y)."""
    tilt: float = 0.005
    """rad, slow error of roll and pitch (assumption)."""
    tilt_time: float = 5.0
    """s, correlation time of the tilt error (assumption)."""
    position_noise: float = 0.001
    """m, white (assumption: the T265's output is filtered)."""
    velocity_noise: float = 0.02
    """m/s, white (assumption)."""
    attitude_noise: float = 0.001
    """rad, white (assumption)."""
    rate_noise: float = 0.005
    """rad/s, white: BMI055, 0.014 °/s/√Hz over its bandwidth, and as much again for vibration."""
    loss: float = 0.001
    """Probability that a sample is the first of a lost run (assumption)."""
    loss_length: float = 4.0
    """Samples, mean length of a lost run (assumption)."""
    latency: tuple[float, float] = (0.004, 0.008)
    """s, least and greatest (6 ms from motion to output by the data sheet)."""


class T265:
    """The model with its state; one instance is one flight.

    Its odom frame lies on the world frame at the first sample, as after alignment with the known start.
    """

    def __init__(self, seed: int | np.random.SeedSequence, errors: T265Errors | None = None) -> None:
        e = self._errors = errors or T265Errors()
        self._random = np.random.default_rng(seed)
        self._scale = 1.0 + self._random.normal(e.scale_mean, e.scale)
        self._climb = e.climb * self._random.normal(1.0, e.climb_spread)
        self._tilt = self._random.normal(0.0, e.tilt, 2)
        self._yaw = 0.0
        self._distance = 0.0
        self._lost = 0
        self._true: GroundTruth | None = None
        self._position = np.zeros(3)

    @property
    def rate(self) -> float:
        """Samples per second."""
        return self._errors.rate

    @property
    def latency(self) -> float:
        """Mean time from capture to arrival, s."""
        return 0.5 * sum(self._errors.latency)

    def sample(self, truth: GroundTruth) -> tuple[PoseSample, float] | None:
        """What is measured of ``truth`` (stamps ascending) and the stamp of its arrival; None where lost."""
        noise = self._random.standard_normal(18)
        chance = self._random.random(2)
        climb_rate = self._advance(truth, noise[0:6])
        measured = self._measure(truth, climb_rate, noise[6:18])
        least, greatest = self._errors.latency
        arrival = truth.stamp + least + (greatest - least) * float(chance[0])
        return None if self._is_lost(chance[1]) else (measured, arrival)

    def _climb_rate(self, truth: GroundTruth) -> float:
        """Error of the vertical velocity, m/s."""
        e = self._errors
        speed = math.hypot(*truth.velocity.tolist())
        fading = math.exp(-self._distance / e.excitation)
        return -self._climb * fading * speed * min(speed, e.climb_speed) ** 2

    def _advance(self, truth: GroundTruth, noise: Vector) -> float:
        """Integrate position and drift up to ``truth``; returns the error of the vertical velocity, m/s."""
        e, before = self._errors, self._true
        self._true = truth
        climb_rate = self._climb_rate(truth)
        if before is None:
            self._position = truth.position.copy()
            return climb_rate
        dt = truth.stamp - before.stamp
        step = truth.position - before.position
        length = math.hypot(*step.tolist())
        self._distance += length
        self._yaw += math.sqrt(length) * e.yaw_walk * float(noise[0])
        self._position = self._position + self._turned(self._scale * step)
        self._position += math.sqrt(length) * e.position_walk * noise[1:4]
        self._position[2] += climb_rate * dt
        keep = math.exp(-dt / e.tilt_time)
        self._tilt = keep * self._tilt + e.tilt * math.sqrt(1.0 - keep * keep) * noise[4:6]
        return climb_rate

    def _turned(self, v: Vector) -> Vector:
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        x, y, z = v.tolist()
        return np.array((c * x - s * y, s * x + c * y, z))

    def _measure(self, truth: GroundTruth, climb_rate: float, noise: Vector) -> PoseSample:
        e = self._errors
        turn = e.attitude_noise * noise[0:3]
        turn[:2] += self._tilt
        off = quat_multiply(quat_from_yaw(self._yaw), quat_from_rotvec(turn))
        velocity = self._turned(self._scale * truth.velocity)
        velocity[2] += climb_rate
        return PoseSample(
            stamp=truth.stamp,
            position=self._position + e.position_noise * noise[3:6],
            orientation=quat_normalize(quat_multiply(off, truth.orientation)),
            velocity=velocity + e.velocity_noise * noise[6:9],
            angular_velocity=truth.angular_velocity + e.rate_noise * noise[9:12],
            confidence=HIGH_CONFIDENCE,
        )

    def _is_lost(self, chance: float) -> bool:
        if self._lost == 0 and chance < self._errors.loss:
            self._lost = int(self._random.geometric(1.0 / self._errors.loss_length))
        lost = self._lost > 0
        self._lost = max(self._lost - 1, 0)
        return lost


class IdealTracker:
    """The truth, at once."""

    @property
    def rate(self) -> float:
        """Samples per second."""
        return 200.0

    def sample(self, truth: GroundTruth) -> tuple[PoseSample, float] | None:
        """``truth`` itself, which arrives at its own stamp."""
        measured = PoseSample(
            truth.stamp,
            truth.position,
            truth.orientation,
            truth.velocity,
            truth.angular_velocity,
            HIGH_CONFIDENCE,
        )
        return measured, truth.stamp


def make_tracker(config: Config, seed: int | np.random.SeedSequence) -> Tracker:
    """The tracker that ``config.sim.tracker`` asks for."""
    return IdealTracker() if config.sim.tracker == "ideal" else T265(seed)
