"""A vehicle that is nothing but lags: what the controller's model of it says, with errors put in on purpose."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

from flightapp.config import Config
from flightapp.frames import GRAVITY, Vector, quat_from_rotvec, quat_multiply, quat_normalize, quat_to_matrix
from flightapp.interfaces import Controller
from flightapp.jit import kernel
from flightapp.messages import RateCommand, VehicleState
from flightapp.trajectory import ORDER, Trajectory

STEP = 0.001


@dataclass
class Lags:
    """The plant's own numbers: not to be confused with what the controller believes."""

    rate_lag: float = 0.035
    motor_lag: float = 0.035
    delay: float = 0.015
    drag: tuple[float, float, float] = (0.3, 0.3, 0.1)
    thrust_factor: float = 1.0
    gust: float = 0.0
    """m/s², standard deviation of a first-order process of 1 s."""


@kernel
def _step(state: Vector, command: Vector, lags: Vector, push: Vector, dt: float) -> None:
    """One step of ``state`` (14,): position, q_wb, velocity, rates, thrust; ``command`` is rates, thrust."""
    for i in range(3):
        state[10 + i] += (command[i] - state[10 + i]) * (1.0 - math.exp(-dt / lags[0]))
    state[13] += (lags[5] * command[3] - state[13]) * (1.0 - math.exp(-dt / lags[1]))
    q = quat_multiply(state[3:7], quat_from_rotvec(dt * state[10:13]))
    state[3:7] = quat_normalize(q)
    R = quat_to_matrix(state[3:7])
    v_body = R.T @ state[7:10]
    force = np.array((-lags[2] * v_body[0], -lags[3] * v_body[1], state[13] - lags[4] * v_body[2]))
    a = R @ force + push
    a[2] -= GRAVITY
    state[0:3] += dt * state[7:10] + 0.5 * dt * dt * a
    state[7:10] += dt * a


@dataclass
class LagPlant:
    """Integrates at 1 kHz; commands act ``delay`` after they were sent."""

    lags: Lags
    position: Vector
    orientation: Vector = field(default_factory=lambda: np.array((1.0, 0.0, 0.0, 0.0)))
    velocity: Vector = field(default_factory=lambda: np.zeros(3))
    seed: int = 0

    def __post_init__(self) -> None:
        self.time = 0.0
        self.state = np.concatenate((self.position, self.orientation, self.velocity, np.zeros(3), [GRAVITY]))
        self._command = np.array((0.0, 0.0, 0.0, GRAVITY / self.lags.thrust_factor))
        self._pending: list[tuple[float, Vector]] = []
        self._push = np.zeros(3)
        self._rng = np.random.default_rng(self.seed)
        lags = self.lags
        self._numbers = np.array((lags.rate_lag, lags.motor_lag, *lags.drag, lags.thrust_factor))

    def send(self, command: RateCommand) -> None:
        effect = command.stamp + self.lags.delay
        self._pending.append((effect, np.array((*command.rates, command.thrust))))

    def advance(self, until: float) -> None:
        while self.time < until - 0.5 * STEP:
            while self._pending and self._pending[0][0] <= self.time + 1e-9:
                self._command = self._pending.pop(0)[1]
            noise = self.lags.gust * np.sqrt(2.0 * STEP) * self._rng.standard_normal(3)
            self._push += noise - STEP * self._push
            _step(self.state, self._command, self._numbers, self._push, STEP)
            self.time += STEP


@dataclass
class Noise:
    """White noise on the state, and how old it is."""

    position: float = 0.0
    velocity: float = 0.0
    attitude: float = 0.0
    age: int = 0
    """ms"""


