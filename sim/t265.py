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
from flightapp.frames import Vector
from flightapp.jit import inlined, lean_kernel
from flightapp.messages import GroundTruth, PoseSample

HIGH_CONFIDENCE = 3
BLOCK = 256
"""Samples whose noise is drawn at once."""
NORMALS = 18

# Memory of a T265: its state, the constants, and the truth of the last sample.
_STAMP, _YAW, _DISTANCE, _TILT, _POSITION, _TRUE, _SCALE, _CLIMB = 0, 1, 2, 3, 5, 8, 11, 12
_CLIMB_SPEED, _EXCITATION, _YAW_WALK, _POSITION_WALK, _TILT_TIME, _TILT_SIZE = 13, 14, 15, 16, 17, 18
_POSITION_NOISE, _VELOCITY_NOISE, _ATTITUDE_NOISE, _RATE_NOISE, _SIZE = 19, 20, 21, 22, 23


class Tracker(Protocol):
    """A simulated source of body poses."""

    @property
    def rate(self) -> float:
        """Samples per second."""
        ...

    @property
    def next_latency(self) -> float:
        """s from the capture of the next sample to its arrival."""
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
    start_position: float = 0.003
    """m on each axis, by which the vehicle is put down beside the start (assumption: by hand, on a mark)."""
    start_yaw: float = 0.002
    """rad, by which its heading is off there (assumption: likewise)."""


@inlined
def _move(m: Vector, stamp: float, position: Vector, climb_rate: float, noise: Vector) -> None:
    """Integrate position and drift up to the true ``position`` (3,) at ``stamp``."""
    dx, dy, dz = position[0] - m[_TRUE], position[1] - m[_TRUE + 1], position[2] - m[_TRUE + 2]
    dt, length = stamp - m[_STAMP], math.sqrt(dx * dx + dy * dy + dz * dz)
    root = math.sqrt(length)
    m[_DISTANCE] += length
    m[_YAW] += root * m[_YAW_WALK] * noise[0]
    c, s = m[_SCALE] * math.cos(m[_YAW]), m[_SCALE] * math.sin(m[_YAW])
    m[_POSITION] += c * dx - s * dy + root * m[_POSITION_WALK] * noise[1]
    m[_POSITION + 1] += s * dx + c * dy + root * m[_POSITION_WALK] * noise[2]
    m[_POSITION + 2] += m[_SCALE] * dz + root * m[_POSITION_WALK] * noise[3] + climb_rate * dt
    keep = math.exp(-dt / m[_TILT_TIME])
    spread = m[_TILT_SIZE] * math.sqrt(1.0 - keep * keep)
    m[_TILT] = keep * m[_TILT] + spread * noise[4]
    m[_TILT + 1] = keep * m[_TILT + 1] + spread * noise[5]


@inlined
def _turned(yaw: float, x: float, y: float, z: float, q: Vector, out: Vector) -> None:
    """Unit quaternion yaw ⊗ exp(x, y, z) ⊗ ``q`` (4,) into ``out[3:7]``."""
    angle = math.sqrt(x * x + y * y + z * z)
    k = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    w, x, y, z = math.cos(0.5 * angle), k * x, k * y, k * z
    c, s = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    w, x, y, z = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
    out[3] = w * q[0] - x * q[1] - y * q[2] - z * q[3]
    out[4] = w * q[1] + x * q[0] + y * q[3] - z * q[2]
    out[5] = w * q[2] - x * q[3] + y * q[0] + z * q[1]
    out[6] = w * q[3] + x * q[2] - y * q[1] + z * q[0]
    scale = 1.0 / math.sqrt(out[3] * out[3] + out[4] * out[4] + out[5] * out[5] + out[6] * out[6])
    for i in range(3, 7):
        out[i] *= scale


