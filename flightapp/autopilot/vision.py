"""The tracker's poses as MAVLink messages for PX4's EKF2 (external vision).

PX4's local frame is NED; with no compass and no GPS its north is whatever external vision says it is. Here it is the x
axis of the tracker's own frame: NED = (x, -y, -z), body FRD = (x, -y, -z) of body FLU. PX4 takes poses in frame NED as
absolute headings on v1.16 and on main; in frame FRD main doesn't arm.

The origin of PX4's local frame is put where the vehicle stands. Without a global position PX4's takeoff climbs over the
origin of that frame, from wherever it begins, and to the takeoff height above it (navigator_main.cpp and takeoff.cpp
of v1.16: an unset target reads as latitude, longitude and altitude 0).
"""

import math

from flightapp.config import ExternalVision
from flightapp.frames import Vector
from flightapp.messages import PoseSample

NED, BODY_FRD, LOCAL_FRD = 1, 12, 20
"""MAV_FRAME."""
VIO = 3
"""MAV_ESTIMATOR_TYPE_VIO."""
POOR = 10.0
"""Standard deviations grow by this much where the tracker says that its confidence is low."""
MOVED = 0.1
"""m from the origin, less than which a takeoff may begin beside it."""
SETTLING = 1.0
"""s that PX4's estimator and its checks may take to follow a reset of external vision on the ground."""
_DIAGONAL = (0, 6, 11, 15, 18, 20)
"""Where the variances stand in the upper right triangle of a (6, 6) covariance, row by row."""


class VisionEncoder:
    """Makes the messages; counts what it held back, and the tracker's resets."""

    def __init__(self, config: ExternalVision) -> None:
        self._config = config
        self._period = 0.9 / config.rate
        self._last: PoseSample | None = None
        self._sent = -math.inf
        self.origin: Vector | None = None
        """(3,) m, where PX4's local frame has its origin in the tracker's; None before the first good pose."""
        self.resets = 0
        """Jumps of the tracker so far; PX4 is told by the reset counter and follows at once."""
        self.refused = 0
        """Poses that were not finite, or without any confidence."""
        self._name = "VISION_POSITION_ESTIMATE" if config.message == "position" else "ODOMETRY"
        self._covariances = {
            factor: (
                _covariance(factor * config.position_noise, factor * config.attitude_noise),
                _covariance(factor * config.velocity_noise, factor * config.velocity_noise),
            )
            for factor in (1.0, POOR)
        }

    @property
    def name(self) -> str:
        """The MAVLink message that is sent."""
        return self._name

    def encode(self, sample: PoseSample, stamp: int) -> str | None:
        """Fields of the message, as JSON, for ``sample``; ``stamp`` is its time of capture in µs.

        None where it isn't time for the next one yet, or the sample is no good.
        """
        if not _sound(sample):
            self.refused += 1
            return None
        if self.origin is None:
            self.origin = sample.position.copy()
        self._watch(sample)
        if sample.stamp - self._sent < self._period:
            return None
        self._sent = sample.stamp
        return self._position(sample, stamp) if self._config.message == "position" else self._odometry(sample, stamp)

    def move_origin(self) -> bool:
        """Put the origin where the last pose was; whether that moved it, which PX4 is then told as a reset."""
        if self.origin is None or self._last is None or math.dist(self.origin, self._last.position) < MOVED:
            return False
        self.origin = self._last.position.copy()
        self.resets += 1
        return True

    def _place(self, sample: PoseSample) -> tuple[float, float, float]:
        """Where ``sample`` is from the origin, in the axes of the tracker's frame."""
        x, y, z = (sample.position - (sample.position if self.origin is None else self.origin)).tolist()
        return x, y, z

    def _watch(self, sample: PoseSample) -> None:
        """Count a reset where the tracker moved further than its speed explains."""
        last, self._last = self._last, sample
        if last is None:
            return
        elapsed = max(sample.stamp - last.stamp, 0.0)
        moved = math.dist(sample.position, last.position)
        speed = max(math.hypot(*sample.velocity), math.hypot(*last.velocity))
        if moved > 1.5 * speed * elapsed + self._config.jump:
            self.resets += 1

    def _odometry(self, sample: PoseSample, stamp: int) -> str:
        x, y, z = self._place(sample)
        qw, qx, qy, qz = _unit(sample.orientation.tolist())
        vx, vy, vz = _to_body(qw, qx, qy, qz, *sample.velocity.tolist())
        p, q, r = sample.angular_velocity.tolist()
        frame = NED if self._config.message == "odometry" else LOCAL_FRD
        pose, velocity = self._covariances[POOR if sample.confidence == 1 else 1.0]
        quality = (0, 25, 60, 100)[min(max(sample.confidence, 0), 3)]
        return (
            f'{{"time_usec":{stamp},"frame_id":{frame},"child_frame_id":{BODY_FRD},"x":{x:.9g},"y":{-y:.9g},'
            f'"z":{-z:.9g},"q":[{qw:.9g},{qx:.9g},{-qy:.9g},{-qz:.9g}],"vx":{vx:.9g},"vy":{-vy:.9g},"vz":{-vz:.9g},'
            f'"rollspeed":{p:.9g},"pitchspeed":{-q:.9g},"yawspeed":{-r:.9g},"pose_covariance":{pose},'
            f'"velocity_covariance":{velocity},"reset_counter":{self.resets % 256},"estimator_type":{VIO},'
            f'"quality":{quality}}}'
        )

    def _position(self, sample: PoseSample, stamp: int) -> str:
        x, y, z = self._place(sample)
        roll, pitch, yaw = _euler(*_unit(sample.orientation.tolist()))
        pose, _ = self._covariances[POOR if sample.confidence == 1 else 1.0]
        return (
            f'{{"usec":{stamp},"x":{x:.9g},"y":{-y:.9g},"z":{-z:.9g},"roll":{roll:.9g},"pitch":{-pitch:.9g},'
            f'"yaw":{-yaw:.9g},"covariance":{pose},"reset_counter":{self.resets % 256}}}'
        )


def _sound(sample: PoseSample) -> bool:
    total = sum(sample.position.tolist()) + sum(sample.orientation.tolist()) + sum(sample.velocity.tolist())
    if not math.isfinite(total + sum(sample.angular_velocity.tolist()) + sample.stamp):
        return False
    return sample.confidence > 0 and math.hypot(*sample.orientation.tolist()) > 0.5


def _unit(q: list[float]) -> tuple[float, float, float, float]:
    """``q`` with unit length: PX4 refuses what is off by more than 1e-5."""
    scale = 1.0 / math.hypot(*q)
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


def _to_body(w: float, x: float, y: float, z: float, vx: float, vy: float, vz: float) -> tuple[float, float, float]:
    """A vector turned by the inverse of a unit quaternion."""
    tx, ty, tz = 2.0 * (z * vy - y * vz), 2.0 * (x * vz - z * vx), 2.0 * (y * vx - x * vy)
    return (
        vx + w * tx + z * ty - y * tz,
        vy + w * ty + x * tz - z * tx,
        vz + w * tz + y * tx - x * ty,
    )


def _euler(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Roll, pitch and yaw of intrinsic z-y-x turns, rad, of a unit quaternion."""
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _covariance(linear: float, angular: float) -> str:
    """21 numbers of the triangle of a diagonal covariance, as JSON."""
    triangle = [0.0] * 21
    for i, place in enumerate(_DIAGONAL):
        triangle[place] = (linear if i < 3 else angular) ** 2
    return "[" + ",".join(f"{value:.6g}" for value in triangle) + "]"
