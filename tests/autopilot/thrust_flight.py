"""A simulated vehicle flown by the controller through a thrust map, with the hover thrust learnt in flight or not."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flightapp.autopilot.hover_thrust import HoverThrust
from flightapp.autopilot.thrust import ThrustMap
from flightapp.config import Config
from flightapp.control.flatness import FlatnessController
from flightapp.control.layout import TRIM
from flightapp.frames import GRAVITY, Vector
from flightapp.messages import GroundTruth, VehicleState
from flightapp.trajectory import Trajectory
from sim import layout as at
from sim.plant import Plant
from sim.t265 import T265, T265Errors
from sim.vehicles import load_vehicle

SENDING, TRACKING, TELLING = 0.004, 0.005, 0.5
"""s between commands, poses and battery voltages."""


@dataclass
class Flown:
    """What a flight was like, a row per command; ``hover`` is what the map believed, ``real`` was right."""

    time: Vector
    height_error: Vector
    trim: Vector
    hover: Vector
    real: Vector

    def from_to(self, begin: float, end: float) -> "Flown":
        """The part of the flight between two times, s."""
        rows = (self.time >= begin) & (self.time < end)
        return Flown(*(column[rows] for column in vars(self).values()))


class Flight:
    """A vehicle of the simulator that hovers at the start of ``line``; T265 poses, voltage twice a second."""

    def __init__(self, config: Config, line: Trajectory, learning: bool = True, charge: float = 1.0, gust: float = 0.0):
        self._config, self._line, self._learning = config, line, learning
        vehicle = self._vehicle = load_vehicle(config.sim.vehicle)
        start = line.setpoint(0.0)
        self.plant = Plant(vehicle, 1, gust=gust, position=start.position, yaw=start.yaw)
        speed = math.sqrt(vehicle.mass * GRAVITY / 4.0 / vehicle.thrust_coefficient)
        self.plant.memory[at.ROTORS : at.ROTORS + 4] = speed
        self.plant.memory[at.CHARGE] = charge
        self.plant.memory[at.VOLTAGE] = vehicle.battery.cells * np.interp(
            10.0 * charge, range(11), vehicle.battery.open_circuit
        )
        self.plant.command(0.0, (0.0, 0.0, 0.0), self.real_hover())
        self.thrust = ThrustMap.of(config.vehicle)
        self.learner = HoverThrust(config, self.thrust)
        self._controller = FlatnessController(config)
        self._tracker = T265(3, T265Errors(start_position=0.0))
        self._arriving: list[tuple[float, VehicleState]] = []
        self._state = self._seen(0.0)

    def real_hover(self) -> float:
        """Throttle that holds a hover now, where the autopilot makes thrust linear in it."""
        vehicle, P = self._vehicle, self.plant.memory[at.CONSTANTS :]
        share = (self.plant.voltage / vehicle.battery.rated_voltage) ** 2
        return GRAVITY / (P[at.P_MASS_INVERSE] * 4.0 * vehicle.thrust_max * share)

    def make_heavier(self, factor: float) -> None:
        """Multiply the mass."""
        self.plant.memory[at.CONSTANTS + at.P_MASS_INVERSE] /= factor

    def drain(self, times: float) -> None:
        """Have the battery empty so many times as fast."""
        self.plant.memory[at.CONSTANTS + at.P_CAPACITY] /= times

    def _seen(self, time: float) -> VehicleState | None:
        row = self.plant.state_at(time)
        measured = self._tracker.sample(GroundTruth(time, row[1:4], row[4:8], row[8:11], row[11:14]))
        if measured is None:
            return None
        pose, arrival = measured
        state = VehicleState(
            time, pose.position, pose.orientation, pose.velocity, pose.angular_velocity, np.zeros((9, 9))
        )
        self._arriving.append((arrival, state))
        return state

    def _track(self, since: float, now: float) -> None:
        """Take the poses of a period, and hand on those that have arrived."""
        for count in range(math.ceil(since / TRACKING - 1e-6), math.ceil(now / TRACKING - 1e-6)):
            self._seen(count * TRACKING)
        while self._arriving and self._arriving[0][0] <= now:
            self._state = self._arriving.pop(0)[1]
            hover = self.learner.observe(self._state)
            if hover is not None and self._learning:
                self.thrust.learn(hover)

    def fly(self, duration: float, meanwhile: Callable[[float], None] = lambda now: None) -> Flown:
        """Follow the line; ``meanwhile`` is called before each command."""
        rows, delay = [], self._vehicle.delay
        for tick in range(1, round(duration / SENDING)):
            now = tick * SENDING
            meanwhile(now)
            self.plant.advance(now)
            self._track(now - SENDING, now)
            if tick % round(TELLING / SENDING) == 1:
                self.thrust.observe_voltage(self.plant.voltage, now)
            command = self._controller.command(now, self._state, self._line)
            throttle = self.thrust.throttle(command.thrust)
            self.plant.command(now + delay, command.rates, throttle)
            self.learner.sent(now, throttle)
            error = self._line.setpoint(now).position[2] - self.plant.position[2]
            believed = self.thrust.throttle(GRAVITY)
            rows.append((now, error, self._controller._memory[TRIM], believed, self.real_hover()))
        return Flown(*np.array(rows).T)