@lean_kernel
def _measure(
    m: Vector, stamp: float, position: Vector, q: Vector, velocity: Vector, omega: Vector, noise: Vector, out: Vector
) -> None:
    """Move the tracker's memory ``m`` on to the true motion at ``stamp``, and measure that.

    ``noise`` (18,) is standard normal; ``out`` (13,) takes position, quaternion, velocity and angular velocity.
    """
    vx, vy, vz = velocity[0], velocity[1], velocity[2]
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    # Error of the vertical velocity.
    climb_rate = -m[_CLIMB] * math.exp(-m[_DISTANCE] / m[_EXCITATION]) * speed * min(speed, m[_CLIMB_SPEED]) ** 2
    if m[_STAMP] == -math.inf:
        for i in range(3):
            m[_POSITION + i] += position[i]
    else:
        _move(m, stamp, position, climb_rate, noise)
    m[_STAMP] = stamp
    c, s = m[_SCALE] * math.cos(m[_YAW]), m[_SCALE] * math.sin(m[_YAW])
    out[7], out[8], out[9] = c * vx - s * vy, s * vx + c * vy, m[_SCALE] * vz + climb_rate
    for i in range(3):
        m[_TRUE + i] = position[i]
        out[i] = m[_POSITION + i] + m[_POSITION_NOISE] * noise[9 + i]
        out[7 + i] += m[_VELOCITY_NOISE] * noise[12 + i]
        out[10 + i] = omega[i] + m[_RATE_NOISE] * noise[15 + i]
    a = m[_ATTITUDE_NOISE]
    _turned(m[_YAW], m[_TILT] + a * noise[6], m[_TILT + 1] + a * noise[7], a * noise[8], q, out)


class T265:
    """The model with its state; one instance is one flight.

    Its odom frame lies on the world frame at the first sample, as after alignment with the start, but for what the
    vehicle was put down beside it.
    """

    def __init__(self, seed: int | np.random.SeedSequence, errors: T265Errors | None = None) -> None:
        e = self._errors = errors or T265Errors()
        self._random = np.random.default_rng(seed)
        m = self._memory = np.zeros(_SIZE)
        m[_STAMP] = -math.inf
        m[_SCALE] = 1.0 + self._random.normal(e.scale_mean, e.scale)
        m[_CLIMB] = e.climb * self._random.normal(1.0, e.climb_spread)
        m[_TILT : _TILT + 2] = self._random.normal(0.0, e.tilt, 2)
        m[_POSITION : _POSITION + 3] = self._random.normal(0.0, e.start_position, 3)
        m[_YAW] = self._random.normal(0.0, e.start_yaw)
        m[_CLIMB_SPEED], m[_EXCITATION], m[_YAW_WALK] = e.climb_speed, e.excitation, e.yaw_walk
        m[_POSITION_WALK], m[_TILT_TIME], m[_TILT_SIZE] = e.position_walk, e.tilt_time, e.tilt
        m[_POSITION_NOISE], m[_VELOCITY_NOISE] = e.position_noise, e.velocity_noise
        m[_ATTITUDE_NOISE], m[_RATE_NOISE] = e.attitude_noise, e.rate_noise
        self._lost = 0
        self._draw()

    def _draw(self) -> None:
        """Draw the next block of noise, latencies and chances of loss."""
        self._noise = self._random.standard_normal((BLOCK, NORMALS))
        self._latencies: list[float] = self._random.uniform(*self._errors.latency, BLOCK).tolist()
        self._chances: list[float] = self._random.random(BLOCK).tolist()
        self._next = 0

    @property
    def rate(self) -> float:
        """Samples per second."""
        return self._errors.rate

    @property
    def latency(self) -> float:
        """Mean time from capture to arrival, s."""
        return 0.5 * sum(self._errors.latency)

    @property
    def next_latency(self) -> float:
        """s from the capture of the next sample to its arrival."""
        return self._latencies[self._next]

    def sample(self, truth: GroundTruth) -> tuple[PoseSample, float] | None:
        """What is measured of ``truth`` (stamps ascending) and the stamp of its arrival; None where lost."""
        i, stamp, out = self._next, truth.stamp, np.empty(13)
        _measure(
            self._memory,
            stamp,
            truth.position,
            truth.orientation,
            truth.velocity,
            truth.angular_velocity,
            self._noise[i],
            out,
        )
        arrival, lost = stamp + self._latencies[i], self._is_lost(self._chances[i])
        self._next = i + 1
        if self._next == BLOCK:
            self._draw()
        if lost:
            return None
        return PoseSample(stamp, out[0:3], out[3:7], out[7:10], out[10:13], HIGH_CONFIDENCE), arrival

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

    @property
    def next_latency(self) -> float:
        """s from capture to arrival: none."""
        return 0.0

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
