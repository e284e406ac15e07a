"""The one door through which every tracker's poses come in: what is wrong with them, and where the body is.

| what is wrong | how it is told                                               | what is done                 |
| ------------ | ------------------------------------------------------------ | ---------------------------- |
| not finite   | a NaN or an infinity in any number                           | refused                      |
| implausible  | beyond `FAR`, `FAST`, `SPINNING` or `PUSHED`                 | refused                      |
| not unit     | quaternion's length off 1 by more than `UNIT`                | refused; normalised below it |
| future       | captured more than `AHEAD` from now                          | refused                      |
| stale        | captured more than sensors.pose_max_age ago                  | refused                      |
| duplicate    | the stamp of the newest sample again                         | refused                      |
| out of order | a stamp before the newest sample's                           | refused                      |
| lost         | confidence 0: the tracker says that it has failed            | refused                      |
| frozen       | position, orientation and velocity the same to the last bit  | refused until it moves; the  |
|              | for more than `FROZEN_AFTER` (a living tracker has noise)    | first 50 ms have passed      |
| jump         | further or more turned from the last sample that was taken   | refused, unless the samples  |
|              | than sensors.max_jump and the speed, sensors.max_turn_deg    | after it agree: then it is a |
|              | and the angular velocity explain                             | relocalisation               |
| relocalised  | `AGREEING` samples that agree for `AGREED_FOR` after a jump, | taken, with the next epoch   |
|              | or a source that says so by another epoch                    |                              |

The rows are tried in this order, the first that applies counts. Standing still is not frozen: a velocity of exactly
zero, after moving slower than `STANDING`, as from a simulated or very coarse tracker on the ground.

Refused samples leave a gap, as if the tracker had been silent: what follows coasts and says when that is too long.
After any of these the next good sample is taken at once, unless it is a jump.
"""

import math
from enum import IntEnum

import numpy as np

from flightapp.config import Config, Sensors
from flightapp.frames import Vector, quat_from_euler
from flightapp.messages import PoseSample
from flightapp.sensors import intake_steps as steps
from flightapp.track import Start

NO_ACCELERATION: Vector = np.zeros(3)


class PoseFault(IntEnum):
    """What is wrong with a sample; the module's table tells each."""

    NONE = 0
    NOT_FINITE = 1
    IMPLAUSIBLE = 2
    NOT_UNIT = 3
    FUTURE = 4
    STALE = 5
    DUPLICATE = 6
    OUT_OF_ORDER = 7
    LOST = 8
    FROZEN = 9
    JUMP = 10


class PoseIntake:
    """Takes a tracker's samples in the order of their arrival, and gives the body's; pure.

    What the tracker measures is its own motion, in its own frame, whose z must point up (against gravity; its
    horizontal origin and heading are the tracker's choice), with axes that are forward, left, up when it is mounted
    straight. The samples that come out are the body's (sensors.mount_position, sensors.mount_rpy_deg), stamped with
    the capture (sensors.delay), in odom: the tracker's frame or, with sensors.frame = "start", that frame moved and
    turned about z once, so that the first sample that is taken is at ``start`` (the origin, heading along x, if None).
    """

    def __init__(self, config: Config, start: Start | None = None) -> None:
        s = config.sensors
        self._settle(s, s.delay)
        w = self._work
        w[steps.ARM : steps.ARM + 3] = s.mount_position
        roll, pitch, yaw = np.radians(s.mount_rpy_deg).tolist()
        w[steps.MOUNT : steps.MOUNT + 4] = quat_from_euler(roll, pitch, yaw)
        w[steps.ALIGN] = s.frame == "start"
        if start is not None:
            w[steps.START : steps.START + 3], w[steps.YAW] = start.position, start.yaw

    @classmethod
    def of_body(cls, config: Config) -> "PoseIntake":
        """For samples that are the body's already, in odom and stamped with their capture."""
        intake = cls.__new__(cls)
        intake._settle(config.sensors, 0.0)
        return intake

    def _settle(self, s: Sensors, delay: float) -> None:
        w = self._work = np.zeros(steps.WORK)
        w[steps.NEWEST] = -math.inf
        w[steps.SAME : steps.SAME + 3] = math.nan
        w[steps.COS] = w[steps.MOUNT] = 1.0
        w[steps.DELAY], w[steps.AGE], w[steps.REACH], w[steps.TURN] = (
            delay,
            s.pose_max_age,
            s.max_jump,
            math.radians(s.max_turn_deg),
        )
        steps.take_sample(w.copy(), np.empty(16))  # so that nothing is compiled when the first one comes
        self._motion = w[1 : steps.CONFIDENCE]
        self._frame: int | None = None
        self.taken = 0
        """Samples that passed."""
        self.epoch = 0
        """Relocalisations so far."""
        self.refused: dict[PoseFault, int] = {fault: 0 for fault in PoseFault if fault is not PoseFault.NONE}
        """Samples that did not, by what was wrong with them."""
        self.fault = PoseFault.NONE
        """What was wrong with the newest sample."""

    def take(self, sample: PoseSample, now: float) -> PoseSample | None:
        """The body's pose from ``sample``, which has arrived by ``now`` (s, the clock of its stamp); None if refused.

        Raises ValueError where the arrays of ``sample`` are not of the lengths that `PoseSample` says.
        """
        w, out = self._work, np.empty(16)
        told = NO_ACCELERATION if sample.acceleration is None else sample.acceleration
        motion = (sample.position, sample.orientation, sample.velocity, sample.angular_velocity, told)
        np.concatenate(motion, out=self._motion)
        w[0], w[steps.CONFIDENCE], w[steps.NOW], w[steps.ANOTHER] = (
            sample.stamp,
            sample.confidence,
            now,
            sample.epoch != self._frame,
        )
        code = steps.take_sample(w, out)
        if code > 0:
            self.fault = PoseFault(code)
            self.refused[self.fault] += 1
            return None
        self.fault, self._frame = PoseFault.NONE, sample.epoch
        self.taken += 1
        if code == steps.RELOCALISED:
            self.epoch += 1
        acceleration = None if sample.acceleration is None else out[13:16]
        return PoseSample(
            float(w[0]), out[0:3], out[3:7], out[7:10], out[10:13], sample.confidence, acceleration, self.epoch
        )

    def report(self) -> str:
        """What became of the samples so far, in one line."""
        wrong = [f"{fault.name.lower().replace('_', ' ')} {n}" for fault, n in self.refused.items() if n]
        refused = f"; refused: {', '.join(wrong)}" if wrong else ""
        return f"poses: {self.taken} taken, {self.epoch} relocalisations{refused}"
