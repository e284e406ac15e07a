"""Hover thrust, estimated in flight from what was sent and how the vehicle moved.

A Kalman filter of one state with adaptive measurement noise, after PX4's "zero order" hover thrust estimator
(M. Bresciani, src/lib/hover_thrust_estimator) and S. Akhlaghi, N. Zhou and Z. Huang, "Adaptive adjustment of noise
covariance in Kalman filter for dynamic state estimation" (2017). Other than there the state is the thrust's
effectiveness, real thrust over configured thrust, in which the measurement is linear, and the measurement is the whole
momentum gained in a window along the thrust as it turned, so that it holds at any attitude. Throttle is compared with
motion, never with what a controller wanted; a controller that learns the same error by its own means sees its share
shrink as the map gets right.
"""

import math

from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Config
from flightapp.frames import GRAVITY
from flightapp.messages import PoseSample, VehicleState

SHARE = 0.3
"""Of the configured hover thrust, by which the estimate may differ from it."""
RING = 128
"""Commands remembered: half a second at 250 Hz. A power of two, so that a ring index is a mask away."""
WINDOW = 0.1
"""s of motion that make one measurement."""
GAP = 0.05
"""s, longest time between two states, or two commands, that a window may span."""
SETTLING = 0.3
"""s after the first command, in which what the motors did before fades."""
UPRIGHT = 0.6
"""Least cosine of the tilt."""
FASTEST = 6.0
"""m/s, speed up to which drag is taken as linear."""
FORCES = (0.5 * GRAVITY, 1.7 * GRAVITY)
"""m/s², configured force within which the motors are taken to do as told: neither idle nor saturated."""
START_DEVIATION = 0.1
"""Standard deviation of the effectiveness before the first measurement."""
WALK = 0.002
"""1/√s, random walk of the effectiveness: what a battery loses."""
FIRST_NOISE = 0.15
"""Standard deviation of a measurement, before it is known."""
NOISES = (0.005**2, 0.3**2)
"""Bounds of its variance."""
NOISE_LEARNING = 1.0
"""s, time constant of the learning of the noise."""
BIAS_LEARNING = 2.0
"""s, time constant of what of the residuals lasts."""
OUTLIER = 9.0
"""χ² (1 dof) from which a measurement is refused."""
PATIENCE = 10
"""Refusals in a row after which the effectiveness is taken to have changed."""

Triple = tuple[float, float, float]
Sample = tuple[float, Triple, Triple]
"""Stamp (s), velocity (m/s) and body z, both in the world."""
UNKNOWN: Sample = (math.nan, (math.nan,) * 3, (math.nan,) * 3)


class _Sent:
    """The commands that were sent, and the impulse that the motors made of them."""

    def __init__(self, delay: float, lag: float) -> None:
        self._delay, self._lag = delay, max(lag, 1e-4)
        self._stamps, self._forces = [0.0] * RING, [0.0] * RING
        self._now = -math.inf
        self._forget(-math.inf)

    def _forget(self, since: float) -> None:
        """Know nothing of what was commanded before ``since``."""
        self._head = self._tail = 0
        self._acted = self._newest = -math.inf
        self._began = since
        self._command = self._force = 0.0

    def add(self, stamp: float, force: float) -> None:
        """``force`` (m/s²) was commanded at ``stamp``; a stamp that goes back, or a pause, begins anew."""
        if not 0.0 <= stamp - self._newest <= GAP or self._tail - self._head == RING:
            self._forget(stamp + self._delay)
        i = self._tail % RING
        self._stamps[i], self._forces[i] = stamp + self._delay, force
        self._newest = stamp
        self._tail += 1

    def impulse(self, end: float) -> float:
        """Integral of the thrust from the last call's ``end`` to this one's, m/s; NaN where it isn't known."""
        if not end > self._now:
            if end < self._now:
                self._forget(end)
            self._now = end
            return math.nan
        begin, total = self._now, 0.0
        while self._head < self._tail and self._stamps[self._head % RING] <= end:
            i = self._head % RING
            at, self._head = self._stamps[i], self._head + 1
            if self._acted == -math.inf:
                self._force = self._forces[i]
            if at > self._now:
                total += self._run(at)
            self._command, self._acted = self._forces[i], at
        total += self._run(end)
        known = end - self._acted <= GAP and begin - self._began >= SETTLING
        return total if known else math.nan

    def _run(self, until: float) -> float:
        """Impulse up to ``until`` of the command in force, which the thrust follows with its lag."""
        duration, self._now = until - self._now, until
        lacking = self._force - self._command
        left = lacking * math.exp(-duration / self._lag)
        self._force = self._command + left
        return self._command * duration + (lacking - left) * self._lag


class _Effectiveness:
    """The Kalman filter over real thrust divided by configured thrust."""

    def __init__(self, low: float, high: float) -> None:
        self._low, self._high = low, high
        self.value = 1.0
        self._variance, self._noise = START_DEVIATION**2, FIRST_NOISE**2
        self._bias = 0.0
        self._refused = 0

    def wait(self, duration: float) -> None:
        """Let ``duration`` s go by."""
        self._variance = min(self._variance + WALK**2 * duration, START_DEVIATION**2)

    def update(self, measured: float) -> bool:
        """Use one measurement; False where it is refused as an outlier."""
        innovation = measured - self.value
        total = self._variance + self._noise
        if not innovation * innovation <= OUTLIER * total:
            self._refused += 1
            if self._refused >= PATIENCE:
                self._variance, self._noise = START_DEVIATION**2, NOISES[1]
                self._bias, self._refused = 0.0, 0
            return False
        self._refused = 0
        gain = self._variance / total
        self.value = min(max(self.value + gain * innovation, self._low), self._high)
        self._variance *= 1.0 - gain
        residual = measured - self.value
        weight = WINDOW / (WINDOW + NOISE_LEARNING)
        noise = self._noise + weight * ((residual - self._bias) ** 2 + self._variance - self._noise)
        self._noise = min(max(noise, NOISES[0]), NOISES[1])
        # What lasts is not noise, but an effectiveness that has changed.
        self._bias += WINDOW / (WINDOW + BIAS_LEARNING) * (residual - self._bias)
        return True


