"""How well a controller holds a line with vehicles that are not what its configuration says: vehicle and controller
alone, without sensors, tasks and time.

The controller sees the true motion as a tracker would tell it: as old as a T265's samples are, and with their white
noise. What drifts slowly is left out: it moves the line, and is not for control to answer.
"""

import math
from collections.abc import Callable

import numpy as np

from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Config
from flightapp.frames import GRAVITY, Vector
from flightapp.interfaces import Controller
from flightapp.jit import lean_kernel
from flightapp.messages import VehicleState
from flightapp.modules import find
from flightapp.trajectory import Trajectory
from flightapp.tuning.score import LOST, Draw
from sim import layout as at
from sim.mismatch import Mismatch, drawn
from sim.plant import Plant
from sim.t265 import T265Errors
from sim.vehicles import load_vehicle

SETTLE = 0.5
"""s of hovering before the line begins."""
LOOK = 25
"""Ticks between looks whether it is lost."""
GUST = 0.5
"""m/s, standard deviation of the gusts where the configuration has none."""


class Scorer:
    """Flies ``line`` again and again; a `FlyDraw`.

    A seed gives the gusts, the noise and, through ``draw``, the vehicle's mismatch.
    """

    def __init__(self, line: Trajectory, draw: Callable[[int], Mismatch] = drawn) -> None:
        self._line, self._draw = line, draw
        self._errors = T265Errors()

    def __call__(self, config: Config, seed: int) -> Draw:
        """How the vehicle that ``seed`` draws flies."""
        plant, delay = self._plant(config, seed)
        controller: Controller = find("controllers", config.control.controller)(config)
        error, why = self._fly(config, plant, delay, controller, np.random.default_rng([seed, 0x5C0]))
        rmse = LOST if why else float(np.sqrt(np.mean(error**2)))
        return Draw(seed, rmse, float(error.max(initial=0.0)), why)

    def _plant(self, config: Config, seed: int) -> tuple[Plant, float]:
        """The vehicle in a hover where the line begins, and its delay (s)."""
        vehicle = self._draw(seed).of(load_vehicle(config.sim.vehicle))
        first = self._line.sample(0.0)
        gust = config.sim.gust or GUST
        plant = Plant(vehicle, seed, wind=config.sim.wind, gust=gust, position=first.position, yaw=float(first.yaw))
        hover = vehicle.mass * GRAVITY / 4.0 / vehicle.thrust_coefficient
        plant.memory[at.ROTORS : at.ROTORS + 4] = np.sqrt(hover)
        plant.command(0.0, (0.0, 0.0, 0.0), vehicle.hover_thrust)
        return plant, vehicle.delay

    def _fly(
        self, config: Config, plant: Plant, delay: float, controller: Controller, rng: np.random.Generator
    ) -> tuple[Vector, str]:
        """(n,) m off the line at each tick of it, and why it was lost, or nothing."""
        line = Trajectory(SETTLE, *self._line_pieces())
        thrust, period = ThrustMap.of(config.vehicle), 1.0 / config.control.rate
        times: Vector = period * np.arange(int((SETTLE + line.duration) / period), dtype=np.float64)
        wanted, flown = line.sample(times - SETTLE).position, np.zeros((times.size, 3))
        noise, age = self._noise(rng, times.size), float(np.mean(self._errors.latency)) + 0.5 / self._errors.rate
        why = ""
        for tick, now in enumerate(times.tolist()):
            plant.advance(now)
            flown[tick] = plant.memory[:3]
            if tick % LOOK == 0 and (why := _lost(plant, wanted[tick])):
                break
            row = plant.state_at(max(now - age, 0.0))
            blur(row, noise[tick])
            seen = VehicleState(row[0], row[1:4], row[4:8], row[8:11], row[11:14], COVARIANCE)
            try:
                command = controller.command(now, seen, line)
            except ValueError as error:
                why = str(error)
                break
            thrust.observe_voltage(plant.voltage, now)
            plant.command(now + delay, command.rates.tolist(), thrust.throttle(command.thrust))
        on_line = slice(int(SETTLE / period), tick + 1)
        return np.linalg.norm(flown[on_line] - wanted[on_line], axis=1), why

    def _line_pieces(self) -> tuple[Vector, Vector, Vector, Vector]:
        line = self._line
        return line.knots, line.coefficients, line.yaw_knots, line.yaw_coefficients

    def _noise(self, rng: np.random.Generator, ticks: int) -> Vector:
        """(n, 12) of position, attitude, velocity and body rates."""
        e = self._errors
        size = np.repeat((e.position_noise, e.attitude_noise, e.velocity_noise, e.rate_noise), 3)
        noise: Vector = size * rng.standard_normal((ticks, 12))
        return noise


def _lost(plant: Plant, wanted: Vector) -> str:
    if plant.on_ground:
        return f"on the ground after {plant.time:.1f} s"
    return f"off the line after {plant.time:.1f} s" if np.linalg.norm(plant.position - wanted) > LOST else ""


@lean_kernel
def blur(row: Vector, noise: Vector) -> None:
    """Add ``noise`` (12,) of position, attitude, velocity and body rates to a trace ``row``, in place."""
    a, b, c = 0.5 * noise[3], 0.5 * noise[4], 0.5 * noise[5]
    w, x, y, z = row[4], row[5], row[6], row[7]
    w, x, y, z = (
        w - x * a - y * b - z * c,
        x + w * a + y * c - z * b,
        y + w * b - x * c + z * a,
        z + w * c + x * b - y * a,
    )
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    row[4], row[5], row[6], row[7] = scale * w, scale * x, scale * y, scale * z
    for k in range(3):
        row[1 + k] += noise[k]
        row[8 + k] += noise[6 + k]
        row[11 + k] += noise[9 + k]


COVARIANCE = np.zeros((9, 9))
"""The controllers here don't look at it."""
