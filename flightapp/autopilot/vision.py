"""The tracker's poses as MAVLink messages for PX4's EKF2 (external vision).

PX4's local frame is NED; with no compass and no GPS its north is whatever external vision says it is. Here it is the x
axis of the tracker's own frame: NED = (x, -y, -z), body FRD = (x, -y, -z) of body FLU. PX4 takes poses in frame NED as
absolute headings on v1.16 and on main; in frame FRD main doesn't arm.
"""

import math

from flightapp.autopilot.local_frame import LocalFrame
from flightapp.config import ExternalVision
from flightapp.frames import Vector, quat_normalize, quat_rotate_inverse, quat_to_euler
from flightapp.messages import PoseSample

NED, BODY_FRD, LOCAL_FRD = 1, 12, 20
"""MAV_FRAME."""
VIO = 3
"""MAV_ESTIMATOR_TYPE_VIO."""
POOR = 10.0
"""Standard deviations grow by this much where the tracker says that its confidence is low."""
_DIAGONAL = (0, 6, 11, 15, 18, 20)
"""Where the variances stand in the upper right triangle of a (6, 6) covariance, row by row."""


class VisionEncoder:
    """Makes the messages, with positions told in ``frame``; counts the poses that it refused."""

    def __init__(self, config: ExternalVision, frame: LocalFrame) -> None:
        self._config = config
        self._period = 0.9 / config.rate
        self._frame = frame
        self._sent = -math.inf
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
        place = self._frame.take(sample)
        if sample.stamp - self._sent < self._period:
            return None
        self._sent = sample.stamp
        if self._config.message == "position":
            return self._position(sample, place, stamp)
        return self._odometry(sample, place, stamp)

    def _odometry(self, sample: PoseSample, place: Vector, stamp: int) -> str:
        x, y, z = place.tolist()
        # PX4 refuses a quaternion whose length is off by more than 1e-5.
        orientation = quat_normalize(sample.orientation)
        qw, qx, qy, qz = orientation.tolist()
        vx, vy, vz = quat_rotate_inverse(orientation, sample.velocity).tolist()
        p, q, r = sample.angular_velocity.tolist()
        frame = NED if self._config.message == "odometry" else LOCAL_FRD
        pose, velocity = self._covariances[POOR if sample.confidence == 1 else 1.0]
        quality = (0, 25, 60, 100)[min(max(sample.confidence, 0), 3)]
        return (
            f'{{"time_usec":{stamp},"frame_id":{frame},"child_frame_id":{BODY_FRD},"x":{x:.9g},"y":{-y:.9g},'
            f'"z":{-z:.9g},"q":[{qw:.9g},{qx:.9g},{-qy:.9g},{-qz:.9g}],"vx":{vx:.9g},"vy":{-vy:.9g},"vz":{-vz:.9g},'
            f'"rollspeed":{p:.9g},"pitchspeed":{-q:.9g},"yawspeed":{-r:.9g},"pose_covariance":{pose},'
            f'"velocity_covariance":{velocity},"reset_counter":{self._frame.resets % 256},"estimator_type":{VIO},'
            f'"quality":{quality}}}'
        )

    def _position(self, sample: PoseSample, place: Vector, stamp: int) -> str:
        x, y, z = place.tolist()
        roll, pitch, yaw = quat_to_euler(quat_normalize(sample.orientation))
        pose, _ = self._covariances[POOR if sample.confidence == 1 else 1.0]
        return (
            f'{{"usec":{stamp},"x":{x:.9g},"y":{-y:.9g},"z":{-z:.9g},"roll":{roll:.9g},"pitch":{-pitch:.9g},'
            f'"yaw":{-yaw:.9g},"covariance":{pose},"reset_counter":{self._frame.resets % 256}}}'
        )


def _sound(sample: PoseSample) -> bool:
    total = sum(sample.position.tolist()) + sum(sample.orientation.tolist()) + sum(sample.velocity.tolist())
    if not math.isfinite(total + sum(sample.angular_velocity.tolist()) + sample.stamp):
        return False
    return sample.confidence > 0 and math.hypot(*sample.orientation.tolist()) > 0.5


def _covariance(linear: float, angular: float) -> str:
    """21 numbers of the triangle of a diagonal covariance, as JSON."""
    triangle = [0.0] * 21
    for i, place in enumerate(_DIAGONAL):
        triangle[place] = (linear if i < 3 else angular) ** 2
    return "[" + ",".join(f"{value:.6g}" for value in triangle) + "]"