class HoverThrust:
    """Estimates the hover thrust (0..1, at the reference voltage) that ``thrust`` was configured with.

    Tell it every command that the autopilot follows in flight with `sent`, and none else, and every state with
    `observe`. It learns only where both came without gaps and the motion is within what its model covers (tilt,
    speed, thrust); otherwise, and at first, the estimate stays as it is. It never leaves `SHARE` of the configured
    hover thrust. ``thrust`` is not changed: give the estimate to its `learn`.
    """

    def __init__(self, config: Config, thrust: ThrustMap) -> None:
        vehicle = config.vehicle
        self._thrust = thrust
        self._sent = _Sent(vehicle.delay, vehicle.motor_lag)
        self._drag = 0.5 * (vehicle.drag[0] + vehicle.drag[1])
        self._skew = vehicle.drag[2] - self._drag
        configured = vehicle.hover_thrust
        self._least, self._most = (1.0 - SHARE) * configured, min((1.0 + SHARE) * configured, 1.0)
        self._configured = thrust.relative(configured)
        bounds = (self._configured / thrust.relative(hover) for hover in (self._most, self._least))
        self._filter = _Effectiveness(*bounds)
        self._measured_at = math.nan
        self._last = UNKNOWN
        self._clear()

    @property
    def value(self) -> float:
        """The hover thrust as it is known now."""
        relative = self._configured / self._filter.value
        return min(max(self._thrust.throttle_of(relative), self._least), self._most)

    def sent(self, stamp: float, throttle: float) -> None:
        """The command ``throttle`` (0..1) was sent at ``stamp`` (s), and is followed."""
        if math.isfinite(stamp) and 0.0 <= throttle <= 1.0:
            self._sent.add(stamp, self._thrust.configured_force(throttle))

    def observe(self, state: VehicleState | PoseSample) -> float | None:
        """The hover thrust after ``state``, of which stamp, orientation and velocity count; None if nothing was learnt.

        The frame may be any that doesn't turn or jump, with z up.
        """
        stamp = float(state.stamp)
        if not math.isfinite(stamp):
            return None
        impulse = self._sent.impulse(stamp)
        before, elapsed = self._last, stamp - self._last[0]
        velocity: Triple = state.velocity.tolist()
        self._last = (stamp, velocity, _upward(*state.orientation.tolist()))
        if not self._covered(impulse, elapsed):
            self._clear()
            return None
        self._gather(before, impulse, elapsed)
        if self._duration < WINDOW - 0.5 * elapsed:
            return None
        measured = self._measured()
        self._clear()
        self._filter.wait(stamp - self._measured_at if stamp > self._measured_at else WINDOW)
        self._measured_at = stamp
        return self.value if self._filter.update(measured) else None

    def _covered(self, impulse: float, elapsed: float) -> bool:
        """Whether the model holds for the newest state and what led to it; False if anything isn't a number."""
        _, (u, v, w), (_, _, z) = self._last
        covered = z >= UPRIGHT and u * u + v * v + w * w < FASTEST * FASTEST
        if not covered:
            self._last = UNKNOWN
        return covered and 0.0 < elapsed <= GAP and FORCES[0] * elapsed <= impulse <= FORCES[1] * elapsed

    def _clear(self) -> None:
        """Begin a new window."""
        self._duration = 0.0
        self._px = self._py = self._pz = 0.0
        self._gx = self._gy = self._gz = 0.0

    def _gather(self, before: Sample, impulse: float, elapsed: float) -> None:
        """Add a step: thrust as configured to p, and to g what was gained by it, as the motion shows, both in m/s."""
        _, (u0, v0, w0), (x0, y0, z0) = before
        _, (u, v, w), (x, y, z) = self._last
        x, y, z = 0.5 * (x + x0), 0.5 * (y + y0), 0.5 * (z + z0)
        mu, mv, mw = 0.5 * (u + u0), 0.5 * (v + v0), 0.5 * (w + w0)
        drag, along = self._drag * elapsed, self._skew * elapsed * (x * mu + y * mv + z * mw)
        self._duration += elapsed
        self._px += impulse * x
        self._py += impulse * y
        self._pz += impulse * z
        self._gx += u - u0 + drag * mu + along * x
        self._gy += v - v0 + drag * mv + along * y
        self._gz += w - w0 + drag * mw + along * z + GRAVITY * elapsed

    def _measured(self) -> float:
        """Effectiveness of the thrust in the window: least squares over the three axes."""
        px, py, pz = self._px, self._py, self._pz
        return (px * self._gx + py * self._gy + pz * self._gz) / (px * px + py * py + pz * pz)


def _upward(w: float, x: float, y: float, z: float) -> Triple:
    """Body z in the world of the quaternion q_wb, NaN where that is none."""
    square = w * w + x * x + y * y + z * z
    if not 0.5 < square < 2.0:
        return math.nan, math.nan, math.nan
    scale = 2.0 / square
    return scale * (x * z + w * y), scale * (y * z - w * x), 1.0 - scale * (x * x + y * y)