def fly(
    controller: Controller,
    plant: LagPlant,
    trajectory: Trajectory,
    duration: float,
    noise: Noise | None = None,
    rate: float = 250.0,
) -> tuple[Vector, Vector, list[RateCommand]]:
    """True states (n, 14) at the ticks, reference positions (n, 3), and the commands sent."""
    noise = noise or Noise()
    rng = np.random.default_rng(7)
    rows, references, commands = [], [], []
    recent = [(plant.time, plant.state.copy())]
    for tick in range(round(duration * rate)):
        stamp = tick / rate
        while plant.time < stamp - 0.5 * STEP:
            plant.advance(plant.time + STEP)
            recent = [*recent[-60:], (plant.time, plant.state.copy())]
        rows.append(plant.state.copy())
        references.append(trajectory.setpoint(stamp).position)
        seen, x = recent[max(-1 - noise.age, -len(recent))]
        state = VehicleState(
            seen,
            x[0:3] + noise.position * rng.standard_normal(3),
            quat_multiply(x[3:7], quat_from_rotvec(noise.attitude * rng.standard_normal(3))),
            x[7:10] + noise.velocity * rng.standard_normal(3),
            x[10:13].copy(),
            np.zeros((9, 9)),
        )
        commands.append(controller.command(stamp, state, trajectory))
        plant.send(commands[-1])
    return np.array(rows), np.array(references), commands


def rmse(rows: Vector, references: Vector) -> float:
    """Position RMSE, m."""
    return float(np.sqrt(np.mean(np.sum((rows[:, 0:3] - references) ** 2, axis=1))))


def spline(times: Vector, points: Vector, yaw: Vector) -> Trajectory:
    """A trajectory of degree 7 through ``points`` (n, 3) at ``times`` (n,), cubic in ``yaw`` (n,)."""
    axes = [PPoly.from_spline(make_interp_spline(times, axis, k=ORDER - 1)) for axis in points.T]
    ends = axes[0].x
    solid = np.diff(ends) > 1e-12
    coefficients = np.stack([axis.c[::-1, solid].T for axis in axes], axis=1)
    knots = np.append(ends[:-1][solid], ends[-1])
    heading = CubicSpline(times, yaw, bc_type="clamped")
    return Trajectory(0.0, knots, coefficients, heading.x.copy(), np.ascontiguousarray(heading.c[::-1].T))


def lemniscate(v_peak: float, turning: bool = True, ramp: float = 1.5) -> Trajectory:
    """Once along x = 5.5 sin θ, y = 2.75 sin 2θ at 1.5 m, from rest to rest; looking ahead if ``turning``."""
    speed = v_peak / np.hypot(5.5, 5.5)
    cruise = 2.0 * np.pi / speed - ramp
    duration = cruise + 2.0 * ramp
    times = np.linspace(0.0, duration, round(duration / 0.06))
    theta = speed * (_ramp(times, ramp) - _ramp(times - ramp - cruise, ramp))
    points = np.stack((5.5 * np.sin(theta), 2.75 * np.sin(2.0 * theta), np.full_like(theta, 1.5)), axis=1)
    yaw = np.unwrap(np.arctan2(5.5 * np.cos(2.0 * theta), 5.5 * np.cos(theta)))
    return spline(times, points, yaw if turning else np.zeros_like(yaw))


def _ramp(t: Vector, length: float) -> Vector:
    """Integral of the smooth step of degree 7 from 0 to 1 over ``length``."""
    u = np.clip(t / length, 0.0, 1.0)
    step = u**5 * (7.0 - 14.0 * u + 10.0 * u**2 - 2.5 * u**3)
    return length * step + np.maximum(t - length, 0.0)


def believing(lags: Lags, **control: object) -> Config:
    """A config that believes ``lags``, with room to race."""
    base = Config()
    known = {
        "rate_lag": lags.rate_lag,
        "yaw_rate_lag": lags.rate_lag,
        "motor_lag": lags.motor_lag,
        "delay": lags.delay,
        "drag": lags.drag,
        "thrust_to_weight": 2.8,
        "rate_max": 6.0,
    }
    return base.model_copy(
        update={
            "vehicle": base.vehicle.model_copy(update=known),
            "control": base.control.model_copy(update=dict(control)),
        }
    )


def at_start(lags: Lags, trajectory: Trajectory, **changes: object) -> LagPlant:
    """A plant at rest at the start of ``trajectory``, facing along it."""
    first = trajectory.setpoint(trajectory.stamp)
    q = np.array((np.cos(0.5 * first.yaw), 0.0, 0.0, np.sin(0.5 * first.yaw)))
    return replace(LagPlant(lags, first.position.copy(), q), **changes)
