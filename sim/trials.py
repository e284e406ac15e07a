"""The simulated vehicle and a controller alone: no sensors, no tasks.

The controller sees the true motion a little late, and where it is asked for with a T265's white noise. What a tracker's
errors drift by is left out: it moves the line, and is not for control to answer.
"""

import math
from dataclasses import replace

import numpy as np

from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Config
from flightapp.evaluation.control_trials import LOST, Flown, Mismatch, Trial, trial
from flightapp.frames import Vector
from flightapp.interfaces import Controller, WithFallback
from flightapp.jit import lean_kernel
from flightapp.messages import VehicleState
from flightapp.trajectory import Trajectory
from sim.mismatch import perturbed
from sim.plant import Plant
from sim.t265 import T265Errors
from sim.vehicles import load_vehicle

AGE = 0.01
"""s from a state's capture until it is used."""
SETTLING = 3.0
"""s of hover before the line begins."""
WAIT = 1.0
"""s after the line's end, for those who come late."""
UNKNOWN = np.zeros((9, 9))
"""Controllers don't look at the covariance."""


def fly(config: Config, controller: Controller, line: Trajectory, mismatch: Mismatch) -> Trial:
    """Hover where ``line`` begins, then fly it; judged by the truth, from its start to its end, or a little later.

    The controller sees the state of `AGE` before. What the delay cannot be shortened by, the state is newer.
    """
    file = load_vehicle(config.sim.vehicle)
    vehicle = perturbed(file, mismatch)
    age = AGE + min(file.delay + mismatch.delay, 0.0)
    line, end = replace(line, stamp=SETTLING), SETTLING + line.duration
    first, thrust = line.setpoint(0.0), ThrustMap.of(config.vehicle)
    plant = Plant(vehicle, mismatch.seed, config.sim.step, mismatch.wind, mismatch.gust, first.position, first.yaw)
    plant.command(0.0, (0.0, 0.0, 0.0), config.vehicle.hover_thrust)
    controller.reset()
    stood_in = _stood_in(controller)
    ticks = int((end + WAIT) * config.control.rate)
    noise, rows, crashed = _noise(mismatch, ticks + 1), [], False
    for tick in range(1, ticks + 1):
        stamp = tick / config.control.rate
        plant.advance(stamp)
        off = plant.position - line.setpoint(stamp).position
        crashed = plant.on_ground or bool(off @ off > LOST * LOST)
        if stamp >= SETTLING or crashed:
            rows.append((stamp - SETTLING, *plant.position, float(np.linalg.norm(plant.velocity))))
        if crashed:
            break
        x = plant.state_at(max(stamp - age, 0.0))
        blur(x, noise[tick])
        state = VehicleState(max(stamp - AGE, 0.0), x[1:4], x[4:8], x[8:11], x[11:14], UNKNOWN)
        command = controller.command(stamp, state, line)
        thrust.observe_voltage(plant.voltage, stamp)
        plant.command(stamp + vehicle.delay, command.rates, thrust.throttle(command.thrust))
    seen = np.array(rows)
    flown = Flown(seen[:, 0], seen[:, 1:4], seen[:, 4], crashed, _stood_in(controller) - stood_in)
    return trial(line, flown)


def _stood_in(controller: Controller) -> int:
    return sum(controller.fallbacks.values()) if isinstance(controller, WithFallback) else 0


def _noise(mismatch: Mismatch, ticks: int) -> Vector:
    """(n, 12) of position, attitude, velocity and body rates."""
    e = T265Errors()
    size = mismatch.noise * np.repeat((e.position_noise, e.attitude_noise, e.velocity_noise, e.rate_noise), 3)
    noise: Vector = size * np.random.default_rng([mismatch.seed, 0x5C0]).standard_normal((ticks, 12))
    return noise


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
