"""Stretches of flight made by the very model that is fitted, with noise: what the fits must find is known."""

from dataclasses import dataclass

import numpy as np

from flightapp.frames import GRAVITY, quat_from_rotvec, quat_multiply, quat_normalize, quat_to_matrix
from flightapp.identification.lags import lagged
from flightapp.identification.series import Stretch

RATE = 250.0


@dataclass(frozen=True)
class Made:
    """The numbers that a stretch is made with."""

    full: float = 38.0
    """m/s² at full throttle."""
    curve: float = 0.2
    delay: float = 0.024
    rate_lag: float = 0.04
    yaw_rate_lag: float = 0.12
    thrust_late: float = 0.035
    """s, lag of the thrust beyond `delay`."""
    drag: tuple[float, float, float] = (0.3, 0.4, 0.5)
    wind: tuple[float, float] = (0.0, 0.0)
    """m/s², a steady push."""
    gust: float = 0.0
    """m/s², standard deviation of pushes that last about half a second."""
    velocity_noise: float = 0.012
    rate_noise: float = 0.006
    rate_bias: float = 0.01

    @property
    def hover(self) -> float:
        linear = 1.0 - self.curve
        return (-linear + np.sqrt(linear**2 + 4.0 * self.curve * GRAVITY / self.full)) / (2.0 * self.curve)


def stretch(made: Made, seed: int, seconds: float = 40.0, gain: float = 1.0) -> Stretch:
    """Flown open loop by smooth random rates and throttle of size ``gain``, levelled by a slow loop as by a pilot."""
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE)
    stamps = np.arange(n) / RATE
    wish = gain * np.stack([_wander(rng, stamps, 0.3, 3.0) for _ in range(4)], axis=1)
    sent, throttle = np.zeros((n, 3)), np.zeros(n)
    q, v = np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3)
    w, rows = np.zeros(3), []
    thrust = GRAVITY
    gust = np.zeros(3)
    behind = round(made.delay * RATE)
    decay = np.exp(-1.0 / RATE / np.array((made.rate_lag, made.rate_lag, made.yaw_rate_lag, made.thrust_late)))
    for k in range(n):
        R = quat_to_matrix(q)
        # The levelling loop: tilt against the velocity, and thrust against the climb.
        back = -0.12 * (R.T @ v)
        tilt = np.array((-R.T[1, 2] - back[1], R.T[0, 2] * 1.0 + back[0], 0.0)) if gain else np.zeros(3)
        sent[k] = 3.0 * wish[k, :3] * (1.0, 1.0, 0.5) + 4.0 * tilt * (1.0, 1.0, 0.0)
        throttle[k] = made.hover * (1.0 + 0.35 * wish[k, 3] - 0.1 * gain * v[2])
        throttle[k] = min(max(throttle[k], 0.03), 0.9)
        rows.append((q, v, w))
        acting = max(k - behind, 0)
        u = throttle[acting]
        goal = made.full * u * (made.curve * u + 1.0 - made.curve)
        before = w, thrust
        w = sent[acting] + (w - sent[acting]) * decay[:3]
        thrust = goal + (thrust - goal) * decay[3]
        mean = 0.5 * (before[0] + w)
        middle = quat_to_matrix(quat_multiply(q, quat_from_rotvec(0.5 / RATE * mean)))
        gust = 0.992 * gust + made.gust * np.sqrt(1 - 0.992**2) * rng.standard_normal(3)
        drag = -np.array(made.drag) * (middle.T @ v)
        a = middle @ (np.array((0.0, 0.0, 0.5 * (before[1] + thrust))) + drag) + gust
        a += (made.wind[0], made.wind[1], -GRAVITY)
        q = quat_normalize(quat_multiply(q, quat_from_rotvec(mean / RATE)))
        v = v + a / RATE
    first = round(RATE)
    orientation, velocity, rates = (np.array(column)[first:] for column in zip(*rows, strict=True))
    velocity = velocity + made.velocity_noise * rng.standard_normal(velocity.shape)
    rates = rates + made.rate_noise * rng.standard_normal(rates.shape) + made.rate_bias
    return Stretch(stamps, sent, throttle, stamps[first:], orientation, velocity, rates, np.full(n - first, np.nan))


def model_rates(made: Made, part: Stretch) -> np.ndarray:
    """What the rates are without noise."""
    lags = (made.rate_lag, made.rate_lag, made.yaw_rate_lag)
    columns = [lagged(part.sent, part.rates[:, k].copy(), made.delay, lags[k], part.stamp) for k in range(3)]
    return np.stack(columns, axis=1)


def _wander(rng: np.random.Generator, stamps: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n,) a sum of sines between two frequencies (Hz), of standard deviation 0.5."""
    tones = 8
    f = np.geomspace(low, high, tones) * rng.uniform(0.9, 1.1, tones)
    phase = rng.uniform(0.0, 2.0 * np.pi, tones)
    return 0.5 * np.sqrt(2.0 / tones) * np.sin(2.0 * np.pi * f * stamps[:, None] + phase).sum(axis=1)
