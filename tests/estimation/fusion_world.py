"""A vehicle that flies a circle past gates, with a tracker that drifts as the filter expects of it."""

from dataclasses import dataclass, field

import numpy as np

from flightapp.config import Config
from flightapp.estimation.process import MEASURED
from flightapp.frames import (
    GRAVITY,
    quat_conjugate,
    quat_from_rotvec,
    quat_from_yaw,
    quat_multiply,
    quat_rotate,
    quat_rotate_inverse,
)
from flightapp.messages import GateSighting, ImuSample, PoseSample, Sightings
from flightapp.track import Gate, MarkedGate, Start, Track, Uncertainty

RATE = 200.0
UP = np.array((0.0, 0.0, GRAVITY))
RADIUS, TURN = 3.0, 0.8
GATES = {1: (8.0, 0.0, 1.5, 0.3), 2: (0.0, 9.0, 2.0, 2.0), 3: (-8.0, -3.0, 1.8, -2.5)}


def a_track(offsets=None, uncertainty=None, known=True):
    """The track's gates, each off by ``offsets`` (3,)."""
    if not known:
        unplaced = tuple(MarkedGate(id=i, markers=tuple(range(4 * i, 4 * i + 4))) for i in GATES)
        return Track(name="circle", start=Start(position=(0.0, 0.0, 0.0)), unplaced=unplaced)
    offsets = offsets or {}
    gates = tuple(
        Gate(
            id=i,
            position=tuple(np.array(g[:3]) + offsets.get(i, np.zeros(3))),
            yaw_deg=float(np.degrees(g[3])),
            markers=tuple(range(4 * i, 4 * i + 4)),
        )
        for i, g in GATES.items()
    )
    return Track(
        name="circle",
        start=Start(position=(0.0, 0.0, 0.0)),
        gates=gates,
        uncertainty=uncertainty or Uncertainty(horizontal=3.0, vertical=0.5, yaw_deg=10.0),
    )


@dataclass
class Circling:
    """Truth and measurements, drawn from the filter's own model with ``config``."""

    config: Config = field(default_factory=Config)
    seed: int = 0

    def __post_init__(self):
        e, m = self.config.estimation, self.config.mapping
        self.rng = np.random.default_rng(self.seed)
        draw = self.rng.standard_normal
        self.scale = e.scale_error * draw()
        self.bias = e.accelerometer_bias * draw(3)
        self.tilt = e.tilt_error * draw(2)
        self.yaw = e.start_yaw * draw()
        self.drift = e.start_position * draw(3)
        self.slip, self.flown = np.zeros(3), 0.0
        self.stamp = 0.0
        start = self.motion(0.0)[0]
        self.drift = self.drift - self.yaw * np.cross((0.0, 0.0, 1.0), start)
        self.climb = e.slip_up * draw()
        self.mount = quat_from_rotvec(m.attitude_error * draw(3))
        self.range = m.range_error * draw()
        self.epoch = 0

    def motion(self, t):
        """Position, velocity, acceleration and q_wb at ``t``: at rest for 1 s, then ever faster around."""
        s = max(t - 1.0, 0.0)
        ease = 1.0 - np.exp(-s)
        angle, rate, change = TURN * (s - ease), TURN * ease, TURN * np.exp(-s) * (t > 1.0)
        out, along = np.array((np.cos(angle), np.sin(angle), 0.0)), np.array((-np.sin(angle), np.cos(angle), 0.0))
        position = RADIUS * out + (0.0, 0.0, 1.5)
        return (
            position,
            RADIUS * rate * along,
            RADIUS * (change * along - rate**2 * out),
            quat_from_yaw(angle),
            np.array((0.0, 0.0, rate)),
        )

    def advance(self):
        """One period of the tracker; its pose and what the inertial sensors felt."""
        e, dt = self.config.estimation, 1.0 / RATE
        self.stamp += dt
        p, v, a, q, w = self.motion(self.stamp)
        draw, speed = self.rng.standard_normal, float(np.linalg.norm(v))
        keep = np.exp(-dt / e.slip_time)
        noise = draw(3)
        self.slip = keep * self.slip + e.slip_across * speed * np.sqrt(1.0 - keep**2) * noise
        keep = np.exp(-dt / e.slip_up_time)
        self.climb = keep * self.climb + e.slip_up * np.sqrt(1.0 - keep**2) * noise[2]
        self.flown += speed * dt
        self.slip[2] = self.climb * speed * min(speed, MEASURED) ** 2 * np.exp(-self.flown / e.slip_fades)
        turn = np.sqrt((e.yaw_walk**2 * speed + e.yaw_at_rest**2) * dt) * draw()
        walk = np.sqrt((e.drift_walk**2 * speed + e.drift_at_rest**2) * dt) * draw(3)
        self.drift = self.drift + dt * (self.scale * v + self.slip) + walk
        self.drift = self.drift - turn * np.cross((0.0, 0.0, 1.0), p - self.drift)
        self.yaw += turn
        keep = np.exp(-dt / e.tilt_time)
        self.tilt = keep * self.tilt + e.tilt_error * np.sqrt(1.0 - keep**2) * draw(2)
        self.bias = self.bias + e.accelerometer_walk * np.sqrt(dt) * draw(3)
        back = quat_from_yaw(-self.yaw)
        upright = quat_conjugate(quat_from_rotvec(np.array((*self.tilt, 0.0))))
        pose = PoseSample(
            self.stamp,
            quat_rotate(back, p - self.drift) + e.position_noise * draw(3),
            quat_multiply(back, quat_multiply(upright, q)),
            quat_rotate(back, v - self.scale * v - self.slip) + e.velocity_noise * draw(3),
            w,
            3,
            epoch=self.epoch,
        )
        force = quat_rotate_inverse(q, a + UP) + self.bias
        force = force + e.accelerometer_noise * np.sqrt(RATE) * draw(3)
        return pose, ImuSample(self.stamp, force, w)

    def sighting(self, gate_id, stamp, sigma=0.02, sigma_yaw=0.02, gate=None):
        """Of a gate, wherever the camera looks; ``gate`` where it is not where it should be."""
        x, y, z, yaw = gate or GATES[gate_id]
        p, _, _, q, _ = self.motion(stamp)
        way = quat_rotate_inverse(self.mount, quat_rotate_inverse(q, np.array((x, y, z)) - p))
        way = (1.0 + self.range) * way + sigma * self.rng.standard_normal(3)
        turned = quat_multiply(quat_conjugate(q), quat_from_yaw(yaw + sigma_yaw * self.rng.standard_normal()))
        turned = quat_multiply(quat_conjugate(self.mount), turned)
        covariance = np.diag([sigma**2] * 3 + [1e-6, 1e-6, sigma_yaw**2])
        return GateSighting(stamp, gate_id, way, turned, covariance, None, 4, 0.2)

    def seen(self, stamp, gates, **looks):
        """A frame that shows ``gates``."""
        return Sightings(stamp, 0, (), tuple(self.sighting(i, stamp, **looks) for i in gates))
